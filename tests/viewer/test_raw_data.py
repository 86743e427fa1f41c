"""Raw data on the page: what the server answers against sums written out, and the page in a browser."""

import base64
import http.client
import json
from urllib.parse import urlencode

import numpy as np
import pytest

from flgpr.calibrate import channel_health
from flgpr.commands.picture import make_picture
from flgpr.commands.preparing import check_steps, prepare_run, read_steps
from flgpr.commands.raw_run import RawRun
from flgpr.commands.run_report import run_info
from flgpr.imaging import View
from flgpr.store import open_run
from io_gpr import INTERVAL, SAMPLES, ZERO, section, write_dt1
from raw_lane import direct, make_raw_lane, values_of

STEPS = [
    {"do": "dewow", "length_ns": 5.0},
    {"do": "background"},
    {"do": "band", "low_ghz": 0.8, "high_ghz": 2.2},
    {"do": "power", "exponent": 1.5},
]


def ask(viewer, what, **query):
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=20)
    connection.request("GET", f"/{viewer.token}/data/0/raw/{what}?{urlencode(query, doseq=True)}")
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, json.loads(body) if answer.status in (200, 400, 500) else body


@pytest.fixture(scope="module")
def lane(tmp_path_factory):
    path = tmp_path_factory.mktemp("raw") / "run.zarr"
    make_raw_lane(path)
    return path


@pytest.fixture(scope="module")
def viewer(lane, serving):
    from flgpr.viewer import Viewer

    with serving(Viewer([lane], raw=RawRun)) as shown:
        yield shown


def test_the_picture_is_what_prepare_stores(viewer, lane, tmp_path):
    """Every scan, those with a gap in another channel as well, for which steps in time leave the signal alone."""
    asked = {
        "polarization": "HH",
        "pair": "0",
        "scale": "signed",
        "to_ns": "60",
        "steps": json.dumps(STEPS),
    }
    status, answer = ask(viewer, "bscan", **asked)
    assert status == 200
    (tmp_path / "steps.toml").write_text(answer["toml"])
    steps = read_steps(tmp_path / "steps.toml")
    assert steps == check_steps(STEPS)
    made = prepare_run(lane, steps, tmp_path / "made.zarr")
    delays = 60e-9 * (np.arange(800) + 0.5) / 800
    expected = (
        direct(made["signal"].values[:, 0, 0], made["frequency"].values, delays).real
        / answer["unit"]
    )
    seen = values_of(answer)
    np.testing.assert_allclose(seen, expected, atol=2e-3, rtol=2e-3)
    assert np.isnan(seen[50:55]).all()
    assert answer["missing"] == [50, 51, 52, 53, 54]
    assert answer["incomplete"] == [3, 50, 51, 52, 53, 54]


def test_a_spectrum_stands_beside_the_median(viewer, lane):
    status, answer = ask(viewer, "spectrum", polarization="HH", pair="1", scan="7")
    assert status == 200
    level = 20 * np.log10(np.abs(open_run(lane)["signal"].values[:, 0, 1]))
    np.testing.assert_allclose(answer["level_db"], level[7], atol=1e-3)
    np.testing.assert_allclose(answer["median_db"], np.nanmedian(level, axis=0), atol=1e-3)
    assert set(ask(viewer, "spectrum", polarization="HH", pair="1", scan="3")[1]["level_db"]) == {
        None
    }


@pytest.mark.parametrize("whole", [False, True])
def test_an_image_is_what_prepare_and_image_make(viewer, lane, tmp_path, whole):
    """Of one scan, or of all; the background is estimated from all scans either way."""
    asked = {
        "polarization": "HH",
        "pair": "0",
        "steps": json.dumps(STEPS[1:2]),
        "scan": "20",
        "whole": str(whole),
    }
    status, answer = ask(viewer, "image", **asked)
    assert status == 200
    prepare_run(lane, check_steps(STEPS[1:2]), tmp_path / "made.zarr")
    scans = None if whole else (20, 20)
    made = make_picture(tmp_path / "made.zarr", View(scans=scans, polarizations=("HH",)))
    flat = made.image[0, 0]
    assert answer["scans"] == made.scans == (154 if whole else 1)
    assert (answer["across"][0], answer["up"][0], answer["fixed"]) == ("x", "y", {"z": 0.0})
    np.testing.assert_allclose(answer["up"][1:3], flat["y"].values[[0, -1]])
    seen = (
        np.frombuffer(base64.b64decode(answer["halves"]), "<f2").astype(float).reshape(flat.shape)
    )
    level = 20 * np.log10(np.abs(flat.values))
    strong = level > level.max() - 50
    np.testing.assert_allclose(seen[strong], level[strong], atol=0.05)
    assert answer["peaks"][0]["x"] == made.peaks["x"][0]


def test_an_image_that_cannot_be_made_is_told(viewer, lane, tmp_path):
    query = {"polarization": "HH", "pair": "0"}
    for more, words in (
        ({"scan": "52"}, "scan must be one without missing sweeps, got 52"),
        ({"scan": "700"}, "scan must be one of those shown, of 160, got 700"),
        ({"permittivity": "0.2"}, "permittivity: input should be greater than or equal to 1, got"),
    ):
        status, answer = ask(viewer, "image", **query, **more)
        assert status == 400
        assert words in answer["error"]


def test_health_is_what_info_tells(viewer, lane):
    status, answer = ask(viewer, "health")
    table = channel_health(open_run(lane))
    assert status == 200
    assert answer["summary"] == run_info(lane)["health"]
    assert answer["channels"]["missing"] == table["missing"].tolist() == [5, 6, 5, 5]
    np.testing.assert_allclose(answer["channels"]["coherence"], table["coherence"], atol=1e-4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"polarization": "XX"}, "polarization must be one of HH, VV, got 'XX'"),
        ({"pair": "2"}, "pair must be less than 2, got 2"),
        ({"pair": "x"}, "pair: input should be a valid integer"),
        ({"pair": ["0", "1"]}, "every name once"),
        ({"scale": "loud"}, "scale: input should be 'db' or 'signed'"),
        ({"to_ns": "nan"}, "to_ns: input should be a finite number"),
        ({"to_ns": "1e6"}, "to_ns must be at most 80, the tones' unambiguous delay, got 1e"),
        ({"to_ns": "1e-9"}, "to_ns must be at least 0.5"),
        ({"colour": "red"}, "colour"),
        ({"steps": "nonsense"}, "steps must be a JSON list"),
        ({"steps": "[" * 3000}, "steps must be a JSON list"),
        ({"steps": '[{"do": "magic"}]'}, "magic"),
        ({"steps": '[{"do": "dewow", "length_ns": -1}]'}, "greater than 0, got -1"),
        (
            {"steps": '[{"do": "band", "low_ghz": 7, "high_ghz": 8}]'},
            "step 1, band: band must hold a tone",
        ),
        ({"steps": '[{"do": "subtract", "run": "/etc"}]'}, "may not subtract another run"),
        ({"steps": json.dumps([{"do": "dewow", "length_ns": 1}] * 17)}, "at most 16, got 17"),
    ],
)
def test_a_bad_query_is_told_what_is_wrong(viewer, change, words):
    status, answer = ask(viewer, "bscan", **({"polarization": "HH", "pair": "0"} | change))
    assert status == 400
    assert words in answer["error"]


def test_nothing_else_is_found(viewer, lane, demo, serving):
    assert ask(viewer, "magic")[0] == 404
    with serving([lane]) as bare:
        assert ask(bare, "health")[0] == 404
    with serving([demo[0].folder], raw=RawRun) as result:
        assert ask(result, "health")[0] == 404


def test_a_store_that_changes_is_an_error_of_the_server(tmp_path, serving):
    make_raw_lane(tmp_path / "run.zarr", 8)
    with serving([tmp_path / "run.zarr"], raw=RawRun) as shown:
        chunk = next(
            path for path in (tmp_path / "run.zarr" / "signal" / "c").rglob("*") if path.is_file()
        )
        data = bytearray(chunk.read_bytes())
        data[9] ^= 1
        chunk.write_bytes(data)
        assert ask(shown, "bscan", polarization="HH", pair="0")[0] == 500


@pytest.mark.slow("a browser draws every page")
def test_the_page_shows_scans_and_ties_them_to_the_track(watch, viewer):
    one = watch(viewer)
    page = one.page
    one.until("document.getElementById('health-rows').children.length === 4")
    assert "all 4 channels are alive" in one.text("#health-words")
    assert one.text("#answer").startswith("All 4 channels are alive")
    box = page.locator("#bscan").bounding_box()
    page.mouse.click(
        box["x"] + 46 + (box["width"] - 150) * 100.5 / 160, box["y"] + box["height"] / 2
    )
    assert one.text("#raw-scan") == "scan 100"
    assert page.text_content("#said") == "scan 100"
    page.keyboard.press("ArrowRight")
    assert page.text_content("#said") == "scan 101"
    lane = page.locator("#lane").bounding_box()
    page.mouse.move(lane["x"] + 5, lane["y"] + 5)
    middle = lane["x"] + 46 + (lane["width"] - 98) / 2
    page.mouse.click(middle, lane["y"] + 8 + (lane["height"] - 42) / 2)
    assert page.text_content("#said") in ("scan 79", "scan 80")  # the middle of the track
    page.check("#step-background")
    page.fill("#step-scans", "31")
    page.fill("#step-agc", "8")
    page.fill("#step-power", "2")
    page.press("#step-power", "Tab")
    one.until("document.getElementById('raw-toml').textContent.includes('exponent = 2')")
    page.context.grant_permissions(
        ["clipboard-read", "clipboard-write"], origin=one.origin.rstrip("/")
    )
    page.click("#raw-copy")
    one.until("document.getElementById('raw-copied').textContent === 'copied'")
    copied = page.evaluate("() => navigator.clipboard.readText()")
    steps = '[[step]]\ndo = "background"\nscans = 31\n\n[[step]]\ndo = "power"\nexponent = 2.0\n\n'
    assert copied == steps + '[[step]]\ndo = "agc"\nwindow_ns = 8.0\n'


@pytest.mark.slow("a browser draws every page")
def test_the_page_shows_the_image_of_the_marked_scan_and_of_all(watch, viewer):
    one = watch(viewer)
    page = one.page
    idle = "document.getElementById('bscan').getAttribute('aria-busy') === 'false'"
    one.until("document.getElementById('health-rows').children.length === 4")
    one.until(idle)
    before = page.locator("#bscan").screenshot()
    page.select_option("#raw-view", "scan")
    one.until(idle)
    first = page.locator("#bscan").screenshot()
    page.focus("#bscan")
    for scan in ("scan 0", "scan 1"):
        page.keyboard.press("ArrowRight")
        assert page.text_content("#said") == scan
    one.until(idle)
    second = page.locator("#bscan").screenshot()
    page.select_option("#raw-view", "whole")
    one.until(idle)
    page.wait_for_function("document.getElementById('raw-range').value === '40'")
    assert len({before, first, second, page.locator("#bscan").screenshot()}) == 4
    page.fill("#raw-permittivity", "0.1")
    page.press("#raw-permittivity", "Tab")
    one.until("document.getElementById('raw-error').textContent.includes('permittivity')")
    page.select_option("#raw-view", "bscan")
    one.until("document.getElementById('raw-error').textContent === ''")
    assert all("400" in line for line in one.errors)
    one.errors.clear()


@pytest.mark.slow("a browser draws every page")
def test_a_hyperbola_is_laid_over_the_scans_by_hand(watch, viewer):
    one = watch(viewer)
    page = one.page
    one.until("document.getElementById('health-rows').children.length === 4")
    one.until("document.getElementById('bscan').getAttribute('aria-busy') === 'false'")
    page.click("#bscan", position={"x": 300, "y": 100})
    bare = page.locator("#bscan").screenshot()
    page.focus("#raw-permittivity")
    page.keyboard.type("4")
    four = page.locator("#bscan").screenshot()
    page.keyboard.press("ArrowUp")
    assert page.input_value("#raw-permittivity") == "4.08"
    assert len({bare, four, page.locator("#bscan").screenshot()}) == 3


@pytest.mark.slow("a browser draws every page")
@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # rasterio's own, of affine
def test_a_map_lies_below_the_track(watch, lane, serving, tmp_path):
    """Green wherever nothing else is drawn; without a tie to the Earth there is no place for it."""
    rasterio = pytest.importorskip("rasterio")
    from flgpr.viewer import Viewer

    about = {
        "driver": "GTiff",
        "width": 100,
        "height": 100,
        "count": 3,
        "dtype": "uint8",
        "crs": "EPSG:4326",
    }
    spread = rasterio.transform.from_bounds(10.99, 47.99, 11.01, 48.01, 100, 100)
    with rasterio.open(tmp_path / "map.tif", "w", transform=spread, **about) as file:
        file.write(np.stack([np.full((100, 100), one, np.uint8) for one in (10, 180, 20)]))
    (tmp_path / "anchor.toml").write_text(
        'crs = "EPSG:4326"\naccuracy = 0.02\nazimuth_deg = 30.0\nazimuth_accuracy_deg = 0.1\n[[point]]\n'
        "lane = [0.0, 0.0]\nlongitude = 11.0\nlatitude = 48.0\n"
    )
    with pytest.raises(ValueError, match="map needs a result or run that is tied to the Earth"):
        Viewer([lane], backdrop=tmp_path / "map.tif")
    with serving(
        [lane], raw=RawRun, anchor=tmp_path / "anchor.toml", backdrop=tmp_path / "map.tif"
    ) as viewer:
        one = watch(viewer)
        one.until("document.getElementById('health-rows').children.length === 4")
        seen = "[...document.getElementById('lane').getContext('2d').getImageData(60, 20, 1, 1).data].join()"
        one.until(f"{seen} === '10,180,20,255'")
    with serving([lane], raw=RawRun) as bare:
        connection = http.client.HTTPConnection("127.0.0.1", bare.port, timeout=20)
        connection.request("GET", f"/{bare.token}/data/backdrop.png")
        assert connection.getresponse().status == 404
        connection.close()


@pytest.mark.slow("a browser draws every page")
def test_the_page_tells_why_there_is_no_picture(watch, viewer):
    one = watch(viewer)
    one.until("document.getElementById('health-rows').children.length === 4")
    one.page.fill("#raw-to", "40")
    one.page.press("#raw-to", "Tab")
    one.until("document.getElementById('bscan').getAttribute('aria-busy') === 'false'")
    one.page.fill("#step-low", "9")
    one.page.press("#step-low", "Tab")
    one.until("document.getElementById('raw-error').textContent.includes('band must have')")
    assert all("400" in line for line in one.errors)  # the browser's own word on a refused query
    one.errors.clear()


@pytest.mark.slow("a browser draws every page")
def test_a_recording_is_shown_without_an_import_from_its_first_sample_on(tmp_path, serving, watch):
    counts = section(40)
    path = write_dt1(tmp_path / "line.dt1", counts)
    with serving([path], raw=RawRun) as viewer:
        status, answer = ask(viewer, "bscan", polarization="HH", pair="0", scale="signed")
        assert status == 200
        delays = answer["delays_ns"]
        assert delays["start"] == pytest.approx(-ZERO * INTERVAL * 1e9)
        assert delays["stop"] == pytest.approx((SAMPLES - ZERO) * INTERVAL * 1e9)
        seen = values_of(answer) * answer["unit"]
        fine = (np.arange(800) + 0.5) / 800 * SAMPLES  # in samples of the recording
        for trace in (0, 10, 39):  # the echo is strong where the recorder had its strongest sample
            level = np.abs(seen[trace])
            around = np.abs(fine - np.abs(counts[trace]).argmax()) < 1.5
            assert level[around].max() > 0.8 * level.max()
        one = watch(viewer)
        one.until("document.getElementById('health-rows').children.length === 1")
        page = one.page
        assert page.locator("#raw-scale").input_value() == "signed"
        notes = page.locator("#raw-notes li").all_inner_texts()
        assert any(note.startswith("impulse data taken to frequency") for note in notes)
        assert page.locator("#raw-notes-head").is_visible()
        one.close()

"""Raw data on the page: what the server answers against sums written out, and the page in a browser."""

import base64
import http.client
import json
from urllib.parse import urlencode

import numpy as np
import pytest
from raw_lane import make_raw_lane

from flgpr.calibrate import channel_health, disturbed_tones
from flgpr.commands import raw_run as raw_module
from flgpr.commands.picture import make_picture
from flgpr.commands.preparing import check_steps, prepare_run, read_steps
from flgpr.commands.raw_run import RawRun
from flgpr.commands.run_report import run_info
from flgpr.imaging import View
from flgpr.store import open_run, save_run
from io_gpr import INTERVAL, SAMPLES, ZERO, section, write_dt1

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


def values_of(answer):
    halves = np.frombuffer(base64.b64decode(answer["halves"]), "<f2").astype(float)
    return halves.reshape(len(answer["scans"]), answer["delays_ns"]["count"])


def direct(signal, tones, delays):
    """Sum tone by tone, each with its share of the band under the window."""
    share = np.sin(np.pi * np.arange(1, tones.size + 1) / (tones.size + 1)) ** 2 * np.gradient(
        tones
    )
    total = np.zeros((len(signal), delays.size), complex)
    for k, tone in enumerate(tones):
        total += share[k] / share.sum() * signal[:, k, None] * np.exp(2j * np.pi * tone * delays)
    return total


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


def test_decibels_are_the_greatest_amplitude_of_a_bin(lane, monkeypatch):
    monkeypatch.setattr(raw_module, "MOST_BINS", 200)
    answer = RawRun(lane).answer("bscan", {"polarization": "VV", "pair": "1"})
    run = open_run(lane)
    tones = run["frequency"].values
    count = 200
    stop = answer["delays_ns"]["stop"] * 1e-9
    assert stop == pytest.approx(1 / (tones[1] - tones[0]))
    delays = (
        stop * (np.arange(4 * count) + 0.5) / (4 * count)
    )  # 80 ns at four to a period of the band, 2 GHz
    amplitude = (
        np.abs(direct(run["signal"].values[:, 1, 1], tones, delays))
        .reshape(-1, count, 4)
        .max(axis=2)
    )
    one = [0, 20, 100, 159]
    seen = values_of(answer)[one]
    strong = amplitude[one] > 1e-2
    assert strong.sum() > 20
    np.testing.assert_allclose(seen[strong], 20 * np.log10(amplitude[one][strong]), atol=0.04)
    assert answer["top_db"] == pytest.approx(
        20 * np.log10(np.nanpercentile(amplitude, 99.8)), abs=0.05
    )


def test_uneven_tones_are_summed_as_they_are(tmp_path):
    tones = np.sort(np.random.default_rng(2).uniform(0.5e9, 2.5e9, 90))
    make_raw_lane(tmp_path / "uneven.zarr", 8, tones)
    raw = RawRun(tmp_path / "uneven.zarr")
    query = {"polarization": "HH", "pair": "0", "scale": "signed", "to_ns": "20"}
    answer = raw.answer("bscan", query)
    signal = open_run(tmp_path / "uneven.zarr")["signal"].values[:, 0, 0]
    expected = direct(signal, tones, 20e-9 * (np.arange(800) + 0.5) / 800).real
    np.testing.assert_allclose(
        values_of(answer) * answer["unit"], expected, atol=3e-3 * np.abs(expected).max()
    )
    with pytest.raises(ValueError, match="step 1, power: tones must be at least two and even"):
        raw.answer("bscan", query | {"steps": '[{"do": "power", "exponent": 1}]'})


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


def test_tones_that_something_else_transmits_on_are_found(lane, tmp_path):
    """Two neighbours and one alone, in one pair; noise and echoes alone disturb none."""
    run = open_run(lane).compute()
    signal = run["signal"].values.copy()
    rng = np.random.default_rng(1)
    for tone in (30, 31, 100):
        signal[:, :, 1, tone] += 5 * np.exp(2j * np.pi * rng.uniform(size=(160, 2)))
    save_run(run.assign(signal=(run["signal"].dims, signal)), tmp_path / "hit.zarr")
    raw = RawRun(tmp_path / "hit.zarr")
    query = {"polarization": "VV", "scan": "9", "steps": json.dumps(STEPS)}
    told = raw.answer("spectrum", query | {"pair": "1"})["disturbed_ghz"]
    np.testing.assert_allclose(told, run["frequency"].values[[30, 31, 100]] * 1e-9)
    assert raw.answer("spectrum", query | {"pair": "0"})["disturbed_ghz"] == []
    few = disturbed_tones(signal[:2, 0, 1])
    assert few.shape == (161,)
    assert not few.any()


def test_health_is_what_info_tells(viewer, lane):
    status, answer = ask(viewer, "health")
    table = channel_health(open_run(lane))
    assert status == 200
    assert answer["summary"] == run_info(lane)["health"]
    assert answer["channels"]["missing"] == table["missing"].tolist() == [5, 6, 5, 5]
    np.testing.assert_allclose(answer["channels"]["coherence"], table["coherence"], atol=1e-4)


def test_long_runs_and_little_memory_take_every_so_many_scans(lane, monkeypatch):
    query = {"polarization": "HH", "pair": "1"}
    monkeypatch.setattr(raw_module, "MOST_SCANS", 60)
    answer = RawRun(lane).answer("bscan", query)
    assert answer["scans"] == list(range(0, 160, 3))
    assert answer["missing"] == [1, 17, 18]  # scans 3, 51 and 54
    with pytest.raises(ValueError, match="scan must be one of those shown, of 160, got 1"):
        RawRun(lane).answer("spectrum", query | {"scan": "1"})
    size = open_run(lane)["signal"].nbytes // 2
    assert (
        len(RawRun(lane, size).answer("bscan", query)["scans"]) == 32
    )  # a fifth, for the copies at work
    assert RawRun(lane, size).answer("health", {})["channels"]["missing"] == [5, 6, 5, 5]


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


def test_a_moving_background_that_takes_long_is_refused(lane, monkeypatch):
    monkeypatch.setattr(raw_module, "_MOST_RUNNING", 1e5)
    query = {"polarization": "HH", "pair": "0", "steps": '[{"do": "background", "scans": 9}]'}
    with pytest.raises(ValueError, match="9 scans take too long here, use flgpr prepare"):
        RawRun(lane).answer("bscan", query)


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


def test_the_page_shows_scans_and_ties_them_to_the_track(watch, viewer):
    one = watch(viewer)
    page = one.page
    one.until("document.getElementById('health-rows').children.length === 4")
    assert "all 4 channels are alive" in one.text("#health-words")
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


def test_one_scan_on_the_ground_has_no_image(tmp_path):
    make_raw_lane(tmp_path / "air.zarr", 12)
    run = open_run(tmp_path / "air.zarr").compute()
    run["pose"][:, 2] = 0.0
    save_run(run.assign_attrs(sounding="ground-coupled"), tmp_path / "ground.zarr")
    raw = RawRun(tmp_path / "ground.zarr")
    query = {"polarization": "HH", "pair": "0", "permittivity": "6"}
    with pytest.raises(ValueError, match="whole must be true for antennas on the ground"):
        raw.answer("image", query | {"scan": "3"})
    assert raw.answer("image", query | {"whole": "true"})["up"][0] == "z"


@pytest.mark.parametrize("window", [1e9, 1e300])
def test_a_window_of_agc_longer_than_the_trace_is_as_long_as_it(lane, window):
    query = {"polarization": "HH", "pair": "0", "to_ns": "60"}
    answers = [
        RawRun(lane).answer(
            "bscan", query | {"steps": json.dumps([{"do": "agc", "window_ns": one}])}
        )["halves"]
        for one in (80.5, window)
    ]
    assert answers[0] == answers[1]


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

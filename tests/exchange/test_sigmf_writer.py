import json
import re
import tomllib
import warnings
from datetime import UTC, datetime

import numpy as np
import pytest

from flgpr.door import MOST_JSON
from flgpr.formats.arrays import open_arrays
from flgpr.formats.mapped import import_mapped
from flgpr.geo.anchor import fit_anchor
from flgpr.model import make_run
from flgpr_exchange.sigmf import writing as sigmf_writer
from flgpr_exchange.sigmf.reading import NAMESPACE
from flgpr_exchange.sigmf.writing import NAMESPACE_VERSION, write_sigmf
from io_geodesy import LANE, distance, on_the_ellipsoid
from reading import FENCE, ROOT

BEGIN = datetime(2026, 5, 4, 9, 30, tzinfo=UTC)


def random_run(scans=4, polarizations=("HH", "VV"), pairs=3, tones=5, timed=True):
    """Return a run of numbers without a pattern, one of them missing."""
    rng = np.random.default_rng(scans + 10 * pairs + 100 * tones)
    shape = (scans, len(polarizations), pairs, tones)
    signal = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    if scans > 1:
        signal[1, 0, 0, -1] = np.nan
    return make_run(
        signal,
        0.5e9 + 5e6 * np.arange(tones) + rng.random(tones),
        list(polarizations),
        rng.normal(size=(pairs, 3)),
        rng.normal(size=(pairs, 3)),
        rng.uniform(-1.5, 1.5, size=(scans, 6)),
        np.sort(10 * rng.random(scans)) if timed else None,
        {"title": 'lane "7" \x7f', "source": "yard", "site": 3},
    )


@pytest.mark.parametrize(
    "sizes",
    [
        {},
        {"scans": 1},
        {"pairs": 1, "polarizations": ("HV",)},
        {"tones": 1},
        {"timed": False},
        {"scans": 1, "pairs": 1, "tones": 1, "polarizations": ("VV",)},
    ],
    ids=str,
)
def test_a_run_comes_back_to_the_bit(sizes, tmp_path):
    run = random_run(**sizes)
    folder = write_sigmf(run, tmp_path / "lane")
    assert sorted(path.name for path in folder.iterdir()) == [
        "lane.sigmf-data",
        "lane.sigmf-meta",
        "lane.toml",
    ]
    back = import_mapped(folder / "lane.toml").run
    assert back["signal"].values.tobytes() == run["signal"].values.tobytes()
    assert back.equals(run)
    assert {name: back.attrs[name] for name in ("title", "source")} == {
        "title": 'lane "7" \x7f',
        "source": "yard",
    }


def test_the_samples_of_a_scan_are_tones_and_its_channels_pairs(tmp_path):
    run = random_run()
    folder = write_sigmf(run, tmp_path / "lane")
    samples = np.fromfile(folder / "lane.sigmf-data", "<c8").reshape(4, 5, 2, 3)
    expected = run["signal"].transpose("scan", "frequency", "polarization", "pair").values
    np.testing.assert_array_equal(samples, expected)
    metadata = json.loads((folder / "lane.sigmf-meta").read_text())
    starts = [capture["core:sample_start"] for capture in metadata["captures"]]
    assert starts == [0, 5, 10, 15]
    assert metadata["global"]["core:num_channels"] == 6
    assert metadata["global"]["flgpr:polarization"] == ["HH", "VV"]
    assert "core:datetime" not in metadata["captures"][0]
    assert "core:geolocation" not in metadata["captures"][0]


def test_scans_have_a_place_and_a_time_on_the_earth(tmp_path):
    run = random_run()
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [300.0] * 4)
    folder = write_sigmf(run, tmp_path / "lane", anchor, BEGIN)
    captures = json.loads((folder / "lane.sigmf-meta").read_text())["captures"]
    points = np.array([capture["core:geolocation"]["coordinates"] for capture in captures])
    assert distance(points[:, :2], on_the_ellipsoid(run["pose"].values[:, :3])).max() < 0.01
    np.testing.assert_allclose(points[:, 2], 300.0 + run["pose"].values[:, 2], atol=0.01)
    assert captures[0]["core:datetime"] == "2026-05-04T09:30:00.000000Z"
    seconds = open_arrays(folder / "lane.sigmf-meta").read("captures/time")
    elapsed = run["time"].values - run["time"].values[0]
    np.testing.assert_allclose(seconds - BEGIN.timestamp(), elapsed, atol=2e-6)


def test_without_times_only_the_first_scan_has_a_date(tmp_path):
    folder = write_sigmf(random_run(timed=False), tmp_path / "lane", time=BEGIN)
    captures = json.loads((folder / "lane.sigmf-meta").read_text())["captures"]
    assert ["core:datetime" in capture for capture in captures] == [True, False, False, False]
    with pytest.raises(ValueError, match="time must have a time zone"):
        write_sigmf(random_run(), tmp_path / "b", time=datetime(2026, 5, 4))


def test_attributes_without_a_place_are_named(tmp_path, caplog):
    with caplog.at_level("INFO", logger="flgpr.notes"):
        write_sigmf(random_run(), tmp_path / "lane")
    assert "no place for 1 attributes of the run, which are left out: site" in caplog.text


def test_a_name_with_marks_of_patterns_comes_back(tmp_path):
    folder = write_sigmf(random_run(), tmp_path / 'a [1] "b"')
    text = (folder / 'a [1] "b".toml').read_text()
    assert tomllib.loads(text)["files"]["data"] == 'a [[]1] "b".sigmf-meta'
    assert import_mapped(folder / 'a [1] "b".toml').run.sizes["scan"] == 4


def test_the_same_run_gives_the_same_bytes_and_another_is_refused(tmp_path):
    folder = write_sigmf(random_run(), tmp_path / "lane")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    write_sigmf(random_run(), tmp_path / "lane")
    assert before == {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(FileExistsError, match="lane"):
        write_sigmf(random_run(tones=6), tmp_path / "lane")
    assert [path.name for path in tmp_path.iterdir()] == ["lane"]


def test_metadata_of_200_000_scans_are_read_again(tmp_path):
    scans = 50
    folder = write_sigmf(random_run(scans), tmp_path / "lane")
    size = (folder / "lane.sigmf-meta").stat().st_size
    assert size / scans < MOST_JSON / 200_000


@pytest.mark.parametrize(
    ("limit", "most", "got"),
    [
        ("MOST_JSON", 8000, r"got 0.0 MiB and 1\d\d\d values of 100 scans"),
        ("MOST_VALUES", 500, "500 v"),
    ],
)
def test_metadata_that_no_reader_takes_are_refused_before_anything_is_written(
    limit, most, got, tmp_path, monkeypatch
):
    run = random_run(100)
    monkeypatch.setattr(sigmf_writer, limit, most)
    with pytest.raises(
        ValueError, match=rf"{got}.*write parts of at most about (\d+) scans"
    ) as refusal:
        write_sigmf(run, tmp_path / "lane")
    assert not list(tmp_path.iterdir())
    part = int(re.search(r"about (\d+) scans", str(refusal.value)).group(1))
    assert 15 <= part < 100
    write_sigmf(run.isel(scan=slice(0, part - 5)), tmp_path / "part")


def test_the_library_of_sigmf_finds_it_valid(tmp_path):
    sigmf = pytest.importorskip("sigmf")
    run = random_run()
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [300.0] * 4)
    folder = write_sigmf(run, tmp_path / "lane", anchor, BEGIN)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording = sigmf.fromfile(str(folder / "lane.sigmf-meta"))
        recording.validate()
    samples = np.asarray(recording.read_samples())
    expected = run["signal"].transpose("scan", "frequency", "polarization", "pair").values
    np.testing.assert_array_equal(samples, expected.reshape(20, 6))


def names_of_the_extension(metadata):
    return {
        (scope, name)
        for scope, entries in (("global", [metadata["global"]]), ("captures", metadata["captures"]))
        for entry in entries
        for name in entry
        if name.startswith("flgpr:")
    }


def test_the_page_of_the_extension_describes_what_is_written(tmp_path):
    page = ROOT / "docs" / "reference" / f"{NAMESPACE}.sigmf-ext.md"
    text = page.read_text(encoding="utf-8")
    assert f"namespace v{NAMESPACE_VERSION}" in text.splitlines()[0]
    [example] = [body for kind, body in FENCE.findall(text) if kind == "json"]
    folder = write_sigmf(random_run(), tmp_path / "lane")
    written = json.loads((folder / "lane.sigmf-meta").read_text())
    assert names_of_the_extension(json.loads(example)) == names_of_the_extension(written)

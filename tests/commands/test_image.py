"""Options of ``flgpr image`` that a run or a recording has no use for."""

import pytest

from alone import needs
from flgpr.commands.image import image
from flgpr.commands.radargram import Radargram
from flgpr.store import sample_lane
from io_gpr import section, write_dt1

RUN = sample_lane() / "run.zarr"


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "line.dt1"
    write_dt1(path, section(30))
    return path


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({"dewow": True, "gain": True}, "dewow, gain: these are for recordings"),
        ({"channel": 1}, "channel: these are for recordings"),
        ({"until": 20.0}, "until: these are for recordings"),
        ({"scan": 1, "scans": (0, 2)}, "give scan or scans, got both"),
        ({"x": (-1.0, 1.0), "at_x": 0.0}, "x must be given once, got limits and at_x"),
    ],
)
def test_options_that_do_not_fit_a_run_are_refused(options, rule, tmp_path):
    with pytest.raises(ValueError, match=rule):
        image(RUN, tmp_path / "a.png", **options)
    assert not (tmp_path / "a.png").exists()


@needs("flgpr_exchange")
def test_options_that_do_not_fit_a_recording_are_named(recording, tmp_path):
    with pytest.raises(ValueError, match="x, spacing: a recording is drawn as it is"):
        image(recording, tmp_path / "a.png", x=(0.0, 1.0), spacing=0.1)
    assert not (tmp_path / "a.png").exists()


@needs("flgpr_exchange")
def test_a_recording_is_drawn_as_far_as_it_is_asked_for(recording, tmp_path):
    drawn = image(recording, tmp_path / "a.npz", scans=(2, 11), dewow=True)
    assert isinstance(drawn, Radargram)
    assert drawn.values.shape[0] == 10
    assert any("dewow" in step or "running mean" in step for step in drawn.steps), drawn.steps
    shorter = image(recording, tmp_path / "b.npz", until=20.0)
    assert shorter.values.shape[1] < drawn.values.shape[1]


@pytest.mark.parametrize("reach", [0.0, -3.0])
def test_a_picture_that_no_antenna_reaches_is_refused(tmp_path, reach):
    run = sample_lane() / "run.zarr"
    with pytest.raises(ValueError, match=r"reach must be positive \(m\), got"):
        image(run, tmp_path / "a.png", x=(-1, 1), y=(2, 4), spacing=0.2, reach=reach)
    assert not (tmp_path / "a.png").exists()


def test_another_file_is_no_picture_s_source(tmp_path):
    (tmp_path / "a.mat").write_bytes(b"MATLAB")
    with pytest.raises(
        ValueError, match=r"a run or a recording \(.*\) can be drawn, got the ending '\.mat'"
    ):
        image(tmp_path / "a.mat", tmp_path / "a.png")


@needs("flgpr_exchange")
def test_options_that_would_be_dropped_are_refused(recording, tmp_path):
    with pytest.raises(ValueError, match="window, points: a recording is drawn as it is"):
        image(recording, tmp_path / "a.png", window="boxcar", points=3)
    with pytest.raises(ValueError, match="give scan or scans, got both"):
        image(recording, tmp_path / "a.png", scan=3, scans=(1, 5))
    with pytest.raises(ValueError, match="step-window is of dewow and gain, got neither"):
        image(recording, tmp_path / "a.png", step_window=3.0)
    with pytest.raises(ValueError, match=r"anchor is of a GeoTIFF \(\.tif\), got no such output"):
        image(RUN, tmp_path / "a.png", anchor=tmp_path / "anchor.toml")
    with pytest.raises(ValueError, match="anchor and points are of one picture"):
        image(RUN, tmp_path / "a.png", depth=[0.1], points=3)

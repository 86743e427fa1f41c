"""From commercial recordings to a focused section, by commands alone."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.calibrate import calibrate_permittivity
from flgpr.commands.picture import make_picture
from flgpr.imaging import View
from flgpr.model import SPEED_OF_LIGHT
from flgpr.store import open_run, save_run
from flgpr_exchange.commands.imports import import_gpr
from io_gpr import REFLECTORS, SPEED, section, write_dt1, write_dzt, write_segy

TRUE = (SPEED_OF_LIGHT / SPEED) ** 2
WRITERS = {
    "line.DZT": lambda path, counts: write_dzt(path, counts[:, None]),
    "line.sgy": write_segy,
}


def run(*words):
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.stdout


@pytest.mark.parametrize("name", WRITERS)
def test_four_commands_take_a_recording_to_its_reflectors(name, tmp_path):
    WRITERS[name](tmp_path / name, section(60))
    line, ready, picture = (tmp_path / one for one in ("line.zarr", "ready.zarr", "line.png"))
    told = ["--time-zero", 4, "--band", "1.25e8", "1e9"]
    told += ["--separation", 0.2] + (["--step", 0.05] if name == "line.sgy" else [])
    run("import", "gpr", tmp_path / name, "-o", line, *told, "--quiet")
    run("prepare", line, "-o", ready, "--background")
    found = json.loads(run("calibrate", "permittivity", ready, "--json"))
    assert found["permittivity"] == pytest.approx(TRUE, rel=0.05)
    peaks = json.loads(
        run("image", ready, "-o", picture, "--permittivity", found["permittivity"], "--json")
    )["peaks"]
    places = sorted((peak["y"], -peak["z"]) for peak in peaks[:2])
    np.testing.assert_allclose(places, REFLECTORS, atol=0.04)
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.fixture
def line(tmp_path):
    write_dt1(tmp_path / "a.dt1", section(40))
    import_gpr(tmp_path / "a.dt1", tmp_path / "a.zarr")
    return tmp_path / "a.zarr"


def test_antennas_on_the_ground_ask_for_its_permittivity(line):
    with pytest.raises(
        ValueError, match="permittivity must be given for antennas that are coupled to the ground"
    ):
        make_picture(line)


def test_a_section_goes_down_to_the_end_of_the_record_and_z_alone_bounds_it(tmp_path):
    """1200 ns in ground of permittivity 6 are 73 m; a section of 3 m would not be seen to be part of it."""
    write_dt1(tmp_path / "a.dt1", section(20), TOTAL_TIME_WINDOW=1200, TIMEZERO_AT_POINT=1)
    import_gpr(tmp_path / "a.dt1", tmp_path / "a.zarr", band=(2e6, 100e6))
    ground = SPEED_OF_LIGHT / 6**0.5
    made = make_picture(tmp_path / "a.zarr", View(permittivity=6.0, spacing=0.5))
    depth = -float(made.image["z"].values[0])
    assert depth == pytest.approx(1200e-9 * ground / 2, abs=0.5)
    assert made.image["z"].values[-1] == pytest.approx(0, abs=0.5)
    part = make_picture(tmp_path / "a.zarr", View(permittivity=6.0, spacing=0.5, z=(-20.0, -5.0)))
    np.testing.assert_allclose(part.image["z"].values[[0, -1]], [-20, -5])
    np.testing.assert_allclose(part.image["y"].values, made.image["y"].values)


def test_a_section_begins_where_the_record_does(line):
    held = open_run(line)
    window = held.attrs["time_window_s"]
    first = held.attrs["first_sample_s"]
    made = make_picture(line, View(permittivity=TRUE))
    assert -made.image["z"].values[0] == pytest.approx(
        SPEED * (window + first) / 2, abs=made.spacing
    )


def test_the_label_of_the_colour_bar_is_whole(line):
    """Drawn, the label lies within the figure, also where the panel is low."""
    from flgpr.report.images import image_figure

    made = make_picture(line, View(permittivity=TRUE, z=(-0.4, 0.0)))
    figure = image_figure(made.image, made.peaks, open_run(line)["pose"].values)
    FigureCanvasAgg(figure).draw()  # that of a figure without a window draws nothing
    bar = figure.axes[-1]
    box = bar.yaxis.label.get_window_extent()
    assert 0 <= box.y0 < box.y1 <= figure.bbox.y1
    assert box.x1 <= figure.bbox.x1


@pytest.mark.parametrize(("across", "along"), [(60, 142), (60, 20), (20, 20), (90, 8)])
def test_all_words_of_a_picture_lie_in_it(across, along):
    """Points at the edges have numbers, too, and those move no label out of the figure."""
    from flgpr.report.images import image_figure

    x = 0.08 * np.arange(across) - 1.7
    y = 0.08 * np.arange(along) + 2.4
    image = xr.DataArray(
        np.ones((1, 1, along, across), complex),
        dims=("polarization", "z", "y", "x"),
        coords={"polarization": ["VV"], "z": [0.0], "y": y, "x": x},
        attrs={"title": "drive, 6 scans"},
    )
    peaks = pd.DataFrame({"x": [x[0], x[-1], x[-1]], "y": [y[0], y[-1], y[0]], "z": 0.0})
    figure = image_figure(image, peaks, np.zeros((2, 6)))
    FigureCanvasAgg(figure).draw()  # that of a figure without a window draws nothing
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    shown = [text for text in texts if text.get_text() in ("x (m)", "y (m)", "1", "2", "3")]
    assert len(shown) >= 5
    for text in shown:
        box = text.get_window_extent()
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1, text.get_text()
        assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1, text.get_text()


def test_noise_tells_no_permittivity_and_an_edge_is_none(line, tmp_path):
    held = open_run(line).compute()
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(2, *held["signal"].shape))
    save_run(
        held.assign(signal=(held["signal"].dims, (noise[0] + 1j * noise[1]).astype("c8"))),
        tmp_path / "noise.zarr",
    )
    with pytest.raises(ValueError, match=r"stands out|the edge"):
        calibrate_permittivity(tmp_path / "noise.zarr")
    with pytest.raises(ValueError, match="at or beyond the edge of what was tried, 12 to 20"):
        calibrate_permittivity(line, limits=(12.0, 20.0), trials=9)

import subprocess
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

from flgpr.model import make_run
from flgpr.store import open_run, sample_lane


@pytest.fixture(scope="module")
def run():
    return open_run(sample_lane() / "run.zarr")


def test_every_plot_draws_what_it_says(run):
    geometry = run.flgpr.plot.geometry()
    np.testing.assert_allclose(geometry.lines[0].get_ydata(), run["pose"].values[:, 1])
    scan = run.flgpr.plot.scan(1, "VV")
    assert "VV" in scan.get_title()
    assert scan.images[0].get_array().max() == 0
    view = run.flgpr.plot.run_view(spacing=0.2)
    assert np.isfinite(view.images[0].get_array()).any()


def test_a_point_appears_where_it_is():
    point = np.array([0.3, 4.0, 0.0])
    tones = np.linspace(1e9, 2e9, 40)
    tx = np.stack([np.linspace(-1, 1, 9), np.zeros(9), np.zeros(9)], axis=1)
    pose = np.zeros((2, 6))
    pose[:, 2] = 1.5
    path = 2 * np.linalg.norm(tx + [0, 0, 1.5] - point, axis=1)
    signal = np.exp(-2j * np.pi * path[:, None] * tones / 299_792_458.0)
    run = make_run(np.broadcast_to(signal, (2, 1, 9, 40)), tones, ["HH"], tx, tx, pose)
    ax = run.flgpr.plot.scan(-1)
    drawn = ax.images[0]
    row, column = np.unravel_index(drawn.get_array().argmax(), drawn.get_array().shape)
    x0, x1, y0, y1 = drawn.get_extent()
    rows, columns = drawn.get_array().shape
    assert x0 + (column + 0.5) * (x1 - x0) / columns == pytest.approx(0.3, abs=0.04)
    assert y0 + (row + 0.5) * (y1 - y0) / rows == pytest.approx(4.0, abs=0.08)


def test_axes_given_are_drawn_on(run):
    figure, axes = plt.subplots()
    assert run.flgpr.plot.geometry(ax=axes) is axes
    plt.close(figure)


def test_wrong_names_and_missing_sweeps_are_told(run):
    with pytest.raises(ValueError, match="scan must lie"):
        run.flgpr.plot.scan(99)
    with pytest.raises(ValueError, match="polarization must be one of"):
        run.flgpr.plot.scan(0, "LR")
    holed = run.load().copy(deep=True)
    holed["valid"][0, 0, 0] = False
    with pytest.raises(ValueError, match="missing sweeps"):
        holed.flgpr.plot.scan(0)


def test_checks_are_at_hand(run):
    assert len(run.flgpr.health()) == run.sizes["pair"] * run.sizes["polarization"]
    assert run.flgpr.describe()["scans"] == run.sizes["scan"]


@pytest.mark.slow("runs in processes of its own")
@pytest.mark.parametrize(
    "first",
    [
        "import flgpr; run = flgpr.open_run(store)",
        "import xarray; import flgpr; run = xarray.Dataset()",
        "import flgpr; from flgpr.store import open_run; run = open_run(store)",
    ],
)
def test_a_run_has_it_without_a_further_import_and_nothing_slow_is_loaded(first):
    program = (
        f"import sys; store = sys.argv[1]; {first}\n"
        "assert not {'matplotlib', 'numba', 'flgpr.accessor'} & sys.modules.keys()\n"
        "print(type(run.flgpr).__name__)"
    )
    store = str(sample_lane() / "run.zarr")
    done = subprocess.run(
        [sys.executable, "-c", program, store], capture_output=True, text=True, check=False
    )
    assert done.stdout == "RunAccessor\n", done.stderr


def test_importing_the_package_loads_no_xarray():
    program = "import sys, flgpr; assert 'xarray' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_notebook_shows_what_a_run_holds_with_escaped_names(run):
    shown = run.assign_attrs(title="<b>lane</b>").flgpr._repr_html_()
    assert "&lt;b&gt;lane&lt;/b&gt;" in shown
    assert "<b>lane" not in shown
    assert f"<th>scans</th><td>{run.sizes['scan']}</td>" in shown
    labels = ", ".join(run["polarization"].values)
    assert f"<th>polarizations</th><td>{labels}</td>" in shown
    assert shown.count("data:image/png;base64,") == 1


def test_a_notebook_says_of_another_dataset_that_it_is_no_run():
    shown = xr.Dataset({"a": 1}).flgpr._repr_html_()
    assert shown.startswith("<p>This dataset is no run: ")

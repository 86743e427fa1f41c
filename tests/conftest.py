"""Shared fixtures."""

import functools
import gc
import os
import time

# Small products of matrices on several threads cost several times the work itself, above all beside
# other processes, and threads that wait should sleep, not spin. OpenMP and OpenBLAS read this when
# loaded; child processes inherit it.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from pathlib import Path

from alone import BESIDE, IS_ALONE, hide_packages_beside

if IS_ALONE:
    hide_packages_beside()

import hypothesis
import numpy as np
import pytest
import typer.main
from matplotlib.backends.backend_pdf import PdfPages
from PIL import Image

from flgpr.commands.demo import demo as run_demo
from flgpr.model import make_run

DATA = Path(__file__).parent / "data"
DRAWING = {
    "papers", "evidence", "commands", "test_basemap", "test_recording", "test_comparison", "test_kit",
    "test_score_page", "test_radargram", "test_picture_lines",
    "test_design_page", "test_docs_theory", "test_names", "test_figures", "test_curve_figures",
    "test_figure_text", "test_notebook_html", "test_verdict_page",
}  # fmt: skip
"""Folders and files whose tests look at pictures."""
NOT_DRAWING = {"test_scoring", "test_demo_shell"}
"""Files in these folders whose tests look at none."""
HEAVY = (
    "test_links",
    "test_freeze_recipes",
    "test_systems",
    "test_again",
    "test_suite",
    "test_own",
    "test_checking",
    "test_plain_errors",
    "test_freeze_commands",
    "test_freeze_calls",
    "test_kills",
    "test_workers",
    "test_notebook_score",
    "test_running",
    "test_drive_page",
    "test_docs_run",
    "test_approaches",
    "test_interrupt",
    "test_wang2007_study",
    "test_fuzz_exchange",
    "test_live_page",
    "test_few_mines",
    "test_shell",
    "test_static",
    "test_page",
    "test_sections",
    "test_system",
    "test_flsar2004_study",
    "test_detector",
    "test_live_positions",
    "test_compiled",
    "test_kit_mines",
    "test_session",
    "test_design_page",
    "test_demo",
    "test_imports",
    "test_small_screens",
    "test_fuse2018_study",
    "test_lane_roc",
    "test_trial_card",
    "test_cosgrove2004_study",
    "test_picture_lines",
    "test_rail",
    "test_groups_and_scans",
    "test_implausible_poses",
    "test_freeze_formats",
    "test_rvm",
    "test_demo_shell",
    "test_method",
    "test_worlds",
    "test_iteration",
    "test_signal_to_clutter",
    "test_raw_data",
    "test_tiers",
    "test_door",
    "test_recipe_for_run",
    "test_cluster",
    "test_detect",
    "test_survey_lines",
    "test_docs_own_array",
    "test_cuda",
    "test_docs_theory",
    "test_plugin",
    "test_scoring",
)
"""Files that take longest, by what they take in ``make test`` or half of it in ``make test-slow``.

They are begun first, so that the processes end together.
"""
collect_ignore = []
if IS_ALONE:
    for folders in BESIDE.values():
        collect_ignore += folders
hypothesis.settings.register_profile("any machine", deadline=None)  # no test asserts a time
hypothesis.settings.load_profile("any machine")
# At its usual pace the collector goes through all that was imported time and again: a twentieth of
# all time.
gc.set_threshold(100_000, 50, 100)


def pytest_collection_finish():
    gc.freeze()


def pytest_collection_modifyitems(items):
    for item in items:
        for mark in item.iter_markers("slow"):
            if len(mark.args) != 1 or mark.kwargs:
                raise pytest.UsageError(f"{item.nodeid}: slow must say why, got {mark.args}")
    items.sort(
        key=lambda item: HEAVY.index(item.path.stem) if item.path.stem in HEAVY else len(HEAVY)
    )


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(file_path, parent):
    """Look for examples in the package only: files of one name, such as this one, cannot all be imported for it."""
    found = yield
    return [one for one in found if type(one).__name__ != "DoctestModule"]


@pytest.fixture(scope="session", autouse=True)
def quick_disk():
    """Do not wait for the disk: no test takes the power away."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def built_commands():
    """Build the command line once, not for every command that a test calls."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "typer.testing._get_command", functools.cache(typer.main.get_command), raising=False
        )
        yield


@pytest.fixture(scope="module", autouse=True)
def quick_seals(request):
    """Nobody guesses at these passphrases: a key that costs little will do, but where sealing itself is tested."""
    with pytest.MonkeyPatch.context() as patch:
        is_of_sealing = (request.path.parent.name, request.path.stem) == ("trials", "test_sealing")
        if not (IS_ALONE or is_of_sealing):
            patch.setattr("flgpr_trials.sealing._COST", 2**8)
        yield


@pytest.fixture(scope="module", autouse=True)
def blank_pictures(request):
    """Make pictures blank where no test looks at one: drawing takes longer than all the rest of a small detection."""
    with pytest.MonkeyPatch.context() as patch:
        stem = request.path.stem
        if stem in NOT_DRAWING or not {request.path.parent.name, stem} & DRAWING:
            _draw_nothing(patch)
        yield


def _draw_nothing(patch):
    patch.setattr("matplotlib.figure.Figure.savefig", _blank)
    patch.setattr("flgpr.report.kit.FigureCanvasAgg", _BlankCanvas)


def _blank(_figure, target, **options):
    if isinstance(target, PdfPages):
        return
    moment = time.gmtime(0)  # the same bytes each time
    Image.new("L", (1, 1)).save(
        target, options.get("format", "png"), creationDate=moment, modDate=moment
    )


class _BlankCanvas:
    def __init__(self, _figure):
        pass

    print_png = _blank


@pytest.fixture
def fullwave_archive() -> Path:
    return DATA / "lane_a.npz"


@pytest.fixture
def small_run():
    """Four scans of two pairs and five tones: enough for stores and tables."""
    rng = np.random.default_rng(5)
    shape = (4, 2, 2, 5)
    pose = np.zeros((4, 6))
    pose[:, 1] = np.arange(4)
    pose[:, 2] = 1.5
    return make_run(
        rng.normal(size=shape) + 1j * rng.normal(size=shape),
        1e9 + 1e7 * np.arange(5),
        ["HH", "VV"],
        [[-0.5, 0, 0], [0.5, 0, 0]],
        [[0.0, 0, 0], [0.0, 0, 0]],
        pose,
        time=np.arange(4.0),
        attrs={"site": "yard"},
    )


@pytest.fixture(scope="session")
def demo(tmp_path_factory):
    """One demo run for all tests that need a result; none looks at its pictures."""
    with pytest.MonkeyPatch.context() as patch:
        _draw_nothing(patch)
        return run_demo(tmp_path_factory.mktemp("demo") / "result")


@pytest.fixture(scope="session")
def three_mines(tmp_path_factory):
    """Folder of a simulated lane of 30 m with three mines, see few_mines."""
    from few_mines import make_lane  # only where it is asked for

    folder = tmp_path_factory.mktemp("three-mines")
    make_lane(folder)
    return folder


@pytest.fixture
def scoring_files(tmp_path):
    """Folder of a lane, a recipe, a truth, an alarm list and the sorts of targets of a plan."""
    (tmp_path / "lane.toml").write_text("x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 60.0\n")
    (tmp_path / "recipe.toml").write_text("name = 'x'\n")
    (tmp_path / "truth.csv").write_text(
        "target_id,x,y,kind,depth\na,0,10,metal,0\nb,1,30,plastic,0.05\n"
    )
    (tmp_path / "alarms.csv").write_text("x,y,confidence\n0.1,10.2,3\n-1,50,2\n1,30,1\n")
    (tmp_path / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,5\nplastic,0.1,3\n")
    return tmp_path

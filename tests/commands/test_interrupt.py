"""Ctrl-C ends a command in one line with exit status 130, and the same command goes on."""

import os
import signal
import subprocess
import sys
import time

import pytest
import typer
from typer.testing import CliRunner

from flgpr.commands.app import COMMANDS, app
from flgpr.simulate import Simulator
from flgpr.store import save_run
from small_lane import LANE_TOML, TARGETS, small_recipe, small_run

SCENE = (
    'name = "yard"\nsite = "gravel"\nlength = 6.0\n[surface]\ndensity = 2.0\n'
    "[track]\npositions = [0.0, 0.5, 1.0]\n"
    '[[draws]]\nkind = "metal"\ndepth = 0.05\ncount = 1\n'
)
GOES_ON = "stopped; the same command goes on"
RESUMING = {
    "benchmark make",
    "benchmark run",
    "detect",
    "import gprmax",
    "import mapped",
    "reproduce",
    "simulate",
    "train",
}
"""Commands that go on where they were interrupted."""


def call(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def files_of(folder):
    """Return the bytes of all files of a folder by their names."""
    contents = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            contents[path.relative_to(folder).as_posix()] = path.read_bytes()
    return contents


def interrupted_at(calls, function):
    """Return a function that interrupts the program where it is called for the n-th time."""
    left = [calls]

    def call_or_interrupt(*arguments, **options):
        left[0] -= 1
        if left[0] == 0:
            raise KeyboardInterrupt
        return function(*arguments, **options)

    return call_or_interrupt


@pytest.fixture(scope="module")
def lane(tmp_path_factory):
    """Folder of a run of two blocks, its recipe, lane and truth."""
    folder = tmp_path_factory.mktemp("lane")
    save_run(small_run(scans=24, step=0.3), folder / "lane.zarr")
    recipe = small_recipe().replace("variants = true\n", "")
    (folder / "small.toml").write_text(recipe)
    (folder / "lane.toml").write_text(LANE_TOML)
    rows = [f"t{number},{x},{y},metal,0\n" for number, (x, y) in enumerate(TARGETS)]
    (folder / "truth.csv").write_text("target_id,x,y,kind,depth\n" + "".join(rows))
    return folder


def test_these_commands_go_on():
    resuming = {name for name, function in COMMANDS.items() if function.command.resumes}
    assert resuming == RESUMING


@pytest.mark.slow("interrupts commands that run in processes of their own")
def test_an_interrupted_detection_goes_on_to_the_same_bytes(lane, tmp_path, monkeypatch):
    from flgpr.jobs import driver

    words = ["detect", lane / "lane.zarr", "--recipe", lane / "small.toml", "-o"]
    output = tmp_path / "result"
    with monkeypatch.context() as patched:
        patched.setattr(driver, "do_block", interrupted_at(4, driver.do_block))
        stopped = call(*words, output)
    assert stopped.exit_code == 130
    assert stopped.stderr.splitlines()[-1] == GOES_ON
    assert not output.exists()
    assert list((tmp_path / "result.work").glob("*.arrays"))

    assert call(*words, output).exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["result"]
    assert call(*words, tmp_path / "again").exit_code == 0
    alarms = (output / "alarms.csv").read_bytes()
    assert alarms == (tmp_path / "again" / "alarms.csv").read_bytes()


def test_an_interrupted_training_leaves_no_model(lane, tmp_path, monkeypatch):
    from flgpr.jobs import driver

    words = ["train", lane / "lane.zarr", "--truth", lane / "truth.csv", "--lane"]
    words += [lane / "lane.toml", "--recipe", lane / "small.toml", "-o", tmp_path / "model"]
    with monkeypatch.context() as patched:
        patched.setattr(driver, "do_block", interrupted_at(2, driver.do_block))
        stopped = call(*words)
    assert stopped.exit_code == 130
    assert stopped.stderr.splitlines()[-1] == GOES_ON
    assert not (tmp_path / "model").exists()
    assert not list(tmp_path.glob(".partial*"))


@pytest.mark.slow("interrupts commands that run in processes of their own")
def test_an_interrupted_simulation_goes_on_and_another_seed_names_restart(tmp_path, monkeypatch):
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    store = tmp_path / "lane.zarr"
    words = ["simulate", scene, "-o", store]
    with monkeypatch.context() as patched:
        patched.setattr(Simulator, "scan", interrupted_at(2, Simulator.scan))
        stopped = call(*words)
    assert stopped.exit_code == 130
    assert stopped.stderr.splitlines()[-1] == GOES_ON
    assert not store.exists()

    other = call(*words, "--seed", 2)
    assert other.exit_code == 2
    assert other.stderr == (
        f"error: {store}: another unfinished run is there: its seed is 1, this one's 2; "
        "--restart begins again, or choose another output\n"
    )
    with monkeypatch.context() as patched:
        patched.setattr(Simulator, "scan", interrupted_at(1, Simulator.scan))
        stopped = call(*words, "--seed", 2, "--restart")
    assert stopped.stderr.splitlines()[-1] == f"{GOES_ON}, without --restart"
    assert call(*words, "--seed", 2).exit_code == 0
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    assert call("simulate", scene, "-o", elsewhere / "lane.zarr", "--seed", 2).exit_code == 0
    assert files_of(store) == files_of(elsewhere / "lane.zarr")


def test_a_command_that_does_not_go_on_only_says_that_it_stopped(lane, monkeypatch):
    monkeypatch.setattr("flgpr.commands.run_report.run_info", interrupted_at(1, None))
    stopped = call("info", lane / "lane.zarr")
    assert stopped.exit_code == 130
    assert stopped.stderr == "stopped\n"


def test_an_interrupt_while_a_passphrase_is_typed_is_one_word(tmp_path, monkeypatch):
    """The prompt has its own exception, for Ctrl-C and for the end of its input."""
    pytest.importorskip("cryptography")

    def interrupted(*_, **__):
        raise typer.Abort

    monkeypatch.setattr(typer, "prompt", interrupted)
    truth = tmp_path / "truth.csv"
    truth.write_text("target_id,x,y,kind,depth\na,0,10,metal,0.05\n")
    borders = tmp_path / "lane.toml"
    borders.write_text("x_min = -1.5\nx_max = 1.5\ny_min = 0\ny_max = 60\n")
    stopped = call("score", truth, "--seal", "--lane", borders, "-o", tmp_path / "sealed")
    assert stopped.exit_code == 130
    assert stopped.stderr.splitlines()[-1] == "stopped"
    assert not (tmp_path / "sealed").exists()


def interrupted_detection(words, output):
    """Run a survey, interrupt it once its work has begun; return its exit status and last words."""
    command = [sys.executable, "-m", "flgpr", *map(str, words), "-o", str(output)]
    with subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # What a shell starts in the background ignores interrupts, and so would the command.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        while not list(output.glob("*.work/*.arrays")) and process.poll() is None:
            time.sleep(0.02)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate()
    return process.returncode, errors


@pytest.mark.slow("interrupts commands that run in processes of their own")
def test_ctrl_c_on_a_terminal_ends_workers_without_a_traceback(lane, tmp_path):
    """The signal reaches the command and its workers, two lanes being worked on at once."""
    save_run(small_run(scans=300, step=0.02), tmp_path / "a.zarr")
    save_run(small_run(scans=300, step=0.02), tmp_path / "b.zarr")
    words = ["detect", tmp_path / "a.zarr", tmp_path / "b.zarr", "--recipe", lane / "small.toml"]
    words += ["--lane", lane / "lane.toml", "--lane", lane / "lane.toml", "--workers", "2"]
    # On a busy machine the survey may be over before the signal comes: then it is tried again.
    for attempt in range(5):
        output = tmp_path / f"survey-{attempt}"
        status, errors = interrupted_detection(words, output)
        if status != 0:
            break
    assert status == 130, errors
    assert "Traceback" not in errors
    assert errors.splitlines()[-1] == GOES_ON
    assert not (output / "survey.json").exists()


BUSY_WORKERS = """
import multiprocessing
import sys
from pathlib import Path

from flgpr.jobs.workers import Processes


def make_lock_and_count(folder, limit):
    lock = multiprocessing.Lock()
    Path(folder, str(limit)).touch()
    while lock:
        sum(range(limit))


if __name__ == "__main__":
    with Processes(2) as processes:
        list(processes.run(make_lock_and_count, [(sys.argv[1], 1), (sys.argv[1], 10**9)]))
"""


@pytest.mark.slow("interrupts commands that run in processes of their own")
def test_workers_that_are_ended_in_compiled_code_leave_nothing_and_say_nothing(tmp_path):
    """Once a worker is gone its pool terminates the other, which has not seen the interrupt yet."""
    script = tmp_path / "busy.py"
    script.write_text(BUSY_WORKERS)
    marks = tmp_path / "marks"
    marks.mkdir()
    with subprocess.Popen(
        [sys.executable, str(script), str(marks)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        while len(list(marks.iterdir())) < 2 and process.poll() is None:
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate()
    # The first process is a script here, which has its own traceback to show.
    assert errors.splitlines()[-1] == "KeyboardInterrupt"
    assert errors.count("Traceback") == 1
    assert "leaked" not in errors


@pytest.mark.parametrize(
    ("words", "work"),
    [
        (["benchmark", "run", "wang2007", "--quick"], "flgpr.proving_ground.run_benchmark"),
        (["reproduce", "wang2007", "--quick"], "flgpr_papers.reproduce"),
    ],
)
def test_a_study_that_is_interrupted_says_that_it_goes_on(words, work, tmp_path, monkeypatch):
    monkeypatch.setattr(work, interrupted_at(1, None))
    stopped = call(*words, "-o", tmp_path / "work")
    assert stopped.exit_code == 130
    assert stopped.stderr == f"{GOES_ON}\n"

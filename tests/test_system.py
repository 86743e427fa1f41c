"""The package on systems that are no POSIX ones, as far as it can be tried here."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

import flgpr
from flgpr import system
from flgpr.append_log import AppendLog, LogHeldError, read_log
from flgpr.door import DoorError, Folder, open_own
from flgpr.live import sockets
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.senders import SocketWatch
from flgpr.live.source import Inbox
from flgpr.store import sample_lane, save_run
from flgpr.store.files import write_whole
from flgpr.store.outputs import BusyError, atomic_output, locked_folder
from live_lane import make_lane_run, small_recipe
from other_system import Without

TESTS = Path(__file__).parent
SOURCES = Path(flgpr.__file__).parents[1]

FEED_BY_TCP = """
import sys
import threading
import time

from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun

run_store, recipe, output = sys.argv[1:]
live = LiveRun(LiveOptions(recipe, output, tcp="0"))


def play():
    while live.listens_on is None:
        time.sleep(0.02)
    feed(run_store, rate=float("inf"), tcp=str(live.listens_on), lead=0.0)


sender = threading.Thread(target=play)
sender.start()
report = live.run()
sender.join()
print(report.counts["received"])
"""


def as_another_system(*arguments, cwd=None):
    """Run Python as on a system without POSIX, and return what it prints."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(SOURCES), str(TESTS)])}
    done = subprocess.run(
        [sys.executable, "-m", "other_system", *map(str, arguments)],
        capture_output=True,
        text=True,
        env=environment,
        cwd=cwd,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture
def no_posix(monkeypatch):
    """This process as one that can open no folder and knows no flag against links."""
    monkeypatch.setattr(system, "OPENS_FOLDERS", False)
    monkeypatch.setattr(system, "NO_LINK", 0)


@pytest.mark.slow("runs in processes of its own")
def test_every_module_is_imported_without_posix():
    assert int(as_another_system(TESTS / "import_all.py").split()[0]) > 400


def test_what_is_taken_away_is_missed_where_it_is_used(tmp_path):
    """A script of flgpr that needs POSIX fails, so that the test above can fail."""
    package = tmp_path / "flgpr_papers"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "posix_only.py").write_text("import fcntl\n")
    script = tmp_path / "uses_it.py"
    script.write_text(
        f"import sys\nsys.path.insert(0, {str(tmp_path)!r})\nimport flgpr_papers.posix_only\n"
    )
    with pytest.raises(AssertionError, match="No module named 'fcntl'"):
        as_another_system(script)


@pytest.mark.slow("runs in processes of its own")
def test_the_demo_runs_without_posix(tmp_path):
    as_another_system("-m", "flgpr", "demo", "-o", tmp_path / "result", cwd=tmp_path)
    assert (tmp_path / "result" / "report.html").is_file()
    # Lock files and temporary ones are gone.
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result"]


def test_files_of_a_folder_are_read_without_descriptors_of_folders(tmp_path, no_posix):
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "file").write_bytes(b"content")
    folder = Folder(tmp_path)
    assert folder.read("a/b/file") == b"content"
    assert folder.path("a/b") == tmp_path / "a" / "b"
    folder.check_size("a/b/file")
    for name in ("a/c/file", "a/b/none"):
        with pytest.raises(FileNotFoundError, match=name):
            folder.read(name)
    with pytest.raises(FileNotFoundError, match="nowhere"):
        Folder(tmp_path / "nowhere").read("file")


@pytest.mark.parametrize("name", ["link", "inside/file", "a", "a:b", "..", "a/../file"])
def test_no_name_leads_out_without_descriptors_of_folders(tmp_path, no_posix, name):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "file").write_bytes(b"secret")
    root = tmp_path / "root"
    (root / "a").mkdir(parents=True)
    (root / "file").write_bytes(b"")
    (root / "a:b").write_bytes(b"a stream of another file")
    (root / "link").symlink_to(outside / "file")
    (root / "inside").symlink_to(outside)
    for act in (Folder(root).read, Folder(root).check_size):
        with pytest.raises(DoorError):
            act(name)


def test_a_link_is_not_written_through_without_its_flag(tmp_path, no_posix):
    (tmp_path / "target").write_bytes(b"as it was")
    (tmp_path / "link").symlink_to(tmp_path / "target")
    with pytest.raises(DoorError, match="a symbolic link"):
        open_own(str(tmp_path / "link"), os.O_WRONLY)
    assert (tmp_path / "target").read_bytes() == b"as it was"


def test_an_output_has_one_writer_without_locks_of_folders(tmp_path, no_posix):
    work = tmp_path / "work"
    busy = pytest.raises(BusyError, match="another process is writing here")
    with locked_folder(work), busy, locked_folder(work):
        pass
    with locked_folder(work):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["work"]
    with atomic_output(tmp_path / "out") as temporary:
        temporary.write_text("complete")
    write_whole(tmp_path / "out", "replaced")
    assert (tmp_path / "out").read_text() == "replaced"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "work"]


def test_a_log_has_one_writer_without_shared_locks(tmp_path, no_posix):
    with AppendLog(tmp_path / "log") as log:
        log.append(b"line")
        with pytest.raises(LogHeldError):
            AppendLog(tmp_path / "log")
        with pytest.raises(LogHeldError):
            read_log(tmp_path / "log")
    assert read_log(tmp_path / "log") == ([b"line"], b"")


def test_readers_share_a_log(tmp_path):
    with AppendLog(tmp_path / "log") as log:
        log.append(b"line")
    with (tmp_path / "log").open("rb") as file:
        system.lock(file, shared=True)
        assert read_log(tmp_path / "log") == ([b"line"], b"")
        with pytest.raises(LogHeldError):
            AppendLog(tmp_path / "log")


def test_a_lock_is_waited_for(tmp_path, monkeypatch):
    """Where the system waits for too short a time, one asks again and again."""
    monkeypatch.setattr(system, "OPENS_FOLDERS", False)
    asked = []

    def pause(_):
        asked.append(1)
        if len(asked) == 3:
            first.close()

    monkeypatch.setattr(system.time, "sleep", pause)
    path = tmp_path / "file"
    first = path.open("wb")
    system.lock(first)
    with path.open("ab") as second:
        with pytest.raises(BlockingIOError):
            system.lock(second)
        system.lock(second, wait=True)
    assert len(asked) == 3


def test_the_peak_of_memory_is_in_bytes(monkeypatch):
    import resource

    usage = resource.struct_rusage((0.0,) * 2 + (5000,) + (0,) * 13)
    monkeypatch.setattr(resource, "getrusage", lambda _: usage)
    monkeypatch.setattr(sys, "platform", "linux")
    assert system.peak_memory() == 5000 * 1024
    monkeypatch.setattr(sys, "platform", "darwin")
    assert system.peak_memory() == 5000
    monkeypatch.setitem(sys.modules, "resource", None)
    assert system.peak_memory() == 0


def test_the_files_that_may_be_open_are_counted_where_the_system_tells(monkeypatch):
    import resource

    monkeypatch.setattr(resource, "getrlimit", lambda _: (300, 4096))
    assert system.most_open_files() == 300
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY, 4096))
    assert system.most_open_files() is None
    monkeypatch.setitem(sys.modules, "resource", None)
    assert system.most_open_files() is None


def test_a_socket_is_refused_in_words_where_the_system_has_none(tmp_path, monkeypatch):
    monkeypatch.setattr(sockets, "socket", Without(socket, {"AF_UNIX"}))
    path = tmp_path / "radar.sock"
    refusal = pytest.raises(
        ValueError, match=f"socket must be left out, .* got {path}: use tcp instead"
    )
    with refusal:
        SocketWatch(path, Inbox())
    with refusal:
        feed(sample_lane() / "run.zarr", socket_path=path)
    with refusal:
        LiveOptions(None, tmp_path / "live", socket=path)


@pytest.mark.slow("a live session in a process of its own")
def test_scans_come_by_tcp_without_posix(tmp_path):
    script = tmp_path / "feed_by_tcp.py"
    script.write_text(FEED_BY_TCP)
    save_run(make_lane_run(scans=3), tmp_path / "run.zarr")
    (tmp_path / "recipe.toml").write_text(small_recipe())
    printed = as_another_system(
        script, tmp_path / "run.zarr", tmp_path / "recipe.toml", tmp_path / "live"
    )
    assert printed == "3\n"


def test_a_recording_is_read_where_memory_cannot_be_bounded(monkeypatch):
    import resource

    from flgpr.formats import child

    def refuse(*_):
        raise ValueError("current limit exceeds maximum limit")

    monkeypatch.setattr(resource, "setrlimit", refuse)
    monkeypatch.setattr(sys, "platform", "darwin")
    child._bound_memory(2**30)
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(ValueError, match="limit"):
        child._bound_memory(2**30)
    monkeypatch.setitem(sys.modules, "resource", None)
    child._bound_memory(2**30)


def test_a_process_that_works_for_another_ends_at_an_interrupt_in_silence():
    program = (
        "import os, signal, time\nfrom flgpr import system\nsystem.begin_worker()\n"
        "os.kill(os.getpid(), signal.SIGINT)\ntime.sleep(60)"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (-signal.SIGINT, b"", b"")

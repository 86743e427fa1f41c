"""Outputs are whole or absent, of one process at a time, and never over another."""

import multiprocessing
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from flgpr.jobs.checkpoint import begin
from flgpr.results.result import add_files, are_settled, read_result
from flgpr.store import save_run, write_bundle
from flgpr.store.files import check_new, replace_folder, write_whole
from flgpr.store.journal import JOURNAL
from flgpr.store.outputs import (
    BusyError,
    atomic_output,
    locked_folder,
    log_finished,
    same_content,
    write_new,
)
from flgpr.trials import seal_truth
from robust import digests
from small_lane import small_run
from small_results import small_result


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_new_file_stays_if_it_is_the_same_and_is_never_written_over(tmp_path, caplog):
    write_new(tmp_path / "a", "one")
    before = (tmp_path / "a").stat()
    with caplog.at_level("INFO", "flgpr.outputs"):
        write_new(tmp_path / "a", b"one")
    assert "a exists already" in caplog.text
    with pytest.raises(
        FileExistsError, match=r"must not exist yet, got .*a, which holds something else"
    ):
        write_new(tmp_path / "a", "two")
    assert (tmp_path / "a").stat() == before
    (tmp_path / "link").symlink_to(tmp_path / "a")
    with pytest.raises(FileExistsError):
        write_new(tmp_path / "link", "one")
    assert names(tmp_path) == ["a", "link"]


@pytest.mark.parametrize("links", [True, False])
def test_one_that_appears_meanwhile_is_not_written_over(links, tmp_path, monkeypatch):
    if not links:
        monkeypatch.setattr(
            os, "link", lambda *_: (_ for _ in ()).throw(PermissionError(1, "not permitted"))
        )

    def late():
        with atomic_output(tmp_path / "a") as made:
            made.write_text("mine")
            (tmp_path / "a").write_text("another's")

    with pytest.raises(FileExistsError):
        late()
    assert (tmp_path / "a").read_text() == "another's"
    write_new(tmp_path / "b", "mine")
    assert (tmp_path / "b").read_text() == "mine"
    assert names(tmp_path) == ["a", "b"]


def test_a_folder_is_whole_or_absent_and_may_hold_more_only_where_that_is_said(tmp_path):
    def make(text="one", **options):
        with atomic_output(tmp_path / "a", **options) as made:
            made.mkdir()
            (made / "x").write_text(text)

    make()
    make()
    (tmp_path / "a" / "more").write_text("y")
    make(more=True)
    for options in ({}, {"text": "two", "more": True}):
        with pytest.raises(FileExistsError):
            make(**options)
    make("two", replace=True)
    assert digests(tmp_path / "a").keys() == {"x"}
    assert not same_content(tmp_path / "a", tmp_path / "a" / "x")

    def fail():
        with atomic_output(tmp_path / "b") as made:
            made.mkdir()
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert names(tmp_path) == ["a"]


def test_what_a_killed_writer_left_is_taken_away_by_the_next(tmp_path):
    left = tmp_path / ".partial-a"
    (left / "deep").mkdir(parents=True)
    (left / "deep" / "half").write_text("h")
    (left / "a").symlink_to("/etc/hostname")
    write_new(tmp_path / "a", "whole")
    assert names(tmp_path) == ["a"]
    (tmp_path / "a.partial").write_text("half a text that is longer")
    write_whole(tmp_path / "a", "new")
    assert (tmp_path / "a").read_text() == "new"
    assert names(tmp_path) == ["a"]


def test_a_pipe_at_the_name_of_a_temporary_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.partial")
    write_whole(tmp_path / "a", "new")
    assert (tmp_path / "a").read_text() == "new"
    assert names(tmp_path) == ["a"]


TAKEN = {
    "whole file": (lambda path: write_whole(path, "new"), ("a", "a.partial")),
    "new file": (lambda path: write_new(path, "new"), ("a", ".partial-a")),
    "arrays": (lambda path: write_bundle(path, {"a": np.zeros(2)}), ("a",)),
    "folder": (lambda path: replace_folder(path.with_name("made"), path), ("a", ".replaced-by-a")),
    "lock": (lambda path: locked_folder(path).__enter__(), ("a",)),
    "run": (lambda path: save_run(small_run(), path), ("a", "a.partial", ".replaced-by-a")),
    "run again": (
        lambda path: save_run(small_run(), path, resume=True, overwrite=True),
        ("a", "a.partial", ".replaced-by-a"),
    ),
    "sealed": (lambda path: seal_truth(None, None, path, ""), ("a",)),
    "checked": (check_new, ("a",)),
    "work": (lambda path: begin(path, {}).__enter__(), ("a", "a.done")),
}
"""What writes to a path, and the names that it removes, replaces, or makes as temporary ones."""


@pytest.mark.parametrize("lead", ["precious", "precious/file", "nowhere"])
@pytest.mark.parametrize(
    ("write", "name"), [(write, name) for write, taken in TAKEN.values() for name in taken]
)
def test_a_link_at_a_name_that_a_writer_takes_is_refused(write, name, lead, tmp_path):
    """Whether it leads to a folder, to a file or nowhere: neither it nor what it leads to changes."""
    for folder in ("precious", "made", "out"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "file").write_text(folder)
    (tmp_path / "out" / "made").mkdir()
    link = tmp_path / "out" / name
    link.symlink_to(tmp_path / lead)
    before = digests(tmp_path)
    with pytest.raises(FileExistsError, match="must not be a symbolic link, got one to") as told:
        write(tmp_path / "out" / "a")
    assert str(link) in str(told.value)
    assert str(tmp_path / lead) in str(told.value)
    assert digests(tmp_path) == before
    assert link.is_symlink()
    assert not (tmp_path / "nowhere").exists()


def test_a_folder_on_the_way_to_an_output_may_be_a_link(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "data").symlink_to(tmp_path / "disk")
    write_whole(tmp_path / "data" / "a", "new")
    write_new(tmp_path / "data" / "b", "new")
    save_run(small_run(), tmp_path / "data" / "c", resume=True)
    assert names(tmp_path / "disk") == ["a", "b", "c"]


def test_a_journal_that_is_a_link_is_not_written_through(tmp_path):
    (tmp_path / "precious").write_text("no end of line")
    (tmp_path / "a.partial").mkdir()
    (tmp_path / "a.partial" / JOURNAL).symlink_to(tmp_path / "precious")
    with pytest.raises(FileExistsError, match="symbolic link"):
        save_run(small_run(), tmp_path / "a", resume=True)
    assert (tmp_path / "precious").read_text() == "no end of line"


def test_a_copy_that_somebody_named_old_is_kept(tmp_path):
    for name in ("new", "a", "a.old"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).write_text(name)
    replace_folder(tmp_path / "new", tmp_path / "a")
    assert digests(tmp_path).keys() == {"a/new", "a.old/a.old"}


def test_another_process_at_the_same_output_is_refused_or_waited_for(tmp_path):
    with atomic_output(tmp_path / "a") as made:
        made.write_text("first")
        with pytest.raises(BusyError, match="another process is writing here"):
            write_new(tmp_path / "a", "second")
    assert (tmp_path / "a").read_text() == "first"
    (tmp_path / "f").mkdir()
    order = []
    with locked_folder(tmp_path / "f"):
        waiting = threading.Thread(target=lambda: hold_and(order.append, tmp_path / "f"))
        waiting.start()
        order.append("first")
    waiting.join()
    assert order == ["first", "second"]
    assert names(tmp_path) == ["a", "f"]


def hold_and(tell, folder):
    with locked_folder(folder, wait=True):
        tell("second")


RACE = """
import os, sys
from pathlib import Path
from flgpr.store.files import write_whole
from flgpr.store.outputs import BusyError, write_new
home = Path(sys.argv[1])
own = next((number for number in (1, 2, 3) if not os.fork()), 0)
text = str(own) * 400_000
for trial in range(15):
    write_whole(home / "shared", text)
    try:
        write_new(home / f"new-{trial}", text)
        print(f"{trial} wrote\\n", end="", flush=True)
    except (FileExistsError, BusyError):
        pass
while own == 0:
    try:
        os.wait()
    except ChildProcessError:
        break
"""


def test_processes_that_race_for_a_file_never_mix(tmp_path):
    said = subprocess.run(
        [sys.executable, "-c", RACE, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert (said.returncode, said.stderr) == (0, "")
    for path in tmp_path.iterdir():
        content = path.read_text()
        assert len(content) == 400_000
        assert len(set(content)) == 1
    assert names(tmp_path) == sorted([*(f"new-{trial}" for trial in range(15)), "shared"])
    assert sorted(said.stdout.split()[::2], key=int) == [str(trial) for trial in range(15)]


def test_a_temporary_file_may_go_while_another_process_looks_at_it(tmp_path, monkeypatch):
    temporary = tmp_path / "table.csv.partial"
    temporary.write_text("of another process")
    look = Path.lstat

    def look_late(path):
        temporary.unlink(missing_ok=True)
        monkeypatch.undo()
        return look(path)

    monkeypatch.setattr(Path, "lstat", look_late)
    write_whole(tmp_path / "table.csv", "whole")
    assert names(tmp_path) == ["table.csv"]


def add(folder, number):
    for trial in range(10):
        add_files(
            folder,
            {f"page-{number}.html": f"{number} {trial}" * 1000, "report.html": f"{number}" * 5000},
        )


def test_two_that_add_files_to_a_result_at_once_both_end_well(tmp_path):
    folder = small_result(tmp_path / "result")
    context = multiprocessing.get_context("fork")
    both = [context.Process(target=add, args=(folder, number)) for number in (1, 2)]
    for one in both:
        one.start()
    for one in both:
        one.join()
        assert one.exitcode == 0
    result = read_result(folder)
    assert are_settled(folder)
    assert set(result.manifest["added"]) == {"page-1.html", "page-2.html", "report.html"}
    assert len(set((folder / "report.html").read_text())) == 1
    assert not [path for path in Path(folder).rglob("*.partial")]


def test_what_a_killed_writer_left_goes_when_the_output_is_found_whole(tmp_path):
    """A kill may come after an output has its name and before its temporary folder is removed."""
    output = tmp_path / "sealed"
    output.write_text("whole")
    partial = tmp_path / ".partial-sealed"
    partial.mkdir()
    (partial / "sealed").write_text("whole")
    log_finished(output)
    assert [path.name for path in tmp_path.iterdir()] == ["sealed"]


def test_a_folder_that_a_process_writes_in_stays(tmp_path):
    output = tmp_path / "sealed"
    output.write_text("whole")
    with locked_folder(tmp_path / ".partial-sealed"):
        log_finished(output)
        assert (tmp_path / ".partial-sealed").is_dir()
    link = tmp_path / ".partial-other"
    (tmp_path / "elsewhere").mkdir()
    link.symlink_to(tmp_path / "elsewhere")
    log_finished(tmp_path / "other")
    assert (tmp_path / "elsewhere").is_dir()
    assert link.is_symlink()


@pytest.mark.parametrize("output", [".", "/"])
def test_an_output_without_a_name_is_refused(output):
    with pytest.raises(ValueError, match=rf"output must have a name of its own, got '{output}'"):
        write_new(Path(output), "text")

"""Registers that several processes write, that a full disk or a kill stops, and that somebody cuts off at the end."""

import errno
import json
import multiprocessing
import os
import shutil
import stat
import subprocess
import sys

import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr import append_log
from flgpr.append_log import AppendLog, LogHeldError, read_log
from flgpr.commands.app import app
from flgpr.model import Lane
from flgpr.trials import (
    WitnessedRegister,
    check_head,
    check_passphrase,
    head_of,
    open_truth,
    read_register,
    register,
    score_blind,
    seal_truth,
)
from flgpr_trials.blind import Registration
from flgpr_trials.ledger import enter, read_checked_register
from flgpr_trials.sealing import FORMAT

LANE = Lane(0.0, 4.0, 0.0, 30.0)
TRUTH = pd.DataFrame(
    {
        "target_id": ["a", "b"],
        "x": [1.0, 2.0],
        "y": [5.0, 10.0],
        "kind": ["metal", "plastic"],
        "depth": 0.1,
    }
)
ALARMS = pd.DataFrame([(1.0, 5.0, 9.0), (1.0, 25.0, 7.0)], columns=["x", "y", "confidence"])
PHRASE = "gravel otter seven lamps"


def together(work, arguments):
    """Do work in as many processes at once, and give what each returns."""
    context = multiprocessing.get_context("fork")
    with context.Pool(len(arguments)) as pool:
        return pool.starmap(work, arguments)


def register_many(book, who):
    return [register(book, event="entry", who=who, k=k)["number"] for k in range(12)]


def test_processes_that_register_at_once_make_one_chain(tmp_path):
    book = tmp_path / "book.jsonl"
    numbers = together(register_many, [(book, who) for who in range(4)])
    lines = read_register(book)  # refuses a chain that is broken anywhere
    assert sorted(number for some in numbers for number in some) == list(range(1, 49))
    assert [line["number"] for line in lines] == list(range(1, 49))
    for who in range(4):
        assert [line["k"] for line in lines if line["who"] == who] == list(range(12))


def look(sealed, k):
    return score_blind(ALARMS.assign(confidence=[1.0, 1.0 + k]), sealed, PHRASE).looks


def test_looks_at_once_are_counted_one_by_one(tmp_path):
    pytest.importorskip("cryptography")
    sealed = seal_truth(TRUTH, LANE, tmp_path / "sealed", PHRASE)
    assert sorted(together(look, [(sealed, k) for k in range(4)])) == [1, 2, 3, 4]


class FullDisk:
    """Takes so many bytes and then has no room."""

    def __init__(self, room):
        self.room = room

    def write(self, file, data):
        left = data[: self.room]
        self.room -= len(left)
        if not left and data:
            raise OSError(errno.ENOSPC, "No space left on device")
        return file.write(left)


@pytest.mark.parametrize("room", [0, 1, 40, 150])
def test_a_full_disk_leaves_no_half_line(tmp_path, monkeypatch, room):
    book = tmp_path / "book.jsonl"
    register(book, event="first")
    before = book.read_bytes()
    disk = FullDisk(room)

    def write_all(file, data):
        left = memoryview(data)
        while left:
            left = left[disk.write(file, left) :]

    monkeypatch.setattr(append_log, "write_all", write_all)
    with pytest.raises(OSError, match="No space"):
        register(book, event="second")
    assert book.read_bytes() == before
    monkeypatch.undo()
    assert register(book, event="third")["number"] == 2


def test_half_a_line_of_a_kill_is_dropped_and_told(tmp_path):
    book = tmp_path / "book.jsonl"
    for event in "ab":
        register(book, event=event)
    whole = book.read_bytes()
    book.write_bytes(whole + b'{"event": "c", "has')
    assert len(read_register(book)) == 2
    with pytest.warns(UserWarning, match=r"19 bytes of an unfinished line 3 were dropped"):
        assert register(book, event="d")["number"] == 3
    assert len(read_register(book)) == 3
    book.write_bytes(whole[:-1])  # an editor took the last end of a line away: nothing is lost
    assert [line["event"] for line in read_register(book)] == ["a", "b"]
    assert register(book, event="e")["number"] == 3
    lines = book.read_bytes().splitlines(keepends=True)
    book.write_bytes(
        lines[0] + lines[1][:20] + b"\n" + lines[2]
    )  # half a line elsewhere is no accident of writing
    with pytest.raises(ValueError, match="got a line 2 that does not fit"):
        register(book, event="f")


KILLED = """
import os, signal, sys
from flgpr import append_log
step, real = int(sys.argv[2]), append_log.write_all
def write_all(file, data):
    real(file, data[: step * len(data) // 4])
    if step < 5:
        os.kill(os.getpid(), signal.SIGKILL)
append_log.write_all = write_all
from flgpr_trials.ledger import register
register(sys.argv[1], event="killed")
"""


@pytest.mark.slow("is killed, and begins again, several times")
@pytest.mark.parametrize("step", range(5))
def test_a_kill_while_a_line_is_written_breaks_nothing(tmp_path, step):
    book = tmp_path / "book.jsonl"
    register(book, event="first")
    ended = subprocess.run([sys.executable, "-c", KILLED, str(book), str(step)], check=False)
    assert ended.returncode == -9
    lines = read_register(book)
    assert [line["event"] for line in lines] == ["first", "killed"][: 1 + (step == 4)]
    with (
        pytest.warns(UserWarning, match="were dropped")
        if 0 < step < 4
        else pytest.MonkeyPatch.context()
    ):
        register(book, event="next")
    assert read_register(book)[-1]["number"] == len(lines) + 1


def test_an_entry_that_may_not_be_made_leaves_the_register_as_it_is(tmp_path):
    book = tmp_path / "book.jsonl"
    register(book, event="first")
    before = book.read_bytes()
    with pytest.raises(ValueError, match="too late"):
        enter(
            book, lambda lines: (_ for _ in ()).throw(ValueError(f"too late, {len(lines)} lines"))
        )
    assert book.read_bytes() == before


def test_a_log_is_held_by_one_process_and_must_be_a_file(tmp_path):
    path = tmp_path / "log"
    with AppendLog(path) as log:
        log.append(b"a")
        with pytest.raises(LogHeldError, match="another process holds it"):
            AppendLog(path, 0.05)
        with pytest.raises(LogHeldError, match="another process holds it"):
            read_log(path)
        with pytest.raises(ValueError, match="must not hold the end of a line"):
            log.append(b"a\nb")
    assert read_log(path) == ([b"a"], b"")
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "folder").mkdir()
    for name in ("fifo", "folder"):
        with pytest.raises((ValueError, IsADirectoryError), match=r"regular file|directory"):
            AppendLog(tmp_path / name)
        with pytest.raises((ValueError, IsADirectoryError), match=r"regular file|directory"):
            read_log(tmp_path / name)
    with (tmp_path / "sparse").open("wb") as file:
        file.truncate(append_log.MOST_BYTES + 1)
    with pytest.raises(ValueError, match="at most 1024 MiB"):
        read_log(tmp_path / "sparse")


def test_a_line_is_on_the_disk_before_it_counts(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(
        "os.fsync", lambda handle: synced.append(stat.S_IFMT(os.fstat(handle).st_mode))
    )
    register(tmp_path / "book.jsonl", event="a")
    assert synced == [
        stat.S_IFDIR,
        stat.S_IFREG,
    ]  # the folder's entry of the new file, then the line


def test_a_lost_last_line_shows_beside_a_report_and_beside_a_witness(tmp_path):
    book = tmp_path / "book.jsonl"
    witness = tmp_path / "elsewhere" / "witness.jsonl"
    witness.parent.mkdir()
    watched = WitnessedRegister(book, witness)
    for event in "abc":
        register(watched, event=event)
    told = head_of(read_register(book))
    assert told["lines"] == 3
    whole = book.read_bytes()
    book.write_bytes(b"".join(whole.splitlines(keepends=True)[:2]))
    assert len(read_register(book)) == 2  # the chain itself fits
    with pytest.raises(ValueError, match=r"lacks line 3: it has 2, and .*witness.jsonl saw 3"):
        read_checked_register(watched)
    with pytest.raises(ValueError, match=r"lacks line 3: it has 2, and the report tells 3"):
        check_head(read_register(book), told, book, "the report")
    with pytest.raises(ValueError, match="lacks line 3"):
        register(watched, event="d")
    register(book, event="other")  # without the witness, another third line
    with pytest.raises(ValueError, match=r"has another line 3 than .*witness.jsonl saw"):
        register(watched, event="d")
    with pytest.raises(ValueError, match="has another line 3 than the report tells"):
        check_head(read_register(book), told, book, "the report")
    book.write_bytes(whole)
    assert register(watched, event="d")["number"] == 4
    book.unlink()
    with pytest.raises(ValueError, match="lacks line 1"):
        register(watched, event="anew")
    register(book, event="anew")
    with pytest.raises(ValueError, match="one that begins otherwise"):
        read_checked_register(watched)


@pytest.fixture
def trial(tmp_path):
    """A sealed truth and a register with its recipe."""
    pytest.importorskip("cryptography")
    book = tmp_path / "book.jsonl"
    register(book, recipe="r" * 64)
    return seal_truth(TRUTH, LANE, tmp_path / "sealed", PHRASE), book


def test_a_blind_score_tells_the_heads_of_log_and_register(trial):
    sealed, book = trial
    told = score_blind(ALARMS, sealed, PHRASE, registered=Registration(book, "r" * 64))
    assert told.heads["log"] == head_of(read_register(f"{sealed}.log.jsonl"))
    assert told.heads["register"] == head_of(read_register(book))
    assert told.heads["register"]["lines"] == 2


def test_the_sealed_file_is_authenticated_whole(trial, tmp_path):
    sealed, _ = trial
    told = json.loads(sealed.read_text())
    bent = tmp_path / "bent"
    changes = [
        {"note": told["note"].replace("guards", "Guards")},
        {"scrypt": {**told["scrypt"], "p": 2}},
        {"scrypt": {**told["scrypt"], "n": 2 * told["scrypt"]["n"]}},
        {"more": 1},
    ]
    for change in changes:
        bent.write_bytes(json.dumps({**told, **change}, indent=1).encode() + b"\n")
        with pytest.raises(ValueError, match=r"altered|as it was written"):
            open_truth(bent, PHRASE)
    data = sealed.read_bytes()
    for k in range(0, len(data), max(len(data) // 150, 1)):  # a byte anywhere
        bent.write_bytes(data[:k] + bytes([data[k] ^ 1]) + data[k + 1 :])
        with pytest.raises(
            ValueError, match=r"altered|as it was written|of the format|scrypt cost"
        ):
            open_truth(bent, PHRASE)
    for whole in (
        data + b"\n",
        data[:-1],
        b" " + data,
        json.dumps(told).encode(),
    ):  # written in another way
        bent.write_bytes(whole)
        with pytest.raises(ValueError, match="as it was written"):
            open_truth(bent, PHRASE)
    assert not (tmp_path / "bent.log.jsonl").exists()


def test_looks_are_counted_by_what_lies_in_the_seal(trial, tmp_path):
    sealed, _ = trial
    log = tmp_path / "one.log"
    assert score_blind(ALARMS, sealed, PHRASE, log).looks == 1
    copied = shutil.copy(sealed, tmp_path / "copied")
    assert score_blind(ALARMS, copied, PHRASE, log).looks == 2  # the same truth under another name
    again = seal_truth(TRUTH, LANE, tmp_path / "again", PHRASE)
    assert score_blind(ALARMS, again, PHRASE, log).looks == 1  # sealed anew it is another test


def test_a_file_of_before_is_told_so(tmp_path):
    old = tmp_path / "old"
    old.write_text(
        json.dumps(
            {"format": "flgpr-sealed-truth-1", "note": "", "scrypt": {}, "token": ""}, indent=1
        )
    )
    with pytest.raises(
        ValueError, match=f"{FORMAT}, got .* of an earlier version, .*: seal the truth again"
    ):
        open_truth(old, PHRASE)


@pytest.mark.parametrize("cost", [2, 2**7, 2**21, 2**40, 1000])
def test_a_cost_that_is_cheap_or_endless_is_refused(trial, tmp_path, cost):
    sealed, _ = trial
    told = json.loads(sealed.read_text())
    told["scrypt"]["n"] = cost
    bent = tmp_path / "bent"
    bent.write_bytes(json.dumps(told, indent=1).encode() + b"\n")
    with pytest.raises(ValueError, match="scrypt cost that is a power of two"):
        open_truth(bent, lambda: pytest.fail("a passphrase was asked for in vain"))


def seal_on_the_command_line(folder, typed):
    """Seal a truth into ``folder / "s"``, a passphrase being typed as asked for."""
    TRUTH.to_csv(folder / "truth.csv", index=False)
    (folder / "lane.toml").write_text("x_min = 0\nx_max = 4\ny_min = 0\ny_max = 30\n")
    words = [
        "score",
        "--seal",
        folder / "truth.csv",
        "--lane",
        folder / "lane.toml",
        "-o",
        folder / "s",
    ]
    return CliRunner().invoke(app, [str(word) for word in words], input=typed)


@pytest.mark.parametrize(
    "weak", ["aaaaaaaa", " " * 8, "12345678", "password1", "qwertyuiop", "abcabcabc", "short"]
)
def test_a_weak_passphrase_is_refused_before_it_is_typed_again(tmp_path, weak):
    with pytest.raises(ValueError, match=r"hard to guess|at least 8 characters") as told:
        check_passphrase(weak)
    assert weak.strip() == "" or weak not in str(told.value)
    ran = seal_on_the_command_line(tmp_path, f"{weak}\n{weak}\n")
    assert ran.exit_code == 2
    assert "Repeat for confirmation" not in ran.output
    assert not (tmp_path / "s").exists()


def test_a_passphrase_typed_twice_differently_seals_nothing(tmp_path):
    ran = seal_on_the_command_line(tmp_path, f"{PHRASE}\n{PHRASE}x\n")
    assert (ran.exit_code, (tmp_path / "s").exists()) == (2, False)
    assert "nothing was sealed" in ran.output
    assert seal_on_the_command_line(tmp_path, f"{PHRASE}\n{PHRASE}\n").exit_code == 0


def test_the_command_checks_a_register_beside_reports_and_a_witness(tmp_path, trial):
    sealed, book = trial
    (tmp_path / "recipe.toml").write_text("name = 'mine'\n")
    witness = tmp_path / "witness.jsonl"
    words = [
        "plan",
        "register",
        str(tmp_path / "recipe.toml"),
        "--book",
        str(book),
        "--witness",
        str(witness),
    ]
    assert CliRunner().invoke(app, words).exit_code == 0
    ALARMS.to_csv(tmp_path / "a.csv", index=False)
    asked = ["score", str(tmp_path / "a.csv"), "--sealed", str(sealed), "--recipe", str(tmp_path / "recipe.toml"),
             "--book", str(book), "--witness", str(witness), "-o", str(tmp_path / "score")]  # fmt: skip
    ran = CliRunner().invoke(app, asked, input=f"{PHRASE}\n")
    assert ran.exit_code == 0, ran.output
    assert "register: 3 lines, the last is" in ran.output
    page = (tmp_path / "score" / "report.html").read_text()
    assert head_of(read_register(book))["head"] in page
    check = [
        "plan",
        "check",
        str(book),
        "--report",
        str(tmp_path / "score"),
        "--witness",
        str(witness),
    ]
    ran = CliRunner().invoke(app, check)
    assert ran.exit_code == 0, ran.output
    assert f"{tmp_path / 'score'} knows 3 of them" in ran.output
    assert f"{witness} knows 3 of them" in ran.output
    told = json.loads(CliRunner().invoke(app, [*check, "--json"]).stdout)
    assert [line["event"] for line in told["events"]] == ["", "recipe", "truth opened"]
    for other, words in (
        ("nobody.jsonl", "witness not found"),
        ("empty.jsonl", "witness must know lines of"),
        (str(book), "witness must be another file than the register"),
    ):
        (tmp_path / "empty.jsonl").touch()
        ran = CliRunner().invoke(app, [*check[:5], "--witness", str(tmp_path / other)])
        assert ran.exit_code == 2
        assert words in ran.output
    assert (
        "only --report or --witness shows"
        in CliRunner().invoke(app, ["plan", "check", str(book)]).output
    )
    book.write_bytes(b"".join(book.read_bytes().splitlines(keepends=True)[:-1]))
    for some in (check[:5], [*check[:3], *check[5:]]):
        ran = CliRunner().invoke(app, some)
        assert ran.exit_code == 2
        assert "lacks line 3" in ran.output
    ran = CliRunner().invoke(app, ["plan", "check", str(book), "--report", str(tmp_path / "a.csv")])
    assert "report must be the roc.json" in ran.output
    ran = CliRunner().invoke(
        app, ["score", str(tmp_path / "a.csv"), "--truth", "truth.csv", "--witness", str(witness)]
    )
    assert "--witness goes with --book" in ran.output


def test_the_log_of_looks_has_a_witness_and_reports_as_a_register_has(tmp_path):
    """Without a register the log alone tells how often a truth was looked at."""
    pytest.importorskip("cryptography")
    sealed = seal_truth(TRUTH, LANE, tmp_path / "sealed", PHRASE)
    log = tmp_path / "sealed.log.jsonl"
    witness = tmp_path / "witness.jsonl"
    ALARMS.to_csv(tmp_path / "a.csv", index=False)

    def look(name):
        asked = [
            "score",
            str(tmp_path / "a.csv"),
            "--sealed",
            str(sealed),
            "--witness",
            str(witness),
        ]
        return CliRunner().invoke(app, [*asked, "-o", str(tmp_path / name)], input=f"{PHRASE}\n")

    for name in ("one", "two"):
        ran = look(name)
        assert ran.exit_code == 0, ran.output
    assert "log: 2 lines, the last is" in ran.output
    reports = ["--report", str(tmp_path / "one"), "--report", str(tmp_path / "two")]
    beside = (reports, ["--witness", str(witness)])
    for some in beside:
        ran = CliRunner().invoke(app, ["plan", "check", str(log), *some])
        assert ran.exit_code == 0, ran.output
    whole = log.read_bytes()
    for kept in (1, 0):
        log.write_bytes(b"".join(whole.splitlines(keepends=True)[:kept]))
        for some in beside:
            ran = CliRunner().invoke(app, ["plan", "check", str(log), *some])
            assert ran.exit_code == 2
            assert f"lacks line {kept + 1}" in ran.output
        ran = look("three")
        assert ran.exit_code == 2
        assert f"lacks line {kept + 1}" in ran.output
        assert not (tmp_path / "three").exists()


def test_a_copy_in_the_same_folder_has_the_same_log(tmp_path):
    pytest.importorskip("cryptography")
    sealed = seal_truth(TRUTH, LANE, tmp_path / "sealed", PHRASE)
    os.mkfifo(tmp_path / "a.log.jsonl")
    (tmp_path / "b.log.jsonl").write_text("this is another file\n")
    register(tmp_path / "c.log.jsonl", event="score", sealed="of another truth")
    copied = shutil.copy(sealed, tmp_path / "copied")
    os.link(sealed, tmp_path / "linked")
    looks = [
        score_blind(ALARMS, one, PHRASE).looks for one in (copied, sealed, tmp_path / "linked")
    ]
    assert looks == [1, 2, 3]
    assert not (tmp_path / "sealed.log.jsonl").exists()
    (tmp_path / "elsewhere").mkdir()
    away = shutil.copy(sealed, tmp_path / "elsewhere" / "sealed")
    assert (
        score_blind(ALARMS, away, PHRASE).looks == 1
    )  # another folder: the log did not go with it


@pytest.mark.parametrize("text", ["notes of mine", "notes of mine\nand more"])
@pytest.mark.parametrize("is_link", [False, True])
def test_a_file_that_is_no_register_stays_as_it_is(text, is_link, tmp_path):
    """Also one whose only line has no end, which looks like one that a kill left."""
    notes = tmp_path / "notes.txt"
    notes.write_text(text)
    book = tmp_path / "book"
    book.symlink_to(notes) if is_link else book.write_text(text)
    with pytest.raises(ValueError, match="must be"):
        register(book, event="plan")
    assert notes.read_text() == text
    assert book.read_text() == text


def test_what_is_no_line_of_a_register_is_told(tmp_path):
    (tmp_path / "other").write_text("no register")
    with pytest.raises(ValueError, match="must be a register, got another file"):
        read_register(tmp_path / "other")
    register(tmp_path / "book", event="plan")
    with (tmp_path / "book").open("a") as file:
        file.write('{"half')
    told = CliRunner().invoke(app, ["plan", "check", str(tmp_path / "book")])
    assert told.exit_code == 0, told.output
    assert "book: 6 bytes of an unfinished line at the end are left out" in told.output
    assert "book: 1 lines, each fits" in told.output

"""A driver's answers in the log of a live run: who may write, what is refused, what happens to them afterwards."""

import json
import os
import threading

import pytest
from test_live_page import Feeder
from test_verdicts import bytes_of, put
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.store.answers import MOST_ANSWER_BYTES, MOST_ANSWERS, add_answer
from flgpr.viewer import Viewer
from small_results import small_result

PATH = "data/answers"
GOOD = {
    "alarm_id": "alarm-7", "answer": "saw it", "x": 0.5, "y": 12.0, "left_m": -1, "scan": 3,
}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    Feeder(tmp_path).give({"event": "end"})
    return tmp_path


def kept(folder):
    return [json.loads(line) for line in (folder / "answers.jsonl").read_text().splitlines()]


def test_only_the_right_page_writes_and_only_where_that_was_asked_for(serving, folder):
    before = bytes_of(folder)
    with serving([], live=folder) as viewer:
        assert put(viewer, GOOD, PATH)[0] == 405
    with serving([], live=folder, answers=True) as viewer:
        assert put(viewer, GOOD, PATH, token="wrong")[0] == 403
        for headers in (
            {"Origin": "http://evil.example"},
            {"Host": "evil.example"},
            {"Sec-Fetch-Site": "cross-site"},
        ):
            assert put(viewer, GOOD, PATH, **headers)[0] == 403
        for method in ("POST", "DELETE", "PATCH", "OPTIONS"):
            assert put(viewer, GOOD, PATH, method=method)[0] == 405
        for other in ("data/live", "data/session.json", "answers.jsonl", "data/answers/x"):
            assert put(viewer, GOOD, other)[0] == 405
        assert bytes_of(folder) == before
        status, told = put(viewer, GOOD, PATH, Origin=f"http://127.0.0.1:{viewer.port}")
        assert status == 200
        assert json.loads(told)["answer"] == "saw it"
    (line,) = kept(folder)
    assert {name: line[name] for name in GOOD} == GOOD
    assert {
        path: text for path, text in bytes_of(folder).items() if path.name != "answers.jsonl"
    } == before


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"answer": "perhaps"}, "answer: "),
        ({"alarm_id": ""}, "alarm_id: "),
        ({"alarm_id": "a" * 65}, "alarm_id: "),
        ({"alarm_id": "a\nb"}, "alarm_id: "),
        ({"x": "0.5"}, "x: "),
        ({"y": 1e300}, "y: "),
        ({"scan": -1}, "scan: "),
        ({"scan": 1.5}, "scan: "),
        ({"time": 0.0}, "time: no such entry"),
    ],
)
def test_what_breaks_a_rule_is_refused_by_name_and_nothing_is_written(
    serving, folder, change, words
):
    with serving([], live=folder, answers=True) as viewer:
        status, told = put(viewer, GOOD | change, PATH)
        assert status == 409
        assert json.loads(told)["error"].startswith(f"answer is not kept: {words}")
        assert put(viewer, b"{", PATH)[0] == 409
        assert put(viewer, b"[1]", PATH)[0] == 409
        assert put(viewer, b'{"x": NaN}', PATH)[0] == 409
        assert put(viewer, b" " * (MOST_ANSWER_BYTES + 1), PATH)[0] == 413
    assert not (folder / "answers.jsonl").exists()


def test_pages_that_write_at_once_keep_every_line(serving, folder):
    with serving([], live=folder, answers=True) as viewer:

        def answer(number):
            for k in range(5):
                assert put(viewer, GOOD | {"scan": 10 * number + k}, PATH)[0] == 200

        pages = [threading.Thread(target=answer, args=(n,)) for n in range(4)]
        for page in pages:
            page.start()
        for page in pages:
            page.join(60)
    assert sorted(one["scan"] for one in kept(folder)) == [
        10 * n + k for n in range(4) for k in range(5)
    ]


def test_a_log_is_not_endless_and_no_link(folder, tmp_path):
    (folder / "answers.jsonl").write_text("{}\n" * MOST_ANSWERS)
    body = json.dumps(GOOD).encode()
    with pytest.raises(ValueError, match=f"at most {MOST_ANSWERS}"):
        add_answer(folder, body)
    (folder / "answers.jsonl").unlink()
    os.symlink(folder / "live.jsonl", folder / "answers.jsonl")
    events = (folder / "live.jsonl").read_bytes()
    with pytest.raises((ValueError, OSError), match="link"):
        add_answer(folder, body)
    assert (folder / "live.jsonl").read_bytes() == events
    with pytest.raises(ValueError, match="no folder"):
        add_answer(folder / "none", body)


def test_answers_need_a_live_run(tmp_path):
    (tmp_path / "lane").mkdir()
    ran = CliRunner().invoke(app, ["view", "--answers", "--no-browser"])
    assert (ran.exit_code, ran.output.count("\n")) == (2, 1)
    small_result(tmp_path / "result")
    words = "need a live run"
    with pytest.raises(ValueError, match=words):
        Viewer([tmp_path / "result"]).keep_answers()  # and it listens no more
    ran = CliRunner().invoke(app, ["view", str(tmp_path / "result"), "--answers", "--no-browser"])
    assert (ran.exit_code, ran.output.count("\n")) == (2, 1)
    assert words in ran.output


def test_a_run_that_goes_on_keeps_them_and_one_begun_anew_says_what_it_removes(
    folder, tmp_path, caplog
):
    add_answer(folder, json.dumps(GOOD).encode())
    add_answer(folder, json.dumps(GOOD).encode())
    (tmp_path / "in").mkdir()
    caplog.set_level("INFO")
    out = tmp_path / "out"
    out.mkdir()
    (folder / "answers.jsonl").rename(out / "answers.jsonl")
    LiveRun(LiveOptions("wang2007", out, tmp_path / "in", idle=0.1, fresh=True)).run()
    assert not (out / "answers.jsonl").exists()
    assert "2 answers of drivers to the run before are removed" in caplog.text

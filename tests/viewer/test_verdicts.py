"""Verdicts kept beside the result: who may write, what is refused, and what a second analyst finds again."""

import http.client
import json

import pytest
from typer.testing import CliRunner

from flgpr.commands.agree import agree
from flgpr.commands.app import app
from flgpr.store import read_verdicts
from flgpr.viewer import Viewer
from small_results import small_result

PATH = "data/verdicts.json"


def put(viewer, body, path=PATH, method="PUT", token=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=10)
    data = body if isinstance(body, bytes) else json.dumps(body).encode()
    connection.request(method, f"/{viewer.token if token is None else token}/{path}", data, headers)
    answer = connection.getresponse()
    told = answer.read()
    connection.close()
    return answer.status, told.decode()


def told(*verdicts, before=""):
    notes = [
        {"result": "r", "alarm_id": str(i), "verdict": one, "text": "é"}
        for i, one in enumerate(verdicts)
    ]
    return {"format": "flgpr-notes", "version": 1, "before": before, "notes": notes}


@pytest.fixture
def result(tmp_path):
    small_result(tmp_path / "result")
    return tmp_path / "result"


def bytes_of(folder):
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_only_the_right_page_writes_and_only_where_that_was_asked_for(serving, result, tmp_path):
    file = tmp_path / "anna.json"
    with serving([result]) as viewer:
        assert put(viewer, told("mine"))[0] == 405
        assert put(viewer, b"", method="GET")[0] == 404
    with serving([result], verdicts=file) as viewer:
        own = f"127.0.0.1:{viewer.port}"
        assert put(viewer, told("mine"), token="wrong")[0] == 403
        for headers in (
            {"Origin": "http://evil.example"},
            {"Host": "evil.example"},
            {"Sec-Fetch-Site": "cross-site"},
        ):
            assert put(viewer, told("mine"), **headers)[0] == 403
        for method in ("POST", "DELETE", "PATCH", "OPTIONS"):
            assert put(viewer, told("mine"), method=method)[0] == 405
        for path in ("data/session.json", "data/0/index.json", "app.js", "data/0/score.json"):
            assert put(viewer, told("mine"), path=path)[0] == 405
        assert not file.exists()
        assert put(viewer, told("mine"), Origin=f"http://{own}")[0] == 200
    assert [note["verdict"] for note in read_verdicts(file)] == ["mine"]
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["anna.json"]


@pytest.mark.parametrize(
    "body",
    [
        b"", b"[]", b"nonsense", b"[" * 100_000, {"format": "flgpr-notes", "version": 2, "notes": []},
        told("bush"), {**told("mine"), "notes": [{"alarm_id": 3}]}, {**told("mine"), "notes": "many"},
        {**told("mine"), "notes": [told("mine")["notes"][0]] * 2},
        {**told("mine"), "notes": [{"alarm_id": "a", "x": 1e300}]},
        b"x" * (16 * 2**20 + 1),
    ],
    ids=lambda body: str(body)[:30],
)  # fmt: skip
def test_nonsense_is_refused_and_the_file_stays(serving, result, tmp_path, body):
    file = tmp_path / "anna.json"
    with serving([result], verdicts=file) as viewer:
        assert put(viewer, told("mine"))[0] == 200
        before = file.read_bytes()
        status, words = put(viewer, body)
        assert status in (409, 413)
        assert "Traceback" not in words
        assert file.read_bytes() == before


def test_a_file_that_somebody_else_changed_is_not_overwritten(serving, result, tmp_path):
    file = tmp_path / "both.json"
    with serving([result], verdicts=file) as one, serving([result], verdicts=file) as two:
        _, words = put(one, told("mine"))
        seen = json.loads(words)["sha256"]
        status, words = put(two, told("clutter"))
        assert status == 409
        assert "changed by somebody else" in words
        assert put(two, told("clutter", before=seen))[0] == 200
    assert read_verdicts(file)[0]["verdict"] == "clutter"


def test_a_place_in_the_result_or_another_file_is_refused(result, tmp_path):
    (tmp_path / "other.json").write_text('{"format": "flgpr-score"}')
    cases = {
        result / "anna.json": "outside of the result",
        result / "view" / "anna.json": "outside of the result",
        tmp_path / "none" / "anna.json": "folder that exists",
        tmp_path / "other.json": "not verdicts of `flgpr.view`",
    }
    for place, words in cases.items():
        with pytest.raises(ValueError, match=words):
            Viewer([result], verdicts=place)
        ran = CliRunner().invoke(
            app, ["view", str(result), "--no-browser", "--verdicts", str(place)]
        )
        assert (ran.exit_code, ran.output.count("\n")) == (2, 1)
    assert (tmp_path / "other.json").read_text() == '{"format": "flgpr-score"}'


def judge(one, keys):
    """Give the alarms verdicts in the order of their confidence, and wait for the file."""
    for key in keys:
        one.page.keyboard.press("n")
        if key:
            one.page.keyboard.press(key)
    one.until("/saved in/.test(document.getElementById('notes-state').textContent)")
    one.page.wait_for_timeout(400)


@pytest.mark.slow("a browser draws every page")
def test_two_analysts_judge_and_a_third_goes_on(watch, serving, result, tmp_path):
    before = bytes_of(result)
    anna = tmp_path / "anna.json"
    ben = tmp_path / "ben.json"
    with serving([result], verdicts=anna) as viewer:
        one = watch(viewer)
        assert one.text("#notes-state") == "verdicts are kept in anna.json"
        judge(one, ["y", "y", "r"])
        one.page.fill("#note", "tyre")
        one.until("document.getElementById('notes-state').textContent.startsWith('3 notes saved')")
        one.page.wait_for_timeout(400)
        _, exported = one.saved("#export-notes")
    notes = {note["alarm_id"]: note for note in read_verdicts(anna)}
    assert {name: note["verdict"] for name, note in notes.items()} == {
        "a": "mine",
        "b": "mine",
        "c": "clutter",
    }
    assert notes["c"]["text"] == "tyre"
    assert (notes["a"]["x"], notes["a"]["y"]) == (0.1, 3.0)
    with serving([result], verdicts=ben) as viewer:
        two = watch(viewer)
        assert "mine" not in two.text("#rows")  # judges independently
        judge(two, ["y", "r"])
    assert bytes_of(result) == before
    pair, only_anna, only_ben = agree([anna, ben])["anna", "ben"]
    assert (pair.n, pair.agreed, only_anna, only_ben) == (2, 1, 1, 0)
    with serving([result], verdicts=anna) as viewer:  # goes on with what the first left
        three = watch(viewer)
        assert three.text("#rows").count("mine") == 2
        judge(three, ["u"])
    assert {note["alarm_id"]: note["verdict"] for note in read_verdicts(anna)}["a"] == "unsure"
    saved = tmp_path / "exported.json"
    saved.write_bytes(exported)
    with serving(
        [result], verdicts=tmp_path / "carl.json"
    ) as viewer:  # or with what the first exported
        four = watch(viewer)
        four.page.set_input_files("#load-notes", saved)
        four.until("document.getElementById('notes-state').textContent.startsWith('3 notes saved')")
        assert four.text("#rows").count("mine") == 2
        four.page.wait_for_timeout(300)
    assert len(read_verdicts(tmp_path / "carl.json")) == 3


@pytest.mark.slow("a browser draws every page")
def test_verdicts_on_another_result_are_kept_and_not_shown(watch, serving, result, tmp_path):
    manifest = json.loads((result / "manifest.json").read_text())
    other = {
        "result": "result (small)",
        "result_sha256": "ff" * 32,
        "detection": "main",
        "alarm_id": "a",
    }
    other["verdict"] = "mine"
    own = other | {"result_sha256": manifest["identity"], "alarm_id": "b", "verdict": "clutter"}
    file = tmp_path / "anna.json"
    file.write_text(json.dumps({"format": "flgpr-notes", "version": 1, "notes": [other, own]}))
    with serving([result], verdicts=file) as viewer:
        one = watch(viewer)
        assert one.text("#rows").count("clutter") == 1
        assert "mine" not in one.text("#rows")
        judge(one, ["", "", "y"])
    assert sorted(note["verdict"] for note in read_verdicts(file)) == ["clutter", "mine", "mine"]


@pytest.mark.slow("a browser draws every page")
def test_a_page_that_cannot_save_says_so(watch, serving, result, tmp_path):
    file = tmp_path / "anna.json"
    with serving([result], verdicts=file) as viewer:
        one = watch(viewer)
        file.write_text(json.dumps(told("mine")))
        one.page.keyboard.press("n")
        one.page.keyboard.press("y")
        one.until("document.getElementById('notes-state').classList.contains('missed')")
        assert "changed by somebody else" in one.text("#notes-state")
        one.errors.clear()  # the browser's own line on the answer 409
    assert file.read_text() == json.dumps(told("mine"))

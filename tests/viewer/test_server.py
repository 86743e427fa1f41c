import contextlib
import http.client
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.door import Listed
from flgpr.json_text import json_with_digest, parse_with_digest
from flgpr.store import sample_lane, sha256
from flgpr.viewer import Viewer
from flgpr.viewer.guard import SECURITY_HEADERS, is_loopback
from flgpr.viewer.session import LiveFile, ResultFiles, ViewError

ROUTES = [
    "", "app.js", "app.css", "icon.svg", "data/session.json", "data/live", "data/0/index.json", "data/0/score.json",
    "data/0/tile/0/0/0", "data/0/evidence/0/0", "data/9/index.json", "nowhere",
    "data/0/map.zip",
]  # fmt: skip

ANCHOR = """
crs = "EPSG:4326"
accuracy = 0.02
azimuth_deg = 30.0
azimuth_accuracy_deg = 0.1
[[point]]
lane = [0.0, 0.0]
longitude = 11.0
latitude = 48.0
"""


def ask(viewer, path, method="GET", token=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=10)
    connection.putrequest(
        method, f"/{viewer.token if token is None else token}/{path}", skip_host="host" in headers
    )
    for name, value in headers.items():
        for one in [value] if isinstance(value, str) else value:
            connection.putheader(name.replace("_", "-"), one)
    connection.endheaders()
    answer = connection.getresponse()
    answer.body = answer.read()
    connection.close()
    return answer


@pytest.mark.parametrize("path", ROUTES)
def test_every_route_refuses_strangers(shown, path):
    for token in ("wrong", shown.token[:-1], shown.token + "x", ""):
        assert ask(shown, path, token=token).status == 403
    own = f"127.0.0.1:{shown.port}"
    for host in (
        "evil.example",
        f"evil.example:{shown.port}",
        "127.0.0.1",
        "127.0.0.1:1",
        f"x@{own}",
        "",
    ):
        assert ask(shown, path, host=host).status == 403
    assert ask(shown, path, host=[own, "evil.example"]).status in (400, 403)
    for origin in ("http://evil.example", "null", "https://" + own, "http://127.0.0.1:1", ""):
        assert ask(shown, path, origin=origin).status == 403
    assert ask(shown, path, sec_fetch_site="cross-site", sec_fetch_mode="no-cors").status == 403


@pytest.mark.parametrize("path", ROUTES)
@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH"])
def test_only_get_and_head_are_answered(shown, path, method):
    answer = ask(shown, path, method)
    assert (answer.status, answer.getheader("allow")) == (405, "GET, HEAD")
    assert ask(shown, path, method, token="wrong").status == 403


def headers_of(answer):
    """All but the second in which it was given."""
    return [(name, value) for name, value in answer.getheaders() if name != "date"]


@pytest.mark.parametrize("path", ROUTES)
@pytest.mark.parametrize("token", [None, "wrong"])
def test_head_is_answered_as_get_without_the_body(shown, path, token):
    whole = ask(shown, path, token=token)
    head = ask(shown, path, "HEAD", token=token)
    assert (head.status, head.body) == (whole.status, b"")
    assert headers_of(head) == headers_of(whole)
    assert int(head.getheader("content-length")) == len(whole.body) > 0
    assert {name: head.getheader(name) for name in SECURITY_HEADERS} == SECURITY_HEADERS


@pytest.mark.parametrize("path", ROUTES)
def test_every_answer_forbids_other_origins(shown, path):
    answer = ask(shown, path, origin=f"http://127.0.0.1:{shown.port}")
    assert answer.status == (
        404 if path in ("data/9/index.json", "nowhere", "data/live", "data/0/map.zip") else 200
    )
    policy = answer.getheader("content-security-policy")
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
    assert answer.getheader("cache-control") == "no-store"
    assert answer.getheader("referrer-policy") == "no-referrer"
    assert answer.getheader("access-control-allow-origin") is None


def test_localhost_is_this_machine_too(shown):
    assert ask(shown, "", host=f"localhost:{shown.port}").status == 200
    assert all(is_loopback(host) for host in ("127.0.0.1", "::1", "localhost"))
    assert not any(is_loopback(host) for host in ("0.0.0.0", "192.168.1.2", "example.org"))


@pytest.mark.parametrize(
    "path",
    ["../../etc/passwd", "data/0/../../../../etc/passwd", "%2e%2e/%2e%2e/etc/passwd", "static/../server.py",
     "data/0/tile/0/0/-1", "data/0/tile/999/0/0", "data/0/tile/0/9/0", "data/0/tile/0/0/9", "data/0/evidence/9/0",
     "data/0/evidence/0/999999999999999999999"],
)  # fmt: skip
def test_what_is_not_there_is_not_found(shown, path):
    assert ask(shown, path).status == 404


def test_another_token_each_time(demo):
    tokens = set()
    for _ in range(5):
        viewer = Viewer([demo[0].folder])
        tokens.add(viewer.token)
        viewer._socket.close()
    assert len(tokens) == 5
    assert all(len(token) >= 32 for token in tokens)


def test_remote_addresses_need_a_flag_and_warn(demo, serving):
    with pytest.raises(ValueError, match=r"host must be of this machine .* got 0\.0\.0\.0"):
        Viewer([demo[0].folder], host="0.0.0.0")
    with pytest.warns(UserWarning, match="whoever reaches it"):
        remote = Viewer([demo[0].folder], host="0.0.0.0", allow_remote=True)
    with serving(remote) as open_viewer:
        assert ask(open_viewer, "").status == 200
        assert ask(open_viewer, "", host=f"192.168.7.7:{open_viewer.port}").status == 200
        assert ask(open_viewer, "", host=f"rebound.example:{open_viewer.port}").status == 403


def test_tiles_are_the_run_view_in_decibels(shown, demo):
    index = json.loads(ask(shown, "data/0/index.json").body)
    view = demo[0].detections[0].view
    layer = next(i for i, one in enumerate(index["layers"]) if one["detection"] == "main")
    tile = np.frombuffer(ask(shown, f"data/0/tile/{layer}/0/0").body, "<f2").reshape(view.shape[2:])
    expected = 20 * np.log10(view.values[0, 0])
    np.testing.assert_allclose(tile, expected, atol=1 / 32)
    assert np.array_equal(np.isnan(tile), np.isnan(expected))
    assert index["layers"][layer]["polarization"] == str(view["polarization"].values[0])
    assert (index["grid"]["x"], index["grid"]["y"]) == (view["x"].values[0], view["y"].values[0])


def test_score_names_its_result(shown, demo, tmp_path, serving):
    assert json.loads(ask(shown, "data/0/score.json").body)["kinds"] == ["metal", "plastic"]
    copy = tmp_path / "result"
    shutil.copytree(demo[0].folder, copy)
    stored = json.loads((copy / "view" / "score.json").read_text())
    with serving([copy]) as viewer:
        stored["content"]["detections"]["main"]["label"][0] = "detection"
        (copy / "view" / "score.json").write_text(json.dumps(stored))
        answer = ask(viewer, "data/0/score.json")
        assert answer.status == 500
        assert "differs" in json.loads(answer.body)["error"]
        (copy / "view" / "score.json").unlink()
        assert json.loads(ask(viewer, "data/0/score.json").body) is None


def test_altered_files_are_never_shown(demo, tmp_path, serving):
    copy = tmp_path / "result"
    shutil.copytree(demo[0].folder, copy)
    with serving([copy]) as viewer:
        assert ask(viewer, "data/0/tile/0/0/0").status == 200
        layer = copy / "view" / viewer._sources[0].index["layers"][0]["levels"][0]["file"]
        data = bytearray(layer.read_bytes())
        data[100] ^= 1
        layer.write_bytes(data)
        answer = ask(viewer, "data/0/tile/0/0/0")
        assert answer.status == 500
        assert "differs from what was written" in json.loads(answer.body)["error"]
    (copy / "view" / "index.json").write_text("{}")
    with pytest.raises(ValueError, match=r"index\.json differs"):
        Viewer([copy])


def test_no_name_leads_out_of_the_folder(demo, tmp_path):
    copy = tmp_path / "result"
    shutil.copytree(demo[0].folder, copy)
    secret = b"secret"
    (tmp_path / "secret").write_bytes(secret)
    layer = copy / "view" / "layers" / "main.0.0.0.f16"
    layer.unlink()
    layer.symlink_to(tmp_path / "secret")
    source = ResultFiles(copy)
    listed = source._files.listed
    listed["view/layers/main.0.0.0.f16"] = listed["view/../../secret"] = Listed(
        (sha256(secret),), (len(secret),)
    )
    number = next(i for i, one in enumerate(source.index["layers"]) if one["detection"] == "main")
    with pytest.raises(ViewError, match="must be a regular file, got a symbolic link"):
        source.tile(number, 0, 0)
    source.index["layers"][number]["levels"][0]["file"] = "../../secret"
    with pytest.raises(ViewError, match="must be relative and stay inside"):
        source.tile(number, 0, 0)


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_serve_tells_the_address_and_ends_at_an_interrupt(demo):
    code = "import sys; from flgpr.viewer import serve; serve(sys.argv[1], open_browser=False)"
    with subprocess.Popen(
        [sys.executable, "-u", "-c", code, str(demo[0].folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        url = process.stdout.readline().strip()
        for _ in range(1200):
            with contextlib.suppress(OSError):
                page = urllib.request.urlopen(url).read()
                break
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert page.startswith(b"<!doctype html>")
    assert (out, err, process.returncode) == ("", "", 0)


def test_a_run_shows_its_track(serving):
    with serving([sample_lane() / "run.zarr"]) as viewer:
        index = json.loads(ask(viewer, "data/0/index.json").body)
    assert index["layers"] == []
    assert len(index["scans"]["y"]) == 3
    assert index["run"]["tones"] == 142


@pytest.mark.parametrize(
    ("name", "match"),
    [("nothing", "nothing to view"), ("empty", "folder, a run, a recording or a score")],
)
def test_what_cannot_be_viewed_is_named(tmp_path, name, match):
    (tmp_path / "empty").mkdir()
    with pytest.raises((ValueError, FileNotFoundError), match=match):
        Viewer([tmp_path / name])


def test_live_events_come_line_by_line(tmp_path, serving):
    file = tmp_path / "live.jsonl"
    with serving([], live=tmp_path) as viewer:
        assert json.loads(ask(viewer, "data/live?after=0").body)["events"] == []
        file.write_text('{"event":"scan","scan":0}\nnot json\n{"event":"al')
        first = json.loads(ask(viewer, "data/live?after=0").body)
        assert [one["event"] for one in first["events"]] == ["scan"]
        assert first["bad"] == 1
        with file.open("a") as lines:
            lines.write('arm","x":1.0}\n')
        second = json.loads(ask(viewer, f"data/live?after={first['next']}").body)
        assert second["events"] == [{"event": "alarm", "x": 1.0}]
        file.write_text('{"event":"note"}\n')
        again = json.loads(ask(viewer, f"data/live?after={second['next']}").body)
        assert again["restarted"]
        assert again["events"] == [{"event": "note"}]
        assert ask(viewer, "data/live?after=-1").status == 404
    lines = ('{"event":"view","halves":"' + "A" * 1000 + '"}\n') * 9000
    file.write_text(lines)
    with serving([], live=tmp_path) as viewer:
        offset = 0
        count = 0
        more = True
        while more:
            answer = json.loads(ask(viewer, f"data/live?after={offset}").body)
            offset = answer["next"]
            count = count + len(answer["events"])
            more = answer["more"]
    assert (count, offset) == (9000, len(lines))
    named, found = (LiveFile(path).after(0) for path in (file, tmp_path))
    assert named | {"age": 0, "now": 0} == found | {"age": 0, "now": 0}
    assert abs(time.time() - found["now"]) < 3600
    os.utime(file, (0, 0))
    assert LiveFile(file).after(0)["age"] > 1e6
    assert LiveFile(tmp_path / "other.jsonl").after(5) == {
        "events": [], "next": 0, "bad": 0, "restarted": True, "more": False, "age": None,
    }  # fmt: skip


@pytest.mark.slow("runs in processes of its own")
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux")
def test_the_server_needs_little_memory(demo):
    """The limit of the viewer's design is 300 MB; the figure is the peak of a process of its own."""
    code = """
import sys, threading, time, urllib.request
from flgpr.viewer import Viewer
viewer = Viewer([sys.argv[1]])
thread = threading.Thread(target=viewer.run); thread.start()
while not viewer._server.started: time.sleep(0.01)
for path in ("", "data/0/index.json", "data/0/score.json", "data/0/tile/0/0/0", "data/0/evidence/0/0"):
    urllib.request.urlopen(viewer.url + path).read()
viewer.stop(); thread.join()
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""
    done = subprocess.run(
        [sys.executable, "-c", code, str(demo[0].folder)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert int(done.stdout) < 300 * 1024


def test_an_anchor_ties_what_is_shown_to_the_earth(serving, demo, tmp_path):
    (tmp_path / "anchor.toml").write_text(ANCHOR)
    with serving([demo[0].folder], anchor=tmp_path / "anchor.toml") as viewer:
        tied = json.loads(ask(viewer, "data/session.json").body)["georeference"]
    assert tied["latitude"] == pytest.approx(48.0, abs=1e-6)
    assert tied["longitude"] == pytest.approx(11.0, abs=1e-6)
    assert tied["azimuth"] == pytest.approx(30.0, abs=1e-6)
    with serving([demo[0].folder]) as viewer:
        assert json.loads(ask(viewer, "data/session.json").body)["georeference"] is None


@pytest.mark.slow("runs in processes of its own")
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux")
def test_the_command_needs_little_memory_too(demo):
    """Measured where the user is: `flgpr view` must not load what only detection needs."""
    command = [sys.executable, "-u", "-m", "flgpr", "view", str(demo[0].folder), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            url = process.stdout.readline().strip()
            for _ in range(1200):
                with contextlib.suppress(OSError):
                    urllib.request.urlopen(url + "data/0/index.json").read()
                    break
                time.sleep(0.05)
            peak = int(
                Path(f"/proc/{process.pid}/status").read_text().split("VmHWM:")[1].split()[0]
            )
            loaded = Path(f"/proc/{process.pid}/maps").read_text()
        finally:
            process.terminate()
    assert peak < 300 * 1024
    assert "llvmlite" not in loaded


@pytest.mark.parametrize(
    ("arguments", "words"), [([], "got none"), (["nothing"], "nothing to view at nothing")]
)
def test_the_command_names_what_is_wrong(arguments, words):
    done = CliRunner().invoke(app, ["view", *arguments])
    assert done.exit_code == 2
    assert words in done.output


def forged(folder, change):
    """Change the index of a view, and make the digests right again."""
    path = folder / "view" / "index.json"
    index = json.loads(path.read_text())
    change(index)
    path.write_text(json.dumps(index))
    manifest = parse_with_digest((folder / "manifest.json").read_bytes())
    entries = {name: value for name, value in manifest.items() if name != "sha256"}
    entries["files"]["view/index.json"] = sha256(path.read_bytes())
    entries.get("sizes", {})["view/index.json"] = path.stat().st_size
    (folder / "manifest.json").write_bytes(json_with_digest(entries))


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda index: index.update(layers=5), "layers: input should be a valid list, got 5"),
        (
            lambda index: index.update(layers=[3]),
            r"layers\.0: input should be a valid dictionary .*got 3",
        ),
        (
            lambda index: index.update(tile_rows=16.5),
            r"tile_rows: input should be a valid integer, got 16\.5",
        ),
        (
            lambda index: index.update(tile_rows=0),
            "grid and tile_rows must be given for layers",
        ),
        (
            lambda index: index.update(tile_rows=True),
            "tile_rows: input should be a valid integer, got True",
        ),
        (lambda index: index.update(detections=None), "detections: Input should be a valid list"),
        (lambda index: index.update(grid=None), "grid and tile_rows must be given for layers"),
        (
            lambda index: index["grid"].update(nx="9"),
            r"grid\.nx: input should be a valid integer, got '9'",
        ),
        (
            lambda index: index["grid"].update(nx=10**40),
            r"grid\.nx: input should be less than .* got 1000",
        ),
        (lambda index: index.update(title=None), "title: Input should be a valid string"),
        (lambda index: index.update(lane={"x_min": 0}), r"lane\.x_max: is missing"),
        (
            lambda index: index["lane"].update(x_min=True),
            r"lane\.x_min: input should be a valid number, got True",
        ),
        (lambda index: index["layers"][0].pop("levels"), r"layers\.0\.levels: is missing"),
        (
            lambda index: index["layers"][0]["levels"][0].update(rows=-1),
            "levels.0.rows: input should be greater than",
        ),
        (
            lambda index: index["layers"][0]["levels"][0].update(file=7),
            "levels.0.file: input should be a valid string, got 7",
        ),
        (
            lambda index: index["detections"][0]["evidence"].update(start=[0, 9, 3]),
            r"evidence\.start: must ascend",
        ),
        (
            lambda index: index.update(georeference=[1]),
            "georeference: Input should be a valid dictionary",
        ),
    ],
)
def test_a_forged_index_is_refused_with_a_sentence(change, rule, demo, tmp_path):
    copy = tmp_path / "result"
    shutil.copytree(demo[0].folder, copy)
    Viewer([copy])._socket.close()
    forged(copy, change)
    with pytest.raises(ViewError, match=rf"view/index\.json cannot be shown: .*{rule}"):
        Viewer([copy])


@pytest.mark.parametrize("digits", [40, 5000])
@pytest.mark.parametrize(
    "path",
    ["data/{}/index.json", "data/0/tile/{}/0/0", "data/0/tile/0/0/{}", "data/0/evidence/0/{}",
     "data/0/raw/bscan?pair={}", "data/live?after={}"],
)  # fmt: skip
def test_a_number_of_very_many_digits_is_refused_with_a_sentence(shown, path, digits):
    answer = ask(shown, path.format("7" * digits))
    assert answer.status == 400
    assert b"numbers of an address have fewer than 30 digits" in answer.body


def test_what_no_check_foresaw_is_no_error_of_the_server(shown, monkeypatch):
    """A file of another form is answered with a sentence, and leaves no traceback."""
    for error in (TypeError("a"), KeyError("b"), OverflowError("c"), AttributeError("d")):
        monkeypatch.setattr(ResultFiles, "tile", mock.Mock(side_effect=error))
        answer = ask(shown, "data/0/tile/0/0/0")
        assert answer.status == 422
        assert "must have the form of its kind" in json.loads(answer.body)["error"]

"""``flgpr view`` hands its options to the viewer, and loads what is numerical on demand."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.raw_run import RawRun
from flgpr.store import sample_lane


@pytest.fixture
def served(monkeypatch):
    """Arguments that the viewer was served with."""
    calls = []

    def serve(*positional, **named):
        calls.append((positional, named))

    monkeypatch.setattr("flgpr.viewer.serve", serve)
    return calls


def test_options_arrive_at_the_viewer(served):
    words = ["view", "a", "b", "--port", "8123", "--no-browser", "--map", "road.tif"]
    done = CliRunner().invoke(app, [*words, "--verdicts", "anna.json"])
    assert done.exit_code == 0, done.output
    [(positional, named)] = served
    paths, host, port, opens_browser, allow_remote, *_ = positional
    assert paths == [Path("a"), Path("b")]
    assert (host, port, opens_browser, allow_remote) == ("127.0.0.1", 8123, False, False)
    assert Path(named["backdrop"]) == Path("road.tif")
    assert Path(named["verdicts"]) == Path("anna.json")


def test_raw_data_of_a_run_are_opened_when_a_page_asks(served):
    CliRunner().invoke(app, ["view", "a"])
    [(_, named)] = served
    assert isinstance(named["raw"](sample_lane() / "run.zarr"), RawRun)


@pytest.mark.parametrize("port", ["-1", "65536", "web"])
def test_a_port_that_does_not_exist_is_refused(port, served):
    assert CliRunner().invoke(app, ["view", "a", "--port", port]).exit_code == 2
    assert served == []


def test_a_folder_that_holds_nothing_to_show_is_refused_in_a_line(tmp_path):
    done = CliRunner().invoke(app, ["view", str(tmp_path), "--no-browser"])
    assert done.exit_code == 2
    assert done.output.startswith("error: ")
    assert done.output.count("\n") == 1
    assert str(tmp_path) in done.output

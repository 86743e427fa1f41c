"""What a run, a file or a model holds, by command."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.info import info
from flgpr.store import sample_lane

RUN = str(sample_lane() / "run.zarr")


def call(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_info_says_it_in_words_and_as_json(tmp_path):
    words = call("info", RUN, "--recipe", "demo", "--plot", tmp_path / "info.png").stdout
    for text in (
        "3 over 1.00 m",
        "142 from 0.4425 to 1.5 GHz",
        "none missing",
        "unambiguous to 40.0 m",
        "looks",
    ):
        assert text in words
    assert (tmp_path / "info.png").read_bytes().startswith(b"\x89PNG")
    told = json.loads(call("info", RUN, "--json").stdout)
    assert told["pairs"] == 32
    assert told["unambiguous_path_m"] == pytest.approx(39.97, abs=0.01)


def test_info_tells_which_recipes_fit_and_why_others_do_not():
    told = json.loads(call("info", RUN, "--recipes", "--json").stdout)["recipes"]
    assert told["demo"] == told["miniature"] == []
    assert any("echoes repeat after 39.97 m of path" in one for one in told["wang2007"])
    words = call("info", RUN, "--recipe", "wang2007").stdout
    assert "wang2007: image.subbands.F4 must lie in the run's band" in words
    assert "recipe for RUN" in words
    assert "demo fits" in call("info", RUN, "--recipe", "demo").stdout


def test_a_mapping_is_drafted_for_files_that_need_one(tmp_path):
    with pytest.raises(ValueError, match=r"a mapping is drafted for files, got .*run\.zarr"):
        info(RUN, mapping=tmp_path / "m.toml")
    (tmp_path / "alarms.csv").write_text("x,y,confidence\n0,1,2\n")
    with pytest.raises(ValueError, match="needs no mapping, none is written to"):
        info(tmp_path / "alarms.csv", mapping=tmp_path / "m.toml")
    assert not (tmp_path / "m.toml").exists()
    np.savez(tmp_path / "a.npz", s=np.ones((3, 2, 5), complex))
    with pytest.raises(FileNotFoundError, match="the folder of the output must exist"):
        info(tmp_path / "a.npz", mapping=tmp_path / "none" / "m.toml")
    shown = call("info", tmp_path / "a.npz", "--mapping", tmp_path / "m.toml")
    assert shown.exit_code == 0, shown.output
    text = (tmp_path / "m.toml").read_text()
    count = text.count('?"')
    assert f"wrote {tmp_path / 'm.toml'}, with {count} question mark" in shown.stdout
    assert text == info(tmp_path / "a.npz").mapping

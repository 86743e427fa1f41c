"""The ladder of oracles, evidence/ladder.py, on numbers that are known."""

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Grid
from flgpr.proving_ground import load_ground
from flgpr.proving_ground.oracle import divided_by_rms, inverse_covariance
from flgpr.simulate import Simulator, draw_world
from submitted import write_ground

pytestmark = pytest.mark.slow("simulates bodies of a lane")

SCRIPT = Path(__file__).parents[2] / "evidence" / "ladder.py"
SIZE = 6


@pytest.fixture(scope="module")
def ladder():
    spec = importlib.util.spec_from_file_location("ladder", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def bare(ladder):
    """Ground of 40 x 40 places whose clutter is correlated, all seen from one distance."""
    rng = np.random.default_rng(2)
    grid = Grid(0.0, 0.0, 40, 40, 0.2, 0.2)
    mixing = np.eye(SIZE) + 0.95 * np.ones((SIZE, SIZE))
    noise = rng.normal(size=(1600, SIZE, 2)) @ [1, 1j]
    chip = (noise @ mixing).astype(np.complex64)
    ground = ladder.BareGround.__new__(ladder.BareGround)
    ground.grid = grid
    ground.area = 64.0
    ground.place = np.arange(1600)
    ground.ahead = np.full(1600, 8.5)
    full = inverse_covariance(chip)
    diagonal = np.diag(1 / (np.abs(chip) ** 2).mean(axis=0))
    ground.inverses = {"full": {8: full}, "diagonal": {8: diagonal}}
    ground.chips = {
        "full": divided_by_rms(chip, full),
        "diagonal": divided_by_rms(chip, diagonal),
    }
    return ground


def echoes(ladder, own, other):
    """The mine's own echo in one look, and the same other one for all candidates."""
    count = len(ladder.candidates())
    return np.concatenate([own[None, None], np.repeat(other[None, None], count, axis=1)], axis=1)


def test_a_mine_that_clutter_does_not_resemble_is_found_only_by_who_knows_the_clutter(ladder, bare):
    own = np.array([1, -1, 1, -1, 1, -1], dtype=complex)  # clutter is alike in all values
    chip = 6 * own[None]
    found = ladder.rates(bare, np.array([8.5]), chip, echoes(ladder, own, own))
    assert found["oracle"] == 0.0
    assert set(found) == set(ladder.RUNGS)
    weak = ladder.rates(bare, np.array([8.5]), 2.0 * own[None] + 3.0, echoes(ladder, own, own))
    assert weak["oracle"] < weak["white clutter"]
    assert weak["flat ground"] == weak["oracle"] == weak["one look"]
    assert weak["depth and soil unknown"] == weak["body unknown"] == weak["oracle"]


def test_who_looks_for_another_echo_finds_less(ladder, bare):
    own = np.array([1, -1, 1, -1, 1, -1], dtype=complex)
    other = np.array([1, 1, -1, -1, 1, -1], dtype=complex)
    found = ladder.rates(bare, np.array([8.5]), 3 * own[None], echoes(ladder, own, other))
    assert found["oracle"] < found["metal signatures"]
    assert found["metal signatures"] == found["depth and soil unknown"] == found["flat ground"]


def test_an_echo_of_the_wrong_sign_is_lost_to_who_knows_the_phase(ladder, bare):
    own = np.array([1, -1, 1, -1, 1, -1], dtype=complex)
    found = ladder.rates(bare, np.array([8.5]), -6 * own[None], echoes(ladder, own, own))
    assert found["oracle"] == 0.0
    assert found["phases"] > 0.5


def test_a_candidate_lies_where_the_mine_lies_and_is_seen_from_the_same_poses(ladder):
    ground = load_ground(True).chosen_tiers("as-found")[0]
    lane = next(lane for lane in ground.lanes.values() if lane.part == "test")
    mine = draw_world(lane.scene, lane.seed).targets[0]
    for candidate in (ladder.candidates()[0], ladder.candidates()[-1]):
        scene = ladder.candidate_scene(lane.scene, mine, candidate)
        (target,) = scene.targets
        assert (target.x, target.y) == (mine.x, mine.y)
        assert not draw_world(scene, lane.seed).holes
    assert target.kind == "metal"
    assert (target.depth, scene.soil.permittivity) == (ladder.DEPTHS[-1], ladder.SOILS[-1][0])
    own = Simulator(lane.scene, lane.sensor, lane.seed)
    np.testing.assert_array_equal(Simulator(scene, lane.sensor, lane.seed).pose, own.pose)


def test_false_alarms_at_a_pd_and_their_intervals(ladder):
    far = np.array([0.0, 0.01, 0.02, 0.5, np.inf])
    assert ladder.far_at(far, 0.5) == 0.02
    assert ladder.far_at(far, 0.7) == 0.5
    table = pd.DataFrame({"tier": "rough", "kind": "metal", "oracle": far, "phases": far / 2})
    rows = ladder.summary(table).set_index(["group", "rung"])
    row = rows.loc[("metal", "oracle")]
    assert (row["found"], row["mines"], row["far_at_0.5"]) == (3, 5, 0.02)
    assert row["low_0.5"] <= row["far_at_0.5"] <= row["high_0.5"]
    assert row["pd_low"] < 0.6 < row["pd_high"]
    assert ("plastic", "oracle") not in rows.index
    assert ladder.name_of(SimpleNamespace(tier="")) == "ground"


def test_a_site_that_the_ground_does_not_have_is_refused(ladder, tmp_path, capsys):
    write_ground(tmp_path)
    (tmp_path / "ground.json").write_text('{"ground": "tiny-3", "quick": false}')
    with pytest.raises(SystemExit):
        ladder.main([str(tmp_path), str(tmp_path / "out"), "--site", "moon"])
    assert "--site must be one of sand, got moon" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()

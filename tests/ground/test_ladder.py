"""The ladder of oracles, evidence/ladder.py, on numbers that are known."""

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Grid
from flgpr.proving_ground import load_ground
from flgpr.simulate import Simulator, draw_world
from flgpr_ground.oracle import (
    cleaned_lane,
    divided_by_rms,
    inverse_covariance,
    looks_at_mines,
)
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
    ground = ladder.rungs.BareGround.__new__(ladder.rungs.BareGround)
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
    count = len(ladder.rungs.candidates())
    return np.concatenate([own[None, None], np.repeat(other[None, None], count, axis=1)], axis=1)


def test_a_mine_that_clutter_does_not_resemble_is_found_only_by_who_knows_the_clutter(ladder, bare):
    own = np.array([1, -1, 1, -1, 1, -1], dtype=complex)  # clutter is alike in all values
    chip = 6 * own[None]
    found = ladder.rungs.body_rates(bare, np.array([8.5]), chip, echoes(ladder, own, own))
    assert found["oracle"] == 0.0
    by_position = {f"{hidden} unknown" for hidden in ladder.rungs.HIDDEN}
    assert set(found) | by_position == set(ladder.RUNGS)
    assert not set(found) & by_position
    weak = ladder.rungs.body_rates(
        bare, np.array([8.5]), 2.0 * own[None] + 3.0, echoes(ladder, own, own)
    )
    assert weak["oracle"] < weak["white clutter"]
    assert weak["flat ground"] == weak["oracle"] == weak["one look"]
    assert weak["depth and soil unknown"] == weak["body unknown"] == weak["oracle"]


def test_who_looks_for_another_echo_finds_less(ladder, bare):
    own = np.array([1, -1, 1, -1, 1, -1], dtype=complex)
    other = np.array([1, 1, -1, -1, 1, -1], dtype=complex)
    found = ladder.rungs.body_rates(
        bare, np.array([8.5]), 3 * own[None], echoes(ladder, own, other)
    )
    assert found["oracle"] < found["metal signatures"]
    assert found["metal signatures"] == found["depth and soil unknown"] == found["flat ground"]


def test_an_echo_of_the_wrong_sign_is_lost_to_who_knows_the_phase(ladder, bare):
    own = np.array([1, -1, 1, -1, 1, -1], dtype=complex)
    found = ladder.rungs.body_rates(bare, np.array([8.5]), -6 * own[None], echoes(ladder, own, own))
    assert found["oracle"] == 0.0
    assert found["phases"] > 0.5


def test_a_candidate_lies_where_the_mine_lies_and_is_seen_from_the_same_poses(ladder):
    ground = load_ground(True).chosen_tiers("as-found")[0]
    lane = next(lane for lane in ground.lanes.values() if lane.part == "test")
    mine = draw_world(lane.scene, lane.seed).targets[0]
    candidates = ladder.rungs.candidates()
    for candidate in (candidates[0], candidates[-1]):
        scene = ladder.rungs.candidate_scene(lane.scene, mine, candidate)
        (target,) = scene.targets
        assert (target.x, target.y) == (mine.x, mine.y)
        assert not draw_world(scene, lane.seed).holes
    assert target.kind == "metal"
    assert (target.depth, scene.soil.permittivity) == (
        ladder.rungs.DEPTHS[-1],
        ladder.rungs.SOILS[-1][0],
    )
    own = Simulator(lane.scene, lane.sensor, lane.seed)
    np.testing.assert_array_equal(Simulator(scene, lane.sensor, lane.seed).pose, own.pose)


@pytest.fixture(scope="module")
def earth():
    """A test lane in earth as found, where mines lie in holes and tilted, and the ground is rough."""
    ground = load_ground().chosen_tiers("as-found")[0]
    return ground.lanes["as-found-earth-test-1"]


def echo(lane, scene=None):
    """Return what the bodies add to a scan."""
    scene = lane.scene if scene is None else scene
    return Simulator(scene, lane.sensor, lane.seed, errors=False).bodies(10)


def test_who_hides_nothing_has_the_echoes_of_the_lane(ladder, earth):
    scene = ladder.rungs.hidden_scene(earth.scene, earth.seed, "nothing")
    np.testing.assert_array_equal(echo(earth, scene), echo(earth))


def test_every_hidden_thing_changes_the_echoes_and_nothing_else_of_the_lane(ladder, earth):
    own = draw_world(earth.scene, earth.seed)
    mine = echo(earth)
    for hidden in ladder.rungs.HIDDEN:
        scene = ladder.rungs.hidden_scene(earth.scene, earth.seed, hidden)
        world = draw_world(scene, earth.seed)
        assert np.linalg.norm(echo(earth, scene) - mine) > 0.01 * np.linalg.norm(mine)
        assert (world.holes == own.holes) == (hidden != "hole")
        assert (world.targets == own.targets) == (hidden != "tilt")
        assert scene.surface.phase_screen == (hidden != "roughness")
        assert scene.grass.grown == scene.shadow.on == (hidden != "cover")
        assert world.objects == own.objects
        level = [target.model_copy(update={"tilt": 0.0}) for target in own.targets]
        assert [target.model_copy(update={"tilt": 0.0}) for target in world.targets] == level


def test_what_is_hidden_is_a_name_that_is_known(ladder, earth):
    with pytest.raises(ValueError, match=r"hidden must be one of hole, .* or nothing, got 'depth'"):
        ladder.rungs.hidden_scene(earth.scene, earth.seed, "depth")


def test_hidden_echoes_are_those_at_the_mines_look_by_look(ladder, tmp_path):
    ground = load_ground(True).chosen_tiers("as-found")[0]
    lane = next(lane for lane in ground.lanes.values() if lane.part == "test")
    few_scans = lane.scene.track.model_copy(update={"positions": (0.0, 2.0, 4.0, 6.0)})
    lane = replace(lane, scene=lane.scene.model_copy(update={"track": few_scans}))
    (tmp_path / "lanes").mkdir()
    lane.make(tmp_path / "lanes" / f"{lane.name}.zarr")
    setup = cleaned_lane(str(tmp_path), lane, "wang2007")
    mines = lane.truth_with_bodies().iloc[2:5]
    looks, own = looks_at_mines(setup, lane, mines)
    echoes = ladder.rungs.hidden_echoes(setup, lane, mines, ("nothing", "tilt"))
    assert echoes.shape == (len(looks.place), 2, own.shape[1])
    np.testing.assert_allclose(echoes[:, 0], own, atol=1e-4 * np.abs(own).max())
    assert np.abs(echoes[:, 1] - own).max() > 0.01 * np.abs(own).max()


def test_who_does_not_know_how_a_mine_lies_loses_what_the_echo_loses(ladder, bare):
    own = np.array([1, -1, 1, -1, 1, -1], dtype=complex)
    other = np.array([1, 1, -1, -1, 1, -1], dtype=complex)
    hidden = [own if name == "hole" else other for name in ladder.rungs.HIDDEN]
    found = ladder.rungs.rates(
        bare, ladder.rungs.POSITION_PART, np.array([8.5]), 3 * own[None], np.array([[own, *hidden]])
    )
    assert found["oracle"] == found["hole unknown"]
    assert found["oracle"] < found["tilt unknown"] == found["roughness unknown"]


def test_mines_that_a_rung_loses_are_counted_against_the_oracle(ladder):
    table = pd.DataFrame({
        "tier": "rough", "kind": ["metal"] * 5 + ["simulant"], "oracle": [0.0, 0.01, 0.02, 0.5, 0.5, 0.0],
        "tilt unknown": [0.0, 0.3, 0.3, 0.01, 0.5, 0.9],
    })  # fmt: skip
    row = ladder.paired(table).set_index(["group", "rung"]).loc[("metal", "tilt unknown")]
    assert (row["mines"], row["oracle"], row["lost"], row["gained"], row["p"]) == (5, 3, 2, 1, 1.0)
    assert row["share_low"] < 2 / 3 < row["share_high"]
    found, lost = ladder.page_tables(ladder.summary(table), ladder.paired(table)).split("\n\n")
    assert found.splitlines()[0] == "| knows | rough, mines of 5 | rough, metal of 5 |"
    assert found.splitlines()[2].startswith("| all but the phases | 3 (0.15 to 0.95) | 3 |")
    assert lost.splitlines()[0] == "| oracle | rough, mines: lost of 3 | rough, metal: lost of 3 |"
    assert lost.splitlines()[2].endswith(", +1; p = 1 | 2, +1 |")
    half = pd.concat([table, table.assign(tier="smooth", **{"tilt unknown": np.nan})])
    found, lost = ladder.page_tables(ladder.summary(half), ladder.paired(half)).split("\n\n")
    assert found.splitlines()[3].endswith(" |  |  |")  # not computed on the second tier
    assert "smooth" not in lost


def test_parts_of_a_site_are_read_together_if_they_are_of_the_same_lanes(ladder, tmp_path):
    files = {}
    for part in ladder.PARTS:
        files[part] = tmp_path / f"{part}.csv"
    bodies = pd.DataFrame({"target_id": ["b", "a"], "oracle": [0.1, 0.2], "phases": [0.0, 0.1]})
    bodies.to_csv(files["bodies"], index=False)
    assert list(ladder.read_site(files)) == list(bodies)
    other = pd.DataFrame(
        {"target_id": ["a", "b"], "oracle": [0.2, 0.1], "tilt unknown": [0.4, 0.3]}
    )
    other.to_csv(files["position"], index=False)
    assert ladder.read_site(files)["tilt unknown"].tolist() == [0.3, 0.4]
    other.assign(oracle=0.1).to_csv(files["position"], index=False)
    with pytest.raises(ValueError, match="the oracle must be the same in the two files of a site"):
        ladder.read_site(files)


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

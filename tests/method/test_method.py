"""The method on its page: the passes of a recipe, run alone, in blocks, in sections, and up to what a stage learns."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from flgpr.engine import Engine, PlannedPass, blocks_of, sum_accumulator
from flgpr.method.detection import rank_alarms
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import detect, detection_of, engine_of, passes_of
from flgpr.method.sections import Section, lane_threshold
from flgpr.recipe.schema import parse_recipe
from small_lane import LANE, small_recipe, small_run

ORDER = ["signature", "gain", "view", "alarms", "features"]


@pytest.fixture(scope="module")
def run():
    return small_run()


@pytest.fixture(scope="module")
def recipe():
    return parse_recipe(small_recipe())


@pytest.fixture(scope="module")
def setup(run, recipe):
    setup = ImagedRun(run, recipe, LANE)
    engine_of(setup).run()
    return setup


def test_the_demo_runs_through_the_method_alone():
    """Nothing of execution, tasks, reports or the command line is loaded for it."""
    code = (
        "import sys\n"
        "from flgpr.method.method import detect\n"
        "from flgpr.recipe.schema import load_recipe\n"
        "from flgpr.store import open_run, sample_lane\n"
        "found = detect(open_run(sample_lane() / 'run.zarr'), load_recipe('demo'))\n"
        "print(*found.alarms[['x', 'y']].to_numpy()[:2].ravel().round(2))\n"
        "rooms = {name.split('.')[1] for name in sys.modules if name.startswith('flgpr.')}\n"
        "print(*sorted(rooms & {'execution', 'tasks', 'results', 'report', 'cli', 'live'}))\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    places, rooms = ran.stdout.splitlines()
    assert [float(value) for value in places.split()] == [-1.2, 4.05, -0.4, 2.9]
    assert rooms == ""


def test_passes_stand_in_the_order_of_the_paper_and_name_what_they_need(setup):
    passes = passes_of(setup)
    assert [planned.name for planned in passes] == ORDER
    known = set()
    for planned in passes:
        assert set(planned.needs) <= known
        known.add(planned.name)
    assert [planned.name for planned in passes if planned.all_scans] == ["signature", "gain"]
    assert [planned.name for planned in passes if planned.needs_no_scans] == ["alarms"]


def test_a_map_surveys_the_whole_lane_before_the_first_map(run, recipe, setup):
    other = ImagedRun(run, recipe, LANE, results=dict(setup.results))

    def survey(image):
        sums = {"power": np.zeros(1)}

        def add(index):
            sums["power"] += (np.abs(image(index).values) ** 2).mean()

        return sum_accumulator(sums, add)

    other.mapper = SimpleNamespace(surveys=True, survey=survey, measures_clutter=False)
    passes = {planned.name: planned for planned in passes_of(other)}
    assert list(passes) == ["signature", "gain", "survey", *ORDER[2:]]
    assert passes["survey"].all_scans
    assert passes["survey"].needs == ("gain",)
    engine_of(other).run(names=("survey",))
    images = [other.coherent(index).values for index in range(len(other.imager))]
    powers = [(np.abs(image) ** 2).mean() for image in images]
    assert other.results["survey"]["power"][0] == pytest.approx(sum(powers), rel=1e-5)


def test_an_engine_refuses_a_pass_before_what_it_needs():
    late = PlannedPass("late", "late", lambda _: sum_accumulator({}, print), ("early",))
    with pytest.raises(ValueError, match="pass late needs early before it"):
        Engine([late], 3, {})


def test_blocks_merged_by_hand_give_the_bits_of_the_run_in_one(run, recipe, setup):
    """As workers do it: every block by itself, its state taken as plain arrays, merged in the order of the blocks."""
    other = ImagedRun(run, recipe, LANE)
    engine = engine_of(other)
    for name in engine.passes:
        states = [engine.gather_block(name, number) for number in engine.block_numbers(name)]
        plain = [{key: np.array(value) for key, value in state.items()} for state in states]
        other.results[name] = engine.merge_blocks(name, plain).result()
    for name in ORDER:
        assert other.results[name].keys() == setup.results[name].keys()
        for key, value in setup.results[name].items():
            np.testing.assert_array_equal(other.results[name][key], value, err_msg=f"{name} {key}")
    pd.testing.assert_frame_equal(detection_of(other).features, detection_of(setup).features)


def test_without_explanations_the_alarms_are_the_same(run, recipe, setup):
    plain = ImagedRun(run, recipe, LANE, explains=False)
    engine_of(plain).run()
    found = detection_of(plain)
    pd.testing.assert_frame_equal(found.alarms, detection_of(setup).alarms)
    assert (found.evidence, found.before, found.contributions) == (None, None, None)


def test_sections_share_a_background_and_find_what_the_whole_lane_does(run, recipe, setup):
    rows = setup.grid.ny
    maxima = setup.results["alarms"]
    table = pd.DataFrame({name: maxima[f"maximum|{name}"] for name in ("x", "y", "magnitude")})
    threshold = lane_threshold(recipe, LANE, table, int(maxima["seen"]))
    found = []
    for first, last in ((0, rows // 2), (rows // 2, rows)):
        shared = {name: setup.results[name] for name in ("signature", "gain")}
        section = Section(first, last, threshold)
        part = ImagedRun(run, recipe, LANE, results=shared, section=section)
        engine_of(part).run()
        found.append(rank_alarms(part).alarms)
    together = pd.concat(found).sort_values(["y", "x"])[["x", "y", "confidence"]]
    whole = rank_alarms(setup).alarms.sort_values(["y", "x"])[["x", "y", "confidence"]]
    pd.testing.assert_frame_equal(
        together.reset_index(drop=True), whole.reset_index(drop=True), rtol=1e-4
    )


def test_a_section_goes_through_the_blocks_that_reach_it(run, recipe):
    part = ImagedRun(run, recipe, LANE, section=Section(0, 5, 0.0))
    blocks = [range(0, 4), range(4, 8), range(8, 13)]
    assert part.block_numbers(blocks) == [0, 1]
    assert ImagedRun(run, recipe, LANE).block_numbers(blocks_of(13)) == [0]


def test_a_detection_in_memory_is_what_the_passes_leave(run, recipe, setup):
    found = detect(run, recipe, LANE)
    pd.testing.assert_frame_equal(found.alarms, detection_of(setup).alarms)
    np.testing.assert_array_equal(found.view.values, setup.view().values)

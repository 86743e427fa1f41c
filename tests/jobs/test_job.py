"""A job as plain values, its lane, and what its identity holds."""

from dataclasses import replace

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.jobs.job import (
    LaneJob,
    choose_lane,
    code_versions,
    make_job,
    processor,
)
from flgpr.method.sections import Section
from flgpr.model import Lane
from flgpr.recipe.schema import lane_of, parse_recipe
from flgpr.results.result import read_result
from flgpr.store import open_run, save_run
from flgpr.store.lane_file import lane_file_of
from small_lane import LANE, LANE_TOML, small_recipe, small_run

OWN_LANE = "\n[lane]\nx_min = -0.7\nx_max = 0.7\ny_min = 3.0\ny_max = 9.0\n"


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    home = tmp_path_factory.mktemp("job")
    save_run(small_run(scans=3), home / "run.zarr")
    return make_job(home / "run.zarr", small_recipe(), LANE, home / "result")


def test_a_job_holds_plain_values_and_absolute_paths(job):
    assert isinstance(job, LaneJob)
    assert job.run.startswith("/")
    assert job.output.startswith("/")
    assert job.lane == (LANE.x_min, LANE.x_max, LANE.y_min, LANE.y_max)
    assert (job.code, job.cpu) == (code_versions(), processor())
    assert str(job.work) == f"{job.output}.work"
    assert hash(job) == hash(replace(job))


def test_a_run_beside_it_of_another_place_on_the_earth_is_refused(tmp_path):
    place = {"longitude": 8.5, "latitude": 49.0, "azimuth": 30.0}
    for name, latitude in (("here", 49.0), ("far", 49.1)):
        run = small_run(scans=3).assign_attrs(georeference=place | {"latitude": latitude})
        save_run(run, tmp_path / f"{name}.zarr")
    beside = {"second": tmp_path / "far.zarr"}
    with pytest.raises(ValueError, match=r"far\.zarr: must be a run of the same lane, within 10 m"):
        make_job(tmp_path / "here.zarr", small_recipe(), LANE, tmp_path / "result", others=beside)


def test_the_identity_holds_the_rows_of_a_section_and_not_its_threshold(job):
    section = replace(job, section=Section(2, 9, 1.5))
    assert job.identity["rows"] is None
    assert section.identity["rows"] == [2, 9]
    assert section.identity == replace(job, section=Section(2, 9, 7.0)).identity
    assert section.identity != job.identity


@pytest.mark.parametrize(
    ("change", "differs"),
    [
        ({"recipe": "other"}, True),
        ({"store_sha256": "other"}, True),
        ({"explains": False}, True),
        ({"output": "/elsewhere"}, False),
        ({"report": False}, False),
        ({"max_memory": 10**9}, False),
        ({"pass_cache": "/elsewhere"}, False),
    ],
)
def test_the_identity_changes_with_what_bits_depend_on(job, change, differs):
    assert (replace(job, **change).identity != job.identity) is differs


def test_what_lasts_of_an_identity_leaves_out_program_and_machine(job):
    assert set(job.lasting_identity) == {"run", "recipe", "lane", "model", "others"}
    assert job.lasting_identity == replace(job, cpu="other", code=()).lasting_identity


# The lane that is searched: given, of the recipe, beside the run, or seen


def test_the_order_of_lanes(tmp_path):
    run = tmp_path / "road.zarr"
    recipe = parse_recipe(small_recipe())
    assert choose_lane(run, None, recipe) == (None, "")

    lane_file_of(run).write_text(LANE_TOML)
    assert lane_file_of(run) == tmp_path / "road-lane.toml"
    assert choose_lane(run, None, recipe) == (LANE, "road-lane.toml beside the run")

    with_lane = parse_recipe(small_recipe() + OWN_LANE)
    assert choose_lane(run, None, with_lane) == (None, "")

    given = tmp_path / "given.toml"
    given.write_text(LANE_TOML)
    assert choose_lane(run, given, with_lane) == (LANE, "given.toml, as given")
    assert choose_lane(run, LANE, with_lane) == (LANE, "as given")


def test_without_borders_the_ground_that_the_run_sees_is_searched(job):
    assert job.lane_source == "as given"
    seen = make_job(job.run, small_recipe(), None, job.output)
    assert Lane(*seen.lane) == lane_of(open_run(job.run), parse_recipe(small_recipe()))
    assert seen.lane_source == ""


def test_a_file_beside_the_run_that_is_no_lane_is_named(tmp_path):
    (tmp_path / "road-lane.toml").write_text("x_min = 1.0\n")
    with pytest.raises(ValueError, match=r"road-lane\.toml"):
        choose_lane(tmp_path / "road.zarr", None, parse_recipe(small_recipe()))


def test_detect_takes_the_lane_beside_the_run_and_says_so(tmp_path):
    save_run(small_run(), tmp_path / "road.zarr")
    (tmp_path / "road-lane.toml").write_text(LANE_TOML)
    (tmp_path / "own.toml").write_text(small_recipe())
    output = tmp_path / "out"
    words = ["detect", tmp_path / "road.zarr", "--recipe", tmp_path / "own.toml", "-o", output]
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "searched: x -0.75 to 0.75 m, y 3.0 to 10.0 m (road-lane.toml beside the run)" in said
    result = read_result(output)
    assert result.lane == LANE
    assert result.manifest["run"]["searched"]["source"] == "road-lane.toml beside the run"
    assert "Searched: x -0.75 to 0.75 m" in (output / "report.html").read_text()

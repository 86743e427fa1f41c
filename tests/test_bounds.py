"""Every number of every schema of a file has bounds: found by walking the schemas, not from a list of entries."""

import itertools
import math
import types
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import pytest
from pydantic import BaseModel, ValidationError
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.model import Sensor, load_sensor, sensor_presets
from flgpr.model.bounds import LARGEST, Entries, Largest
from flgpr.model.faults import describe_fault
from flgpr.recipe.schema import Recipe, load_recipe, recipe_names
from flgpr.simulate import Scene, draw_world
from flgpr.simulate.bodies.signature import load_body, packaged_bodies
from flgpr.simulate.bodies.signature.body import Body
from flgpr.simulate.effort import MOST_MEMORY, check_effort, drawing_effort, simulation_effort
from flgpr.simulate.scene.scene import sites
from flgpr.stages.named import PACKAGED, find_stage, stage_names
from flgpr_ground.ground import GROUNDS, Description, load_ground

SETTINGS = [find_stage(kind, name).Settings for kind in PACKAGED for name in stage_names(kind)]
EXTREME = [0, -1, 1e9, 10**9, 1e300, math.inf, -math.inf, math.nan, 10**400]
SMALL = Scene(length=8.0, track={"positions": [-5.0, -3.0]})


def models_in(annotation):
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for one in get_args(annotation):
        yield from models_in(one)


def reachable(roots):
    found = []
    left = list(roots)
    while left:
        model = left.pop()
        if model not in found and issubclass(model, Entries):
            found.append(model)
            left += [
                one for field in model.model_fields.values() for one in models_in(field.annotation)
            ]
    return sorted(found, key=lambda one: one.__name__)


def tables_of(instance):
    """The tables in a file by their schema."""
    found = {type(instance): instance.model_dump()}
    for value in dict(instance).values():
        found |= tables_of(value) if isinstance(value, Entries) else {}
    return found


PACKAGED_TABLES = tables_of(load_recipe("wang2007")) | tables_of(load_sensor("sri-array"))
PACKAGED_TABLES[Description] = load_ground().table.model_dump()
MODELS = reachable([Recipe, Scene, Sensor, Body, Description, *SETTINGS])


def example(annotation):
    """Any value of a type."""
    origin = get_origin(annotation)
    of = get_args(annotation)
    if annotation in (float, int, str, bool):
        return {float: 0.5, int: 1, str: "HH", bool: True}[annotation]
    if origin is Literal:
        return of[0]
    if origin is Annotated or origin in (Union, types.UnionType):
        return example(of[0])
    if origin is tuple:
        return [example(of[0])] if of[-1] is Ellipsis else [example(one) for one in of]
    if origin is dict:
        return {"one": example(of[1])}
    return {} if annotation is Any else whole(annotation)


def whole(model):
    """Entries of a table that are valid: those of a packaged file, else what must be there."""
    if model in PACKAGED_TABLES:
        return PACKAGED_TABLES[model]
    return {
        name: example(field.annotation)
        for name, field in model.model_fields.items()
        if field.is_required()
    }


def with_number(annotation, bad):
    """All values of a type that have one number replaced."""
    origin = get_origin(annotation)
    of = get_args(annotation)
    if annotation in (float, int):
        yield bad
    elif origin is Annotated:
        yield from with_number(of[0], bad)
    elif origin in (Union, types.UnionType):
        for one in of:
            yield from with_number(one, bad)
    elif origin is dict:
        yield from ({"one": value} for value in with_number(of[1], bad))
    elif origin is tuple and of[-1] is Ellipsis:
        yield from ([value] for value in with_number(of[0], bad))
    elif origin is tuple:
        for at, one in enumerate(of):
            for value in with_number(one, bad):
                yield [value if at == i else example(other) for i, other in enumerate(of)]


def cases():
    for model in MODELS:
        for name, field in model.model_fields.items():
            if any(True for _ in with_number(field.annotation, 1)):
                yield pytest.param(model, name, id=f"{model.__name__}.{name}")


@pytest.mark.parametrize(("model", "name"), list(cases()))
def test_extreme_numbers_are_refused_by_name_or_harmless(model, name):
    field = model.model_fields[name]
    largest = next((one.value for one in field.metadata if isinstance(one, Largest)), LARGEST)
    for bad in EXTREME:
        for value in with_number(field.annotation, bad):
            try:
                model.model_validate(whole(model) | {name: value})
            except ValidationError as error:
                told = "; ".join(describe_fault(one, model, "file") for one in error.errors())
                assert name in told
                assert len(told) < 2000
            else:
                assert abs(bad) <= largest
                check_world(model, name, value)


def check_world(model, name, value):
    """What a scene's schema takes can be drawn, or the estimate refuses it; the estimate itself never fails."""
    scene = None
    if model is Scene:
        scene = SMALL.model_dump(exclude_unset=True) | {name: value}
    for part, field in Scene.model_fields.items():
        if model in models_in(field.annotation):
            entries = whole(model) | {name: value}
            scene = {
                "length": 8.0,
                part: [entries] if get_origin(field.annotation) is tuple else entries,
            }
    if scene is None:
        return
    scene = Scene.model_validate(scene)
    assert math.isfinite(simulation_effort(scene, load_sensor("full-wave")).memory)
    if drawing_effort(scene).memory < MOST_MEMORY:
        draw_world(scene, 1)


def test_the_walk_finds_every_kind_of_file():
    names = {model.__name__ for model in MODELS}
    assert {
        "Recipe",
        "ImageTable",
        "Scene",
        "Surface",
        "Sensor",
        "Tones",
        "Body",
        "BodyLayer",
        "LaneRow",
    } <= names
    assert {one.__name__ for one in SETTINGS} <= names | {"Table"}
    assert len(list(cases())) > 200


def test_all_that_is_packaged_is_accepted():
    for names, load in (
        (recipe_names, load_recipe),
        (sensor_presets, load_sensor),
        (packaged_bodies, load_body),
    ):
        for name in names():
            load(name)
    for site, preset in itertools.product(sites(), sensor_presets()):
        check_effort(Scene(site=site), load_sensor(preset))
    for ground in GROUNDS:
        for lane in load_ground(source=ground).lanes.values():
            if lane.stored is None:
                check_effort(lane.scene, lane.sensor)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ("length = 1e9", "length"),
        ("[clutter]\nrocks = 1e9", "clutter.rocks"),
        ("[surface]\ndensity = 1e9", "surface.density"),
        ('[[draws]]\nkind = "metal"\ndepth = 0.1\ncount = 1000000000', "draws.0.count"),
        ("[clutter]\nrocks = 1e6", "--force"),
        ("[holes]\nempty = 1e6", "--force"),
    ],
)
@pytest.mark.parametrize("option", ["--preview", "--output"])
def test_the_command_refuses_before_it_works(tmp_path, entries, words, option):
    (tmp_path / "scene.toml").write_text(entries)
    made = tmp_path / ("x.png" if option == "--preview" else "x.zarr")
    done = CliRunner().invoke(app, ["simulate", str(tmp_path / "scene.toml"), option, str(made)])
    assert (done.exit_code, done.output.count("\n")) == (2, 1)
    assert words in done.output
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_force_goes_beyond(tmp_path, monkeypatch):
    monkeypatch.setattr("flgpr.simulate.effort.MOST_HOURS", 0.0)
    (tmp_path / "scene.toml").write_text("length = 5.0\n[track]\npositions = [-5.0]")
    command = [
        "simulate",
        str(tmp_path / "scene.toml"),
        "--preview",
        str(tmp_path / "x.png"),
        "--quiet",
    ]
    refused = CliRunner().invoke(app, command)
    assert refused.exit_code == 2
    assert "at most 4 GB and 0 hours" in refused.output
    assert CliRunner().invoke(app, [*command, "--force"]).exit_code == 0
    assert (tmp_path / "x.png").is_file()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("median = 1.05", "median = 1e300", "background.median"),
        ("median = 1.05", "median = 99.0", "background.median must be at most 1001 pixels"),
        ("spacing = 0.05", "spacing = 1e-300", "image.spacing"),
        ("spacing = 0.05", "spacing = 0.001", "image.spacing must make at most"),
    ],
)
def test_a_recipe_that_no_image_could_be_made_of_is_refused(tmp_path, old, new, words):
    from flgpr.recipe.schema import recipe_text

    text = recipe_text("wang2007")
    assert old in text
    (tmp_path / "r.toml").write_text(text.replace(old, new, 1))
    done = CliRunner().invoke(app, ["recipe", "check", str(tmp_path / "r.toml")])
    assert done.exit_code == 2
    assert words in done.output


def test_a_line_of_antennas_is_bounded_before_it_is_made(tmp_path):
    sensor = load_sensor("sri-array").model_dump()
    for line in (
        {"count": 10**9},
        {"count": -1},
        {"first": [math.inf, 0, 0]},
        {"last": [1e300, 0, 0]},
    ):
        tx = {"first": [0, 0, 0], "last": [1, 0, 0], "count": 3} | line
        with pytest.raises(ValidationError, match="tx must hold finite places"):
            Sensor.model_validate(sensor | {"tx": tx})

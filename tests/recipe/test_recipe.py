import re

import numpy as np
import pytest

from flgpr.model import Lane
from flgpr.recipe.schema import (
    course_lane,
    line_of,
    load_recipe,
    parse_recipe,
    recipe_names,
    recipe_text,
)

DEMO = recipe_text("demo")


@pytest.mark.parametrize("name", recipe_names())
def test_packaged_recipes_are_valid(name):
    assert load_recipe(name).name == name


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("radius = 0.375", "radius = -1", ["prescreen.radius", "greater than or equal to 0.001"]),
        ("radius = 0.375", "radius = 0.375\ncolour = 1", ["prescreen.colour"]),
        ('polarization = "HH"', 'polarization = "LR"', ["polarization", "'LR'"]),
        ("x_max = 1.0", "x_max = -1.0", ["lane", "empty lane"]),
        ('window = "hann"', 'window = "square"', ["image.window", "'square'"]),
        ('subband = "0.45-1.5"', 'subband = "F9"', ["subband", "'F9'"]),
        ("y = [1.2, 5.84]", "y = [5.84, 1.2]", ["image.y", "increase"]),
        ("guard = [9, 7]", "guard = [8, 7]", ["odd"]),
        ("y_max = 5.84", "y_max = 5.84\nfalloff = 2", ["run_view", "falloff", '"mean"']),
        ("y_max = 5.84", "y_max = 0.5", ["run_view.y_max", "image.y = 1.2 m", "no look"]),
        ('name = "demo"', "name = ", ["TOML"]),
    ],
)
def test_a_broken_recipe_names_the_entry_and_the_rule(old, new, words):
    assert old in DEMO
    with pytest.raises(ValueError) as error:
        parse_recipe(DEMO.replace(old, new), "mine.toml")
    for word in ["mine.toml", *words]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("flsar2004", "", "", "with run_view.look and screen, got"),
        (
            "fuse2018",
            "x = [-10.0, 10.0]",
            "x = [-5.0, 5.0]",
            "run_view.x must lie within image.x, -5 to 5 m",
        ),
    ],
)
def test_what_cannot_raise_alarms_frame_by_frame_is_refused(name, old, new, words):
    text = re.sub(r'\narea = "\w+"', '\narea = "frames"', recipe_text(name)).replace(old, new)
    with pytest.raises(ValueError, match=re.escape(words)):
        parse_recipe(text)


def test_the_paper_scores_frames_of_70_square_metres():
    recipe = load_recipe("fuse2018-printed")
    assert recipe.frame_area() == Lane(-7.0, 7.0, 5.0, 10.0)
    poses = np.zeros((2, 6))
    poses[:, :2] = [[0.3, 0.0], [0.3, 20.0]]
    assert course_lane(recipe, poses, 25.0) == Lane(-7.0, 7.0, 5.0, 25.0)
    assert course_lane(load_recipe("wang2007"), poses, 27.0) == Lane(-1.2, 1.8, 7.0, 27.0)


def test_an_unknown_recipe_lists_the_packaged_ones():
    with pytest.raises(ValueError, match="demo"):
        load_recipe("no-such")


def test_a_fault_is_told_with_its_line():
    text = DEMO.replace("density = 0.75", "density = -0.75")
    line = text[: text.index("density = -0.75")].count("\n") + 1
    with pytest.raises(ValueError, match=rf"line {line}: prescreen\.density"):
        parse_recipe(text)


def test_lines_are_found_in_nested_quoted_and_repeated_tables():
    text = 'a = 1\n[b]\nc = 2\n[b.d]\n"0.4-1" = 3\n[[e]]\nf = 4\n'
    assert [
        line_of(text, place) for place in (["a"], ["b", "c"], ["b", "d", "0.4-1"], ["e", "f"])
    ] == [1, 3, 5, 7]
    assert line_of(text, ["b", "missing"]) == 2
    assert line_of(text, ["missing"]) is None

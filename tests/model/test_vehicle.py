"""Stopping distance and what is left of the way to an alarm."""

import numpy as np
import pytest

from flgpr.model.vehicle import Vehicle
from flgpr.recipe.schema import parse_recipe, recipe_text


def test_the_stopping_distance_is_reaction_and_braking():
    vehicle = Vehicle(speed=6.0, reaction=2.0, deceleration=3.0)
    assert vehicle.stopping_distance == pytest.approx(6.0 * 2.0 + 6.0**2 / (2 * 3.0))
    assert Vehicle().stopping_distance is None


def test_the_distance_left_is_along_the_heading_from_the_front():
    vehicle = Vehicle(front=1.5)
    straight = np.array([0.0, 10.0, 2.0, 0.0, 0.0, 0.0])
    assert vehicle.left(0.7, 15.0, straight) == pytest.approx(3.5)
    assert vehicle.left(0.7, 11.0, straight) == pytest.approx(-0.5)  # passed
    to_the_right = np.array([0.0, 10.0, 2.0, np.pi / 2, 0.0, 0.0])
    assert vehicle.left(4.0, 10.0, to_the_right) == pytest.approx(2.5)


def test_the_margin_counts_what_is_driven_since_the_scan():
    vehicle = Vehicle(speed=4.0, reaction=1.0, deceleration=2.0)  # stops within 8 m
    assert vehicle.margin(10.0, 0.25) == pytest.approx(1.0)
    assert vehicle.margin(8.0, 0.25) == pytest.approx(-1.0)
    assert Vehicle().margin(10.0, 0.25) is None


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("speed", 0.0),
        ("speed", 101.0),
        ("reaction", -1.0),
        ("deceleration", 0.0),
        ("front", 51.0),
        ("axle", -60.0),
        ("width", 0.0),
        ("tyre", 6.0),
        ("clearance", -0.1),
        ("warning", 60.0),
        ("threshold", float("inf")),
        ("wheels", 4),
    ],
)
def test_values_out_of_range_are_named(name, value):
    with pytest.raises(ValueError, match=f"^{name}: .*(got {value:g}|no such entry)"):
        Vehicle.of(**{name: value})
    if name != "wheels":
        with pytest.raises(ValueError, match=f"^{name}: "):
            Vehicle().changed(**{name: value})


def test_what_is_not_given_stays():
    vehicle = Vehicle(reaction=2.0, width=3.0)
    assert vehicle.changed(reaction=None, front=1.0) == Vehicle(reaction=2.0, width=3.0, front=1.0)
    assert vehicle.changed(reaction=0.0).reaction == 0.0


def test_the_recipe_holds_the_vehicle_and_names_what_is_wrong_with_it():
    text = recipe_text("wang2007")
    assert parse_recipe(text, "mine").vehicle == Vehicle()
    heavy = parse_recipe(text + "\n[vehicle]\ndeceleration = 1.5\naxle = 7\n", "mine").vehicle
    assert (heavy.deceleration, heavy.axle, heavy.width) == (1.5, 7.0, Vehicle().width)
    with pytest.raises(ValueError, match=r"vehicle\.deceleration: .*0\.1.*got 0"):
        parse_recipe(text + "\n[vehicle]\ndeceleration = 0\n", "mine")
    with pytest.raises(ValueError, match=r"vehicle\.with: no such entry; did you mean width"):
        parse_recipe(text + "\n[vehicle]\nwith = 2\n", "mine")

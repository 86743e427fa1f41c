"""Tables of a scene: rules of their entries."""

import pytest

from flgpr.simulate import Scene
from flgpr.simulate.scene.scene_tables import Grass, Lenses, Stones, Terrain


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"stones": {"density": -1}}, "density"),
        ({"stones": {"radius": (0.05, 0.01)}}, "least < greatest"),
        ({"holes": {"over": 1.5}}, "over"),
        ({"roots": {"lenght": 1.0}}, "lenght"),
    ],
)
def test_bad_tables_are_refused(table, message):
    with pytest.raises(ValueError, match=message):
        Scene(**table)


def test_relief_is_flat_unless_something_is_given_and_switched_on():
    assert Terrain().flat
    assert not Terrain(undulation=0.01).flat
    assert not Terrain(slope_along=0.01).flat
    assert Terrain(undulation=0.01, rut_depth=0.1, on=False).flat


def test_grass_grows_where_it_has_a_height_and_is_on():
    assert not Grass().grown
    assert Grass(height=0.2).grown
    assert not Grass(height=0.2, on=False).grown


@pytest.mark.parametrize("span", [(-0.1, 0.2), (0.2, 0.2), (0.0, 51.0)])
def test_a_span_has_a_least_and_a_greater_value_within_bounds(span):
    with pytest.raises(ValueError, match="0 <= least < greatest <= 50"):
        Lenses(radius=span)


def test_a_table_does_not_change_once_it_is_read():
    with pytest.raises(ValueError, match="frozen"):
        Stones().density = 3.0

"""Entries of a scene that can hardly be meant."""

import pytest

from flgpr.simulate import Scene
from flgpr.simulate.scene.scene_doubts import scene_doubts

MINE = {"kind": "metal", "x": 0.0, "y": 5.0, "depth": 0.05, "radius": 0.16, "height": 0.15}


def doubts_about(*targets, **entries):
    placed = [{**MINE, **target} for target in targets]
    return scene_doubts(Scene.model_validate({"length": 20.0, "targets": placed, **entries}), 1)


@pytest.mark.parametrize(
    ("targets", "doubt"),
    [
        ([{"x": 9.0}], "targets outside the lane, and not in the truth: 1 (T001)"),
        (
            [{}, {"y": 8.0, "depth": -0.2}],
            "targets in the air, with a depth below -height: 1 (T002)",
        ),
        ([{}, {"x": 0.31}], "targets in one another: 1 (T001 and T002)"),
        ([{"x": 3.0 + i} for i in range(4)], "the truth: 4 (T001, T002, T003, ...)"),
    ],
)
def test_targets_that_can_hardly_be_meant_are_counted_and_named(targets, doubt):
    told = doubts_about(*targets)
    assert len(told) == 1
    assert told[0].endswith(doubt)


def test_a_mine_on_the_ground_and_mines_beside_or_above_one_another_raise_no_doubt():
    assert doubts_about({"depth": -0.15}, {"x": 0.33}, {"y": 8.0}, {"y": 8.0, "depth": 0.21}) == []
    draws = [{"kind": "metal", "depth": 0.1, "count": 6}]
    assert doubts_about(draws=draws, track={"stops": [[2.0, 3]]}) == []


def test_stops_and_departures_off_the_drive_and_entries_beside_positions_are_told():
    off = {"stops": [[500.0, 3]], "departures": [{"start": -40.0, "length": 20.0}]}
    assert doubts_about(track=off) == [
        "track.stops: 500 m lies outside the track, y -20 to 15 m",
        "track.departures: -40 m lies outside the track, y -20 to 15 m",
    ]
    beside = {"positions": [0.0], "stops": [[0.0, 3]]}
    assert doubts_about(track=beside) == ["track.stops does nothing beside track.positions"]

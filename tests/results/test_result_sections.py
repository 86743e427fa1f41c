"""The folder of a lane that was processed in sections: its list is checked against the sections."""

import pytest

from flgpr.results.manifest import ResultError
from flgpr.results.sections import (
    join_results,
    read_sections,
    results_at,
    section_names,
    sections_at,
    write_sections,
)
from flgpr.store.lane_file import lane_text
from small_results import LANE, small_result

NAMES = ("section-1", "section-2")


@pytest.fixture
def folder(tmp_path):
    for name in NAMES:
        small_result(tmp_path / name)
    (tmp_path / "alarms.csv").write_bytes((tmp_path / NAMES[0] / "alarms.csv").read_bytes())
    (tmp_path / "lane.toml").write_text(lane_text(LANE))
    write_sections(tmp_path, NAMES, {"run": "r"})
    return tmp_path


def test_sections_are_read_in_their_order(folder):
    sections = read_sections(folder)
    assert sections.names == NAMES
    assert sections.homes == [folder / name for name in NAMES]
    assert sections.identity == {"run": "r"}
    assert sections.lane() == LANE
    assert len(sections.alarms()) == 3


@pytest.mark.parametrize("name", ["alarms.csv", "section-2/manifest.json"])
def test_an_altered_file_is_refused(folder, name):
    path = folder / name
    path.write_bytes(path.read_bytes()[:-2] + b"0\n")
    with pytest.raises(ResultError, match=r"section-2|alarms"):
        read_sections(folder)


def test_alarms_of_all_sections_are_ranked_together_under_the_names_of_their_sections(tmp_path):
    for name in NAMES:
        small_result(tmp_path / name)
    join_results(tmp_path, NAMES, LANE, {"run": "r"})
    sections = read_sections(tmp_path)
    alarms = sections.alarms()
    assert alarms["confidence"].tolist() == [9.0, 9.0, 4.0, 4.0, 2.5, 2.5]
    assert alarms["alarm_id"].tolist()[:2] == ["section-1/a", "section-2/a"]
    assert (sections.lane(), sections.identity) == (LANE, {"run": "r"})


def test_a_result_in_one_piece_has_no_sections(folder):
    assert sections_at(folder / NAMES[0]) is None
    assert results_at(folder / NAMES[0]) == [folder / NAMES[0]]
    assert sections_at(folder).names == NAMES
    assert results_at(folder) == [folder / name for name in NAMES]


def test_a_missing_list_is_named(tmp_path):
    with pytest.raises(ResultError, match=r"not a complete folder of sections: .* is missing"):
        read_sections(tmp_path)


def test_folders_of_sections_are_numbered_so_that_they_sort():
    assert section_names(3) == ["section-01", "section-02", "section-03"]
    names = section_names(100)
    assert (names[0], names[-1]) == ("section-001", "section-100")

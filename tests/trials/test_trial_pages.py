"""The crew's papers of a plan, and the page of a blind score."""

import json
import re
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.geo import read_anchor
from flgpr.model import Lane
from flgpr.trials import register
from flgpr_trials.commands.crew import plan_files
from flgpr_trials.commands.plan import plan_lane
from flgpr_trials.pages import lane_maps
from scored_blind import score_sealed, seal_truth_file

LANE = "x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 75.0\n"
ANCHOR = """
crs = "EPSG:32633"
accuracy = 0.02
[[point]]
lane = [0.0, 0.0]
easting = 500000.0
northing = 5400000.0
[[point]]
lane = [0.0, 75.0]
easting = 500075.0
northing = 5400000.0
"""
GPX = "{http://www.topografix.com/GPX/1/1}"
PHRASE = "correct horse battery"


@pytest.fixture
def home(tmp_path):
    (tmp_path / "lane.toml").write_text(LANE)
    (tmp_path / "anchor.toml").write_text(ANCHOR)
    (tmp_path / "sorts.csv").write_text("kind;depth;count\nmetal;0,05;5\nplastic;0,125;3\n")
    return tmp_path


def plan(home, **how):
    return plan_lane(home / "lane.toml", home / "sorts.csv", home / "plan.csv", 7, **how)[0]


def test_a_plan_is_written_to_the_millimetre_with_page_and_sheet(home):
    table = plan(home)
    for line in (home / "plan.csv").read_text().splitlines()[1:]:
        assert all(len(cell.partition(".")[2]) <= 3 for cell in line.split(",")[3:5]), line
    page = (home / "plan.html").read_text()
    for row in table.to_dict("records"):
        deep = f"{row['depth']:.3f}"
        cells = rf"<td>{row['target_id']}</td><td>{row['kind']}</td><td class=n>{row['x']:.2f}</td>"
        assert re.search(cells + rf"<td class=n>{row['y']:.2f}</td><td class=n>{deep}</td>", page)
    assert page.count("☐ yes") == len(table)
    assert "Date and signature" in page
    assert "easting" not in page
    assert not re.search(r"(src|href)=(?!\"data:)", page)
    sheet = pd.read_csv(home / "plan-sheet.csv")
    assert (
        sheet[["emplaced", "emplaced_x_m", "emplaced_y_m", "emplaced_depth_m", "remark"]]
        .isna()
        .all(axis=None)
    )
    np.testing.assert_array_equal(sheet[["x_m", "y_m", "depth_m"]], table[["x", "y", "depth"]])
    assert {path.name for path in plan_files(home / "plan.csv").values()} == {
        "plan.csv",
        "plan.html",
        "plan-sheet.csv",
    }


def test_a_plan_is_a_table(home):
    with pytest.raises(
        ValueError, match=r"must be a file name that ends in \.csv, got .*plan\.html"
    ):
        plan_lane(home / "lane.toml", home / "sorts.csv", home / "plan.html", 7)


def test_an_anchored_plan_lies_on_the_earth(home):
    geopandas = pytest.importorskip("geopandas")
    table = plan(home, anchor=home / "anchor.toml")
    tie = read_anchor(home / "anchor.toml")
    want = tie.to_geodetic(np.column_stack([table["x"], table["y"], np.zeros(len(table))]))[:, :2]
    frame = geopandas.read_file(home / "plan.gpkg")
    np.testing.assert_allclose(
        np.column_stack([frame.geometry.x, frame.geometry.y]), want, atol=1e-9
    )
    marks = ElementTree.parse(home / "plan.gpx").getroot().findall(f"{GPX}wpt")
    assert [mark.find(f"{GPX}name").text for mark in marks] == table["target_id"].tolist()
    np.testing.assert_allclose(
        [[float(mark.get("lon")), float(mark.get("lat"))] for mark in marks], want, atol=1e-8
    )
    sheet = pd.read_csv(home / "plan-sheet.csv")
    # +y of this lane points east and +x south; the map's scale on the central meridian is 0.9996.
    np.testing.assert_allclose(sheet["easting_m"], 500000 + table["y"], atol=0.05)
    np.testing.assert_allclose(sheet["northing_m"], 5400000 - table["x"], atol=0.05)
    assert "EPSG:32633" in (home / "plan.html").read_text()


def test_the_map_shows_every_target_once_in_strips_along_the_lane():
    y = [0.0, 29.99, 30.0, 64.0, 75.0]
    names = [f"T{number}" for number in range(5)]
    table = pd.DataFrame({"target_id": names, "kind": "metal", "x_m": 0.5, "y_m": y})
    (figure,) = lane_maps(Lane(-2, 2, 0, 75), table)
    figure.draw_without_rendering()
    shown = [[text.get_text() for text in axes.texts] for axes in figure.axes]
    assert shown == [["T0", "T1"], ["T2"], ["T3", "T4"]]
    assert figure.axes[0].yaxis_inverted(), (
        "the right side of the lane is below when travel is to the right"
    )
    assert len(lane_maps(Lane(-2, 2, 0, 300), table)) == 3
    assert len(lane_maps(Lane(-2, 2, 0, 3), table[:0])) == 1


def test_lanes_with_names_have_a_map_and_a_table_each(home):
    (home / "lane.toml").write_text(f"[north]\n{LANE}[south]\n{LANE}")
    plan(home)
    page = (home / "plan.html").read_text()
    assert page.count("map of the lane") == 2
    assert all(f"Lane {name}: x -2 to 2 m" in page for name in ("north", "south"))


@pytest.mark.parametrize("name", ["plan.csv", "plan.html", "plan-sheet.csv", "plan.gpx"])
def test_nothing_is_written_where_something_lies(name, home):
    (home / name).write_text("here")
    before = sorted(path.name for path in home.iterdir())
    with pytest.raises(FileExistsError, match=name):
        plan(home, anchor=home / "anchor.toml")
    assert sorted(path.name for path in home.iterdir()) == before


def test_nothing_is_written_beside_a_register_that_is_altered_or_closed(home):
    book = home / "plan.csv.register.jsonl"
    register(book, event="truth opened")
    with pytest.raises(ValueError, match="under which no truth was opened"):
        plan(home)
    book.write_text("{}\n")
    with pytest.raises(ValueError, match="must be unaltered"):
        plan(home)
    assert not (home / "plan.csv").exists()


def test_papers_of_a_plan_that_are_gone_are_written_again_and_the_others_stay(home):
    call = ["plan", "lane", *(str(home / name) for name in ("lane.toml", "sorts.csv"))]
    call += ["-o", str(home / "plan.csv")]
    assert CliRunner().invoke(app, call).stdout.count("wrote") == 3
    page = (home / "plan.html").read_bytes()
    (home / "plan.html").unlink()
    (home / "plan-sheet.csv").write_text("filled in\n")
    told = CliRunner().invoke(app, call)
    assert told.exit_code == 0, told.output
    assert re.findall(r"wrote (.*)", told.output) == [str(home / "plan.html")]
    assert (home / "plan.html").read_bytes() == page
    assert (home / "plan-sheet.csv").read_text() == "filled in\n"


def test_a_plan_that_was_stopped_is_finished_and_no_copy_of_it_stays(home):
    files = [home / name for name in ("lane.toml", "sorts.csv", "plan.csv")]
    plan_lane(*files, 5)
    for path in (*home.glob("plan-sheet*"), *home.glob("plan.html"), *home.glob("*.jsonl")):
        path.unlink()
    partial = home / ".partial-plan.csv"  # as a kill leaves it
    partial.mkdir()
    (partial / "plan.csv").write_bytes((home / "plan.csv").read_bytes())
    plan_lane(*files, 5)
    assert not partial.exists()
    assert (home / "plan-sheet.csv").exists()


def test_a_seed_is_drawn_and_stands_nowhere_but_on_the_terminal(home):
    told = CliRunner().invoke(
        app,
        [
            "plan",
            "lane",
            str(home / "lane.toml"),
            str(home / "sorts.csv"),
            "-o",
            str(home / "plan.csv"),
        ],
    )
    assert told.exit_code == 0, told.output
    (seed,) = re.findall(r"8 targets, seed (\d+);", told.output)
    assert int(seed) > 10**9
    assert not [path.name for path in home.iterdir() if seed in path.read_text()]
    first = (home / "plan.csv").read_text()
    for path in home.glob("plan*"):
        path.unlink()
    plan_lane(home / "lane.toml", home / "sorts.csv", home / "plan.csv", int(seed))
    assert (home / "plan.csv").read_text() == first


@pytest.mark.parametrize("show", ["curve", "targets"])
def test_a_blind_score_has_a_page_that_shows_what_the_owner_allows(show, home):
    pytest.importorskip("cryptography")
    truth = "target_id,x,y,kind,depth\nmine-a,0.1234567,10.7654321,metal,0.05\nmine-b,1.1234567,30,plastic,\n"
    (home / "truth.csv").write_text(truth + "mine-c,1,70,metal,0.1\n")
    (home / "alarms.csv").write_text("x,y,confidence\n0.1,10.8,3\n1.2,30.2,1\n-1,50,2\n")
    seal_truth_file(home / "truth.csv", home / "lane.toml", home / "sealed", PHRASE, show=show)
    told = score_sealed(home / "alarms.csv", home / "sealed", PHRASE, home / "score")
    page, content = ((home / "score" / name).read_text() for name in ("report.html", "roc.json"))
    for word in (
        "Pd interval",
        "chance",
        "2 of 3",
        "halo radius",
        "per m²",
        "Targets of plastic",
        "Look 1",
    ):
        assert word in page
    bare = re.sub(r"base64,[^\"]*|[0-9a-f]{64}", "", page + content + repr(told))
    assert not [
        word for word in ("1234567", "7654321", "10.8", "threshold", "distance") if word in bare
    ]
    if show == "curve":
        assert told.targets is None
        assert "mine-" not in bare
        return
    assert "not at any" in page
    rows = json.loads(content)["detections"]["main"]["targets"]
    # One false alarm on some 290 m² outranks the second mine.
    assert [row["found_from"] for row in rows] == [0.001, 0.005, None]
    assert set(rows[0]) == {"target_id", "kind", "depth", "found_from"}


def test_what_scores_show_is_one_of_two(home):
    (home / "truth.csv").write_text("target_id,x,y,kind,depth\na,0,10,metal,0.05\n")
    with pytest.raises(ValueError, match="show must be one of 'curve', 'targets', got 'places'"):
        seal_truth_file(
            home / "truth.csv", home / "lane.toml", home / "sealed", pytest.fail, show="places"
        )

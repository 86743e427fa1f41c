"""Several lines as one run: tables of their ends, marks, and lines that do not fit together."""

from dataclasses import replace

import numpy as np
import pytest

from flgpr.formats import read_gpr
from flgpr_exchange.gpr.survey import LineLayout, place_by_marks, read_line_ends, survey_run
from io_survey import write_lines

HEAD = "line,x_start_m,y_start_m,x_end_m,y_end_m\n"


@pytest.fixture
def lines(tmp_path):
    return [read_gpr(path) for path in write_lines(tmp_path, lines=3, traces=8)]


def test_a_table_of_ends_has_one_row_for_every_line(tmp_path):
    path = tmp_path / "ends.csv"
    path.write_text(HEAD + "b,1,2,3,4\na,5,6,7,8\n")
    np.testing.assert_array_equal(read_line_ends(path, ["a", "b"]), [[5, 6, 7, 8], [1, 2, 3, 4]])
    with pytest.raises(ValueError, match="must have one row for the line c, got 0"):
        read_line_ends(path, ["c"])
    path.write_text(HEAD + "a,5,6,7,8\na,5,6,7,8\n")
    with pytest.raises(ValueError, match="must have one row for the line a, got 2"):
        read_line_ends(path, ["a"])
    path.write_text("line,x_start_m\na,1\n")
    with pytest.raises(ValueError, match="missing: y_start_m, x_end_m, y_end_m"):
        read_line_ends(path, ["a"])


def test_traces_between_marks_are_at_equal_steps(lines):
    marked = replace(lines[0], marks=(1, 3, 6))
    placed = place_by_marks(marked, 2.0)
    np.testing.assert_allclose(placed.distance, [0, 1, 2, 3, 11 / 3, 13 / 3, 5, 17 / 3])
    assert placed.marks == ()
    assert placed.history[-1] == (
        "distances are from 3 marks every 2 m, in place of those that the file tells; "
        "2 traces before the first and after the last mark go on at the steps beside them"
    )
    with pytest.raises(ValueError, match="need two marks or more, got 1"):
        place_by_marks(replace(marked, marks=(4,)), 2.0)
    with pytest.raises(ValueError, match="mark-spacing must be a positive distance, got 0 m"):
        place_by_marks(marked, 0.0)


def test_parallel_lines_follow_one_another(lines):
    run = survey_run(lines, LineLayout(spacing=0.25))
    assert run.attrs["line_starts"] == [0, 8, 16]
    np.testing.assert_allclose(run["pose"].values[::8, 0], [0.0, 0.25, 0.5])
    assert run.attrs["title"] == "3 lines"
    assert any(note.startswith("line2.dt1: ") for note in run.attrs["import_notes"])


def test_lines_go_from_point_to_point(lines):
    ends = np.array([[0.0, 0, 0, 0.35], [1, 0.35, 1, 0], [2, 0, 2.35, 0]])
    run = survey_run(lines, LineLayout(ends=ends))
    pose = run["pose"].values
    np.testing.assert_allclose(pose[[0, 7, 8, 15, 16, 23], :2].ravel(), ends.ravel(), atol=1e-6)
    np.testing.assert_allclose(pose[[0, 8, 16], 3], [0, np.pi, np.pi / 2], atol=1e-6)


def test_lines_that_nothing_places_or_that_differ_are_refused(lines):
    with pytest.raises(ValueError, match="at least one line, got none"):
        survey_run([])
    with pytest.raises(ValueError, match="need an anchor, line-spacing or a table of lines"):
        survey_run(lines)
    other = replace(lines[1], delay=2 * lines[1].delay)
    with pytest.raises(ValueError, match=r"another frequency than line0\.dt1"):
        survey_run([lines[0], other], LineLayout(spacing=0.5))


def test_lines_that_differ_in_time_zero_alone_go_together(lines):
    later = replace(lines[1], delay=lines[1].delay - 3.3 * (lines[1].delay[1] - lines[1].delay[0]))
    run = survey_run([lines[0], later], LineLayout(spacing=0.25))
    apart = [survey_run([line]) for line in (lines[0], later)]
    for k, one in enumerate(apart):
        own = run.isel(scan=slice(8 * k, 8 * k + 8))["signal"]
        np.testing.assert_allclose(own, one["signal"], atol=1e-6 * np.abs(one["signal"]).max())


def test_lines_with_other_antennas_are_refused_in_words(lines):
    wider = replace(lines[1], separation=2 * lines[0].separation)
    with pytest.raises(
        ValueError,
        match=r"line1\.dt1: lines of a survey must have the same antennas, its tx_position is",
    ):
        survey_run([lines[0], wider], LineLayout(spacing=0.25))
    survey_run([lines[0], wider], LineLayout(spacing=0.25), separation=0.3)


def test_offsets_of_headers_beside_a_spacing_are_told(lines):
    placed = [
        replace(line, offsets=np.array([[x, 0.0]]))
        for line, x in zip(lines, (-0.3, 0.3), strict=False)
    ]
    run = survey_run(placed, LineLayout(spacing=0.6))
    np.testing.assert_allclose(run["pose"].values[::8, 0], [-0.3, 0.9])
    told = "\n".join(run.attrs["import_notes"])
    assert "line1.dt1: it lies 0.3 m across and 0 m along from there, where the header" in told
    beside = survey_run(placed).attrs["import_notes"]
    assert not any("it lies" in note for note in beside)

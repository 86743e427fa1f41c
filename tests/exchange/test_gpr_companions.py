"""Files beside a recording: positions, marks and spacing in every dialect."""

import numpy as np
import pytest

from flgpr.formats import read_gpr
from flgpr_exchange.gpr.dzx import read_dzx
from flgpr_exchange.gpr.positions import cor_fixes
from io_gpr import write_dt1, write_dzt, write_mala
from io_recordings import COUNTS, LATITUDE, LONGITUDE, TRACES, gps_lines, notes_with


@pytest.mark.parametrize(
    ("mark", "comma"),
    [("\t", "."), ("\t", ","), (";", ","), (";", "."), (" ", "."), (", ", "."), (",", ".")],
)
@pytest.mark.parametrize("height", ["{:.3f}{m}M", "{:.3f}M"])
def test_every_dialect_of_a_cor(mark, comma, height, tmp_path):
    rows = ["Trace\tDate\tTime\tLatitude\tN\tLongitude\tE"] if mark == "\t" else []
    for k in range(0, TRACES, 5):
        cells = [
            str(k + 1),
            "2020-01-02",
            f"12:00:{k:02d}",
            f"{LATITUDE[k]:.9f}",
            "N",
            f"{LONGITUDE[k]:.9f}",
            "E",
        ]
        text = mark.join([*cells, height.format(400.5, m=mark), "1.0"])
        rows.append(text.replace(".", ",") if comma == "," else text)
    path = tmp_path / "a.cor"
    path.write_text("\r\n".join([*rows, f"40{mark}nothing"]))
    notes = []
    found = cor_fixes(path, TRACES, notes)
    np.testing.assert_array_equal(found.table[:, 0], np.arange(0, TRACES, 5))
    np.testing.assert_allclose(found.table[:, 1], LONGITUDE[::5], atol=1e-8)
    np.testing.assert_allclose(found.table[:, 2], LATITUDE[::5], atol=1e-8)
    np.testing.assert_allclose(found.table[:, 3], 400.5)
    np.testing.assert_allclose(found.time, 43_200 + np.arange(0, TRACES, 5))
    assert [note for note in notes if "1 of 7 lines of a.cor were not understood" in note]


def test_a_cor_whose_cells_are_quoted_loses_no_line(tmp_path):
    path = tmp_path / "a.cor"
    row = '"{}","2024-04-04","12:00:00","47.9","N","11.3","E","400.5","M","1"\n'
    path.write_text(row.format(1) + row.format(5))
    notes = []
    assert cor_fixes(path, 9, notes).table.tolist() == [
        [0.0, 11.3, 47.9, 400.5],
        [4.0, 11.3, 47.9, 400.5],
    ]
    assert notes == []


@pytest.mark.parametrize(
    "place", ["47.9 N 11.3 O 400.5", "47.9 N 11.3O 400.5", "47.9 B 11.3 E 400.5"]
)
def test_a_letter_of_another_language_is_no_side_of_the_earth(place, tmp_path):
    """O is east in German, and west in French, Italian and Spanish."""
    path = tmp_path / "a.cor"
    path.write_text(f"1 2024-04-04 12:00:00 {place} M 1\n")
    notes = []
    assert len(cor_fixes(path, 9, notes).table) == 0
    assert notes == ["1 of 1 lines of a.cor were not understood and are left out"]


def test_a_height_that_is_missing_from_a_cor_is_told(tmp_path):
    path = tmp_path / "a.cor"
    path.write_text("1\t2024-04-04\t12:00:00\t47.9\tN\t11.3\tE\t\tM\t1\n")
    notes = []
    assert cor_fixes(path, 9, notes).table.tolist() == [[0.0, 11.3, 47.9, 0.0]]
    assert notes == ["1 of 1 positions tell no height: 0 m is taken"]


def test_angles_of_a_cor_with_signs_letters_and_minutes(tmp_path):
    path = tmp_path / "a.cor"
    path.write_text(
        "1 d t 47:30:36 S 11:15:00 W 1\n2 d t -47.51 11.25 2\n3 d t 47.51S 11.25W 3\n4 d t S47.51 W11.25 4\n"
        "5 d t 47°30'36\"S 11°15'00.0\"E 5\n6 d t 47°30′36″ S 11°15′ E 6\n"
    )
    found = cor_fixes(path, 9, [])
    np.testing.assert_allclose(found.table[:, 1], [-11.25, 11.25, -11.25, -11.25, 11.25, 11.25])
    np.testing.assert_allclose(found.table[:, 2], -47.51)
    np.testing.assert_allclose(found.table[:, 3], [1, 2, 3, 4, 5, 6])


def test_a_gp2_is_read_and_the_first_of_many_positions_is_used(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    traces = np.arange(0, TRACES, 3)
    text = gps_lines(traces, LATITUDE[traces], LONGITUDE[traces], "gp2")
    path.with_suffix(".GP2").write_text(text + text.splitlines()[-1] + "\r\n")
    read = read_gpr(path)
    np.testing.assert_array_equal(read.fixes[:, 0], traces)
    np.testing.assert_allclose(read.fixes[:, 1], LONGITUDE[traces], atol=1e-8)
    assert notes_with(read, "1 positions are further ones of the same trace")
    path.with_suffix(".gps").write_text(
        gps_lines(traces[:4], LATITUDE[traces[:4]], LONGITUDE[traces[:4]])
    )
    assert len(read_gpr(path).fixes) == 4
    assert notes_with(read_gpr(path), "a.GP2 lies beside it and is not read, because a.gps is")


@pytest.mark.parametrize(
    "text", ["<DZX>", "<!DOCTYPE x [<!ENTITY a 'b'>]><DZX>&a;</DZX>", "\x00\x00"]
)
def test_a_companion_that_is_damaged_keeps_no_recording_from_being_read(text, tmp_path):
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None])
    path.with_suffix(".DZX").write_text(text)
    assert notes_with(read_gpr(path), "a.DZX was found and not understood")
    path.with_suffix(".DZG").write_bytes(b"\xff\xfe\x00")
    assert notes_with(read_gpr(path), "a.DZG was found and not understood")


def test_files_beside_a_recording_that_are_not_read_are_named(tmp_path):
    path = write_mala(tmp_path / "a.rd3", COUNTS)
    path.with_suffix(".mrk").write_text("1")
    assert notes_with(read_gpr(path), "a.mrk lies beside it and is not read")
    assert read_dzx(None, 3, []).marks == ()

"""GSSI's XML beside a DZT: marks, spacing, distances."""

import numpy as np
import pytest

from flgpr.formats import read_gpr
from io_gpr import STEP, write_dzt
from io_recordings import ALONG, COUNTS, TRACES, notes_with

DZX = """<?xml version="1.0" encoding="UTF-8"?>
<DZX xmlns="www.geophysical.com/DZX/1.02"><GlobalProperties><horizontalUnit>{unit}</horizontalUnit>
<unitsPerScan>{per_scan}</unitsPerScan></GlobalProperties>{group}<File><Profile>
<WayPt><scan>7</scan><mark>User</mark><name>Mark1</name></WayPt>
<WayPt><scan>9</scan><mark>Dist</mark>{first}</WayPt><WayPt><scan>19</scan>{second}</WayPt>
</Profile></File>{end}</DZX>"""


def dzx(path, unit="m", per_scan=STEP, group=False, first="", second=""):
    wrapped = ("<ProfileGroup>", "</ProfileGroup>") if group else ("", "")
    text = DZX.format(
        unit=unit, per_scan=per_scan, group=wrapped[0], end=wrapped[1], first=first, second=second
    )
    path.with_suffix(".DZX").write_text(text)
    return path


@pytest.mark.parametrize("group", [False, True])
def test_marks_and_spacing_of_a_dzx(group, tmp_path):
    path = dzx(
        write_dzt(tmp_path / "a.dzt", COUNTS[:, None], per_metre=0.0), "cm", 100 * STEP, group
    )
    read = read_gpr(path)
    assert read.marks == (5, 7)  # that of the samples, too
    np.testing.assert_allclose(read.distance, ALONG)
    assert notes_with(read, "unitsPerScan of the DZX")


def test_distances_of_a_dzx_and_one_that_contradicts_itself(tmp_path):
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None], per_metre=0.0)
    dzx(path, first="<distance>1.0</distance>", second="<distance>2.0</distance>")
    read = read_gpr(path)
    np.testing.assert_allclose(read.distance, 0.1 * np.arange(TRACES) + 0.1)
    assert notes_with(read, "2 distances of the DZX are used")
    dzx(path, first="<localCoords>0,0,0</localCoords>", second="<localCoords>0,5,0</localCoords>")
    assert read_gpr(path).distance is None
    assert notes_with(
        read_gpr(path), "contradicts itself: its scans are 0.05 m apart by unitsPerScan and 0.5 m"
    )

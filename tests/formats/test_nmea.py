"""Logs of satellite receivers as they are: one bad sentence costs that sentence, and is counted."""

import math

import numpy as np
import pytest

from flgpr.formats import read_nmea
from flgpr.formats.nmea import SentenceCounts, heading_of, position_of, sentences_of
from flgpr.formats.tracks import nmea_places
from flgpr.geo import anchor_from_fixes, fit_anchor
from io_gpr import closed

COUNT = 12
NORTH = 5e-7  # degrees, some 5.6 cm
PLACES = 48 + NORTH * np.arange(COUNT)


def fix(k, altitude="500.000", separation="46.000"):
    minutes = (PLACES[k] - 48) * 60
    cells = f"48{minutes:010.7f},N,01100.0000000,E,4,12,0.7,{altitude},M,{separation},M,1.0,0000"
    return closed(f"$GNGGA,1000{k:02d}.00,{cells}")


GOOD = [fix(k) for k in range(COUNT)]


@pytest.fixture
def anchor():
    position = [(11.0, 48.0), (11.0, 48.0005)]
    return fit_anchor([(0, 0, 0), (0, 55.597, 0)], position, "EPSG:4326", 0.05, [546.0, 546.0])


def put(lines, folder):
    path = folder / "t.nmea"
    data = [line if isinstance(line, bytes) else line.encode() for line in lines]
    path.write_bytes(b"\r\n".join(data) + b"\r\n")
    return path


FLAWS = {
    "the last line is cut": [*GOOD[:-1], GOOD[-1][:35]],
    "cut within the checksum": [*GOOD[:-1], GOOD[-1][:-1]],
    "a byte is changed": [*GOOD[:3], GOOD[3].replace("4800", "48~0"), *GOOD[4:]],
    "a digit is changed": [*GOOD[:3], GOOD[3].replace("01100", "01700"), *GOOD[4:]],
    "the first has no height": [fix(0, altitude=""), *GOOD[1:]],
    "no position at first": [closed("$GNGGA,100000.00,,,,,0,00,99,,M,,M,,"), *GOOD[1:]],
    "a comment": ["# a log", *GOOD],
    "a clock before each": [f"2026-01-02 10:00:00.000 {line}" for line in GOOD],
    "bytes of another protocol": [GOOD[0], b"\xb5b\x01\x07\x04\x00abcd\x12\x34", *GOOD[1:]],
    "two on a line": [GOOD[0] + GOOD[1], *GOOD[2:]],
    "another rule's sums": [line[:-2] + "00" for line in GOOD],
    "no sums": [line.split("*")[0] for line in GOOD],
}


@pytest.mark.parametrize("flaw", FLAWS)
def test_a_flaw_costs_no_more_than_its_sentence(flaw, anchor, tmp_path):
    track = read_nmea(put(FLAWS[flaw], tmp_path), anchor)
    assert len(track) >= COUNT - 1
    expected = (track["time"] - 36000) * NORTH * 111_195
    np.testing.assert_allclose(track["y"], expected, atol=2e-3)
    np.testing.assert_allclose(track["x"], 0, atol=1e-6)
    lost = COUNT - len(track)
    words = ("left out", "no height and are not used", "tell no position")
    told = [n for n in track.attrs["notes"] if n[0] == str(lost) and any(w in n for w in words)]
    assert len(told) == (lost > 0)
    assert any("no sentence has one" in n for n in track.attrs["notes"]) == ("sums" in flaw)


@pytest.mark.parametrize(
    "sentence", ["$GNHDT,20.0,T", "$GNTHS,20.0,A", "$PASHR,100000.00,20.0,T,0,0,0,0,0,0,1,1",
                 "$PTNL,AVR,100000.00,20.0,Yaw,0.1,Tilt,,,1.0,3,1.4,16"]
)  # fmt: skip
def test_every_usual_sentence_of_a_heading_is_read(sentence, anchor, tmp_path):
    lost = sentence.replace("20.0", "")
    lines = []
    for k, line in enumerate(GOOD):
        lines += [line, closed(lost if 3 <= k < 5 else sentence)]
    track = read_nmea(put(lines, tmp_path), anchor)
    np.testing.assert_allclose(np.degrees(track["heading"]), 20, atol=0.01)
    assert "2 sentences tell no heading" in "\n".join(track.attrs["notes"])


def test_heights_over_the_sea_alone_need_an_anchor_of_the_log(anchor, tmp_path):
    path = put([fix(k, separation="") for k in range(COUNT)], tmp_path)
    with pytest.raises(ValueError, match="no GGA tells the separation of the geoid"):
        read_nmea(path, anchor)
    own, _ = anchor_from_fixes(nmea_places(path))
    np.testing.assert_allclose(read_nmea(path, own)["z"], 0, atol=1e-6)
    some = put([fix(k, separation="" if k == 2 else "46.0") for k in range(COUNT)], tmp_path)
    track = read_nmea(some, anchor)
    np.testing.assert_allclose(track["z"], 0, atol=1e-3)
    assert any("1 of 12 fixes of t.nmea tell no separation" in n for n in track.attrs["notes"])


def test_what_is_no_position_and_no_heading():
    counts = SentenceCounts()
    texts = ["$GPGGA,120000,48,X,11,E,4,8,1,1,M", "$GPTHS,10,V", "$GPGGA,1,-48,N,11,E,4,8,1,1,M"]
    found = [one for _, _, one in sentences_of(texts, ("GGA", "THS"), counts)]
    assert [position_of(one) for one in found if one.kind == "GGA"] == [None, None]
    assert heading_of(found[1]) is None
    assert counts == SentenceCounts(3, 0, 3)


def test_a_position_in_feet():
    (found,) = sentences_of(
        ["$GPGGA,120000,4800.0,N,01100.0,W,4,8,1,100,F,10,F"], ("GGA",), SentenceCounts()
    )
    position = position_of(found[2])
    assert position.longitude == -11
    assert math.isclose(position.altitude + position.separation, 110 * 0.3048)


@pytest.mark.parametrize("kind", ["AVR", "PASHR"])
def test_a_heading_with_a_time_of_its_own_is_not_that_of_the_last_fix(kind, anchor, tmp_path):
    """A vehicle turns by 20 degrees a second past midnight; positions come once a second."""
    begin = 86400 - 4.0
    lines = []
    for tenth in range(80):
        seconds = (begin + tenth / 10) % 86400
        clock = f"{seconds // 3600:02.0f}{seconds // 60 % 60:02.0f}{seconds % 60:05.2f}"
        if tenth % 10 == 0:
            lines.append(closed(GOOD[0].split("*")[0].replace("100000.00", clock)))
        cells = {
            "AVR": f"$PTNL,AVR,{clock},{2 * tenth:.4f},Yaw,,,,,,3,1.0,10",
            "PASHR": f"$PASHR,{clock},{2 * tenth:.4f},T,0,0,0,0.1,0.1,0.1,2,3",
        }
        lines.append(closed(cells[kind]))
    track = read_nmea(put(lines, tmp_path), anchor)
    assert np.diff(track["time"]) == pytest.approx(1)
    turned = np.degrees(np.unwrap(track["heading"].to_numpy() + anchor.azimuth))
    assert turned == pytest.approx(20 * np.arange(8), abs=0.1)


def test_headings_without_a_time_are_those_of_the_fix_before_once(anchor, tmp_path):
    lines = []
    for k in range(4):
        lines += [GOOD[k], *(closed(f"$GNHDT,{10 * k + tenth:.1f},T") for tenth in range(10))]
    track = read_nmea(put(lines, tmp_path), anchor)
    heading = np.degrees(track["heading"].to_numpy() + anchor.azimuth)
    assert heading == pytest.approx(10 * np.arange(4))
    assert "36 of 40 headings state no time, or one that came before" in "".join(
        track.attrs["notes"]
    )


def test_one_wrong_fix_turns_no_heading_beside_it(anchor, tmp_path):
    lines = [*GOOD[:5], fix(5, altitude="500.000"), *GOOD[6:]]
    lines[5] = closed(lines[5].split("*")[0].replace("01100.0000000", "01100.0060000"))
    track = read_nmea(put(lines, tmp_path), anchor)
    assert np.degrees(track["heading"].to_numpy()) == pytest.approx(0, abs=0.5)

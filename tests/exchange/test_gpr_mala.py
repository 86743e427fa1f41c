"""MALÅ's RD3 and RD7 and ImpulseRadar's IPRB: sampling, steps, clocks and sample types."""

import numpy as np
import pytest

from flgpr.formats import channels_run, read_gpr, survey_run
from flgpr.geo.anchor import anchor_at
from io_gpr import INTERVAL, SAMPLES, STEP, ZERO, write_impulse, write_mala
from io_recordings import ALONG, COUNTS, TRACES


def has_note(read, words):
    return any(words in note for note in read.history)


def test_the_header_has_the_rate_in_megahertz(tmp_path):
    read = read_gpr(write_mala(tmp_path / "a.rd3", COUNTS))
    np.testing.assert_allclose(read.delay, INTERVAL * np.arange(SAMPLES), rtol=1e-12)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    np.testing.assert_allclose(read.distance, ALONG)
    assert read.title == "meadow"
    assert read.time is None
    with pytest.raises(ValueError, match="SAMPLES must be a number from 2 to"):
        read_gpr(write_mala(tmp_path / "b.rd3", COUNTS, SAMPLES=1))


def test_an_rd7_has_samples_of_32_bits(tmp_path):
    wide = COUNTS.astype(np.int64) * 2**15
    read = read_gpr(write_mala(tmp_path / "a.rd7", wide))
    np.testing.assert_array_equal(read.traces[:, 0], wide)


def test_without_a_wheel_there_is_no_step(tmp_path):
    read = read_gpr(write_mala(tmp_path / "a.rd3", COUNTS, DISTANCE_FLAG=0, TIME_FLAG=1))
    assert read.distance is None
    assert has_note(read, "DISTANCE FLAG is 0: no wheel was used, and DISTANCE INTERVAL (0.05 m)")
    np.testing.assert_allclose(read.time, 0.1 * np.arange(TRACES))
    timed = write_impulse(tmp_path / "a.iprb", COUNTS, TRIG_SOURCE="time")
    assert read_gpr(timed).distance is None


def test_the_users_step_goes_before_that_of_the_wheel(tmp_path):
    path = write_impulse(tmp_path / "a.iprb", COUNTS, USER_DISTANCE_INTERVAL=2 * STEP)
    read = read_gpr(path)
    np.testing.assert_allclose(read.distance, 2 * ALONG)
    assert has_note(read, "by USER DISTANCE INTERVAL in the header")


def test_impulse_radars_time_zero_and_bits(tmp_path):
    read = read_gpr(write_impulse(tmp_path / "a.iprb", COUNTS, bits=32))
    assert read.delay[ZERO] == 0
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    with pytest.raises(ValueError, match=r"b\.iprh: DATA VERSION must be 16 or 32, got 24"):
        read_gpr(write_impulse(tmp_path / "b.iprb", COUNTS, DATA_VERSION=24))
    unknown = read_gpr(write_impulse(tmp_path / "c.iprb", COUNTS, DATA_VERSION=""))
    assert has_note(unknown, "no DATA VERSION: samples are read as 16 bit")


def side_by_side(*channels):
    return np.stack(channels, axis=1).reshape(-1, SAMPLES)


@pytest.mark.parametrize(("write", "name", "entry"), [
    (write_mala, "a.rd3", "NUMBER_OF_CH"), (write_mala, "a.rd7", "NUMBER_OF_CH"),
    (write_impulse, "a.iprb", "CHANNELS"),
])  # fmt: skip
def test_channels_of_one_file_come_apart(write, name, entry, tmp_path):
    channels = [COUNTS, COUNTS // 2, -COUNTS]
    path = write(tmp_path / name, side_by_side(*channels))
    header = next(one for one in tmp_path.iterdir() if one != path)
    header.write_text(
        f"{header.read_text()}\n{entry}: 3\nCH_X_OFFSETS: -0.1 0.0 0.1\nCH_Y_OFFSETS: 0 0.02 0\n"
    )
    read = read_gpr(path)
    for channel, counts in enumerate(channels):
        np.testing.assert_array_equal(read.traces[:, channel], counts)
    np.testing.assert_allclose(read.distance, ALONG)
    np.testing.assert_allclose(read.offsets, [[-0.1, 0], [0, 0.02], [0.1, 0]])
    assert any(f"{entry} tells 3 channels" in note for note in read.history)
    run = channels_run(read)
    np.testing.assert_allclose(run["tx_position"].values[:, 0], [-0.1, 0, 0.1])
    moved = channels_run(read, [0, 1, 2])
    np.testing.assert_allclose(moved["tx_position"].values[:, 0], [0, 1, 2])
    assert any("in place of the file's, -0.1, 0, 0.1 m" in n for n in moved.attrs["import_notes"])


def test_a_file_of_each_channel_stays_one_channel(tmp_path):
    path = write_mala(tmp_path / "a.rd3", COUNTS, **{"NUMBER_OF_CH": 3, "CH_X_OFFSETS": "0 1 2"})
    path.with_suffix(".RAD").write_text(
        path.with_suffix(".RAD").read_text().replace("NUMBER OF CH", "NUMBER_OF_CH")
    )
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert any("recorders write that have a file for each" in note for note in read.history)


def mala_of(path, counts, **entries):
    write_mala(path, counts, **entries)
    header = path.with_suffix(".RAD")
    header.write_text(header.read_text().replace("NUMBER OF CH", "NUMBER_OF_CH"))
    return read_gpr(path)


def test_like_channels_come_apart_by_the_number_of_places(tmp_path):
    many = {"NUMBER_OF_CH": 2, "LAST_TRACE": len(COUNTS)}
    read = mala_of(tmp_path / "a.rd3", side_by_side(COUNTS, COUNTS), **many)
    np.testing.assert_array_equal(read.traces[:, 1], COUNTS)
    np.testing.assert_allclose(read.distance, ALONG)
    assert not has_note(read, "LAST TRACE")


def test_noise_in_a_file_of_one_channel_is_of_one_channel(tmp_path):
    noise = np.random.default_rng(1).integers(-3000, 3000, COUNTS.shape)
    read = mala_of(tmp_path / "line_C01.rd3", noise, **{"NUMBER_OF_CH": 2})
    np.testing.assert_array_equal(read.traces[:, 0], noise)
    assert has_note(read, "recorders write that have a file for each")


def test_files_of_channels_share_positions_and_lie_side_by_side(tmp_path):
    """A file for each channel, positions common to all: the survey is as wide as the antennas."""
    sections = []
    for k, x in enumerate((-0.3, 0.3)):
        path = write_impulse(tmp_path / f"line_A{k + 1:02d}.iprb", COUNTS)
        header = path.with_suffix(".iprh")
        header.write_text(f"{header.read_text()}\nCH_X_OFFSET: {x}\nCH_Y_OFFSET: 0\n")
        rows = [
            f"{n + 1}\t2026-01-02\t10:00:{n:02d}\t{47 + 1e-5 * n}\tN\t11\tE\t5" for n in range(9)
        ]
        (tmp_path / "line.cor").write_text("\n".join(rows))
        sections.append(read_gpr(path))
    assert [len(one.fixes) for one in sections] == [9, 9]
    assert any("line.cor, common to the channels" in note for note in sections[0].history)
    run = survey_run(sections)
    count = len(COUNTS)
    np.testing.assert_allclose(run["pose"].values[:count, 0], -0.3)
    np.testing.assert_allclose(run["pose"].values[count:, 0], 0.3)
    np.testing.assert_allclose(run["tx_position"].values[:, 0], 0)
    anchor = anchor_at((11.0, 47.0, 0.0), np.pi / 2)
    placed = survey_run(sections, anchor=anchor)["pose"].values
    np.testing.assert_allclose(placed[:9, 0] - placed[9:18, 0], 0, atol=1e-6)
    np.testing.assert_allclose(placed[:9, 1] - placed[9:18, 1], -0.6, atol=1e-6)

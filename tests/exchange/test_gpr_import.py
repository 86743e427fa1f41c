"""The run of a recording: phases of the echoes, places, and what is given in place of the headers."""

from dataclasses import replace

import numpy as np
import pytest

from flgpr.formats import channels_run, gpr_run, read_gpr
from flgpr.geo import fit_anchor
from flgpr_exchange.commands.imports import import_gpr
from io_geodesy import LANE, on_the_ellipsoid
from io_gpr import (
    INTERVAL,
    REFLECTORS,
    SEPARATION,
    STEP,
    ZERO,
    delay_of,
    section,
    write_dt1,
    write_dzt,
    write_ids,
    write_impulse,
    write_mala,
    write_segy,
)
from io_recordings import patched

COUNTS = section()


ALONG = STEP * np.arange(len(COUNTS))


WRITERS = {
    "a.DT1": write_dt1,
    "f.dt1": lambda path, counts: write_dt1(path, counts, real=True),
    "big.dt1": lambda path, counts: write_dt1(path, counts, order=">"),
    "a.dzt": lambda path, counts: write_dzt(path, counts[:, None]),
    "w.DZT": lambda path, counts: write_dzt(path, counts[:, None], bits=32),
    "a.rd3": write_mala,
    "a.RD7": write_mala,
    "a.iprb": write_impulse,
    "w.iprb": lambda path, counts: write_impulse(path, counts, bits=32),
    "a.dt": write_ids,
    "u.DT": lambda path, counts: write_ids(path, counts, 2052, unsigned=32768),
    "a.sgy": write_segy,
    "i.sgy": lambda path, counts: write_segy(path, counts, code=1),
    "f.SEGY": lambda path, counts: write_segy(path, counts, code=5, order="<"),
    "l.sgy": lambda path, counts: write_segy(path, counts, code=2),
}


def written(name, folder, counts=COUNTS):
    return WRITERS[name](folder / name, counts)


@pytest.mark.parametrize("name", ["a.DT1", "a.dzt", "a.rd3", "a.iprb", "a.dt", "a.sgy"])
def test_the_runs_phases_are_those_of_the_echoes(name, tmp_path):
    """Matched to exp(-j2πft) of each reflector's own path, the tones of every trace peak at no other delay."""
    path = written(name, tmp_path)
    zero = None if name[-3:] in ("DT1", "dzt", "prb") else ZERO * INTERVAL
    run = gpr_run(read_gpr(path), band=(150e6, 1e9), separation=SEPARATION, time_zero=zero)
    np.testing.assert_allclose(
        run["rx_position"].values[0] - run["tx_position"].values[0], [0, SEPARATION, 0]
    )
    np.testing.assert_allclose(run["pose"].values[:, 1], ALONG, atol=1e-5)
    tones = run["frequency"].values
    field = run["signal"].values[:, 0, 0]
    late = np.linspace(-2e-9, 2e-9, 81)
    for k, (x, _) in enumerate(REFLECTORS):
        trace = round(x / STEP)
        when = delay_of(ALONG)[trace, k] + late
        # A Ricker pulse has a real, positive spectrum, so that no phase but the delay's is left.
        matched = (field[trace] * np.exp(2j * np.pi * tones * when[:, None])).sum(axis=1).real
        assert abs(late[matched.argmax()]) < 0.051e-9


def test_traces_come_back_from_the_run(tmp_path):
    run = gpr_run(read_gpr(written("a.DT1", tmp_path)), band=(20e6, 2.4e9))
    count = run.attrs["samples"]
    start = run.attrs["first_sample_s"]
    time = start + np.arange(count) * run.attrs["time_window_s"] / count
    tones = run["frequency"].values
    back = (
        2
        / count
        * (run["signal"].values[:, 0, 0] @ np.exp(2j * np.pi * np.outer(tones, time))).real
    )
    np.testing.assert_allclose(back, COUNTS, atol=0.01 * COUNTS.max())
    assert run.attrs["sounding"] == "ground-coupled"


def test_what_is_given_stands_in_place_of_the_headers(tmp_path):
    read = read_gpr(written("a.rd3", tmp_path))
    options = {
        "step": 0.1,
        "time_zero": 3e-9,
        "window": 100e-9,
        "separation": 0.5,
        "across": True,
        "height": 0.4,
    }
    run = gpr_run(read, **options, polarization="VV")
    np.testing.assert_allclose(
        run["pose"].values[:, 1:3], np.stack([2 * ALONG, np.full(40, 0.4)], axis=1)
    )
    np.testing.assert_allclose(run["rx_position"].values, [[0.25, 0, 0]])
    assert list(run["polarization"].values) == ["VV"]
    attrs = run.attrs
    assert (attrs["sounding"], attrs["first_sample_s"]) == ("air-launched", -3e-9)
    assert attrs["time_window_s"] == pytest.approx(100e-9)
    with pytest.raises(ValueError, match="band must lie between"):
        gpr_run(read, band=(1e8, 3e9))
    with pytest.raises(ValueError, match="step must be"):
        gpr_run(read, step=0.0)
    with pytest.raises(ValueError, match="not be negative"):
        gpr_run(read, height=-1.0)
    with pytest.raises(ValueError, match="fit into"):
        gpr_run(replace(read, max_memory=1000))


def test_a_line_without_places_needs_a_step(tmp_path):
    read = read_gpr(write_dzt(tmp_path / "a.dzt", COUNTS[:, None], per_metre=0.0))
    assert read.distance is None
    np.testing.assert_allclose(read.time, np.arange(40) / 50)
    with pytest.raises(
        ValueError, match=r"a\.dzt: its headers tell no trace spacing: give the step"
    ):
        gpr_run(read)
    assert gpr_run(read, step=0.1)["pose"].values[-1, 1] == pytest.approx(3.9)
    with pytest.raises(ValueError, match="an anchor needs positions of two traces or more, got 0"):
        gpr_run(read, anchor=fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02))
    timed = read_gpr(write_mala(tmp_path / "b.rd3", COUNTS, DISTANCE_FLAG=0))
    assert timed.distance is None
    back = read_gpr(write_dt1(tmp_path / "c.dt1", COUNTS, step=-STEP))
    np.testing.assert_allclose(back.distance, ALONG, atol=1e-5)


def test_an_antenna_that_the_sampling_cannot_hold_makes_no_band(tmp_path):
    """400 MHz in samples 4 ns apart, which hold up to 125 MHz."""
    path = write_dt1(tmp_path / "a.dt1", section(6), TOTAL_TIME_WINDOW=1024, NOMINAL_FREQUENCY=400)
    run = gpr_run(read_gpr(path))
    notes = run.attrs["import_notes"]
    assert any("an antenna of 400 MHz does not fit samples 4 ns apart" in note for note in notes)
    assert any(
        "all that is recorded, which hardly holds any of the antenna's" in note for note in notes
    )
    assert np.ptp(run["frequency"].values) > 50e6


def test_channels_that_differ_in_time_zero_alone_go_together(tmp_path):
    """5.2 ns in place of 4: the windows are equal, and the tones but for their rounding."""
    path = write_dzt(tmp_path / "a.dzt", np.stack([COUNTS, COUNTS], axis=1), names=("50400",) * 2)
    patched(path, (1024 + 22, "<f", -5.2))
    run = channels_run(read_gpr(path))
    assert run.sizes["pair"] == 2


def test_distances_along_the_line_do_not_go_with_places_on_the_earth(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    with pytest.raises(ValueError, match=r"mark-spacing .*an anchor puts the traces: give one"):
        import_gpr(path, tmp_path / "o.zarr", anchor_from_track=True, mark_spacing=1.0)
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)
    with pytest.raises(ValueError, match=r"step .*an anchor puts the traces .*got step 0\.1 m"):
        gpr_run(read_gpr(path), step=0.1, anchor=anchor)


def test_two_ways_to_tell_distances_are_refused(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    with pytest.raises(ValueError, match="step puts the traces, too: give one"):
        import_gpr(path, tmp_path / "o.zarr", step=0.1, mark_spacing=1.0)


def test_an_anchor_without_positions_says_what_became_of_them(tmp_path):
    path = write_mala(tmp_path / "a.rd3", COUNTS)
    rows = [f"{k + 1}\t2026-01-02\t10:00:00\tno place\tN\t11\tE\t5" for k in range(9)]
    path.with_suffix(".cor").write_text("\n".join(rows))
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)
    with pytest.raises(ValueError, match=r"got 0; 9 of 9 lines of a\.cor were not understood"):
        gpr_run(read_gpr(path), anchor=anchor)

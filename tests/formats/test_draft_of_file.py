"""The draft of a mapping for one file: axes, units, places, and what stays a guess."""

import re
import tomllib

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from flgpr.formats.explain import propose_mapping
from flgpr.formats.mapped import import_mapped


def test_the_axes_of_a_profile_are_not_swapped(tmp_path):
    """The layout of MCoRDS files: samples x scans, a fast time and the clock of the scans."""
    fast = np.linspace(0, 50e-9, 200)[:, None]
    slow = np.linspace(0, 10, 41)[None]
    savemat(tmp_path / "a.mat", {"Data": np.ones((200, 41)), "GPS_time": slow, "Time": fast})
    draft = propose_mapping(tmp_path / "a.mat")
    assert 'dims = ["sample", "scan"]' in draft
    assert '[samples]\nvariable = "Time"\nunit = "s?"' in draft
    assert '[time]\nvariable = "GPS_time"' in draft


def test_a_draft_takes_longitude_and_latitude_where_a_file_has_no_places_in_the_lane(tmp_path):
    scans = np.arange(41)
    arrays = {
        "Data": np.random.default_rng(3).normal(size=(200, 41)),
        "Time": np.linspace(0, 50e-9, 200)[:, None],
        "GPS_time": scans[None] / 4.0,
        "Latitude": (60 + scans * 1e-5)[None],
        "Longitude": np.full((1, 41), 8.0),
    }
    savemat(tmp_path / "a.mat", arrays)
    draft = propose_mapping(tmp_path / "a.mat").replace("band = []", "band = [0.1, 1.0]")
    answered = draft.replace('above_ground = "?"', "above_ground = 1.5")
    (tmp_path / "m.toml").write_text(re.sub(r'\?"', '"', answered))
    run = import_mapped(tmp_path / "m.toml", anchor_from_track=True).run
    way = run["pose"].values[:, 1]
    np.testing.assert_allclose(np.diff(way), 1e-5 * 111_412, rtol=1e-3)  # m of a degree at 60 N


def test_a_line_break_in_the_name_of_a_file_ends_no_comment(tmp_path):
    path = tmp_path / "a\nfoo = 1.npz"
    np.savez(path, data=np.ones((200, 41)), time=np.linspace(0, 50e-9, 200))
    draft = propose_mapping(path)
    assert draft.startswith("# Draft for a\\nfoo = 1.npz. ")
    assert "foo" not in tomllib.loads(draft)


def test_axes_of_one_length_are_both_guesses(tmp_path):
    fast, slow = np.linspace(0, 50e-9, 200), np.linspace(0, 10, 200)
    np.savez(tmp_path / "a.npz", data=np.ones((200, 200)), time=fast, gps_time=slow)
    draft = propose_mapping(tmp_path / "a.npz")
    assert 'dims = ["scan?", "sample?"]' in draft


def test_a_time_of_the_samples_is_no_clock_of_the_scans(tmp_path):
    """Two times as long as the samples, as ImpDAR keeps them, and none as long as the scans."""
    arrays = {"data": np.ones((200, 41)), "twtt": np.linspace(0, 5e-8, 200)}
    savemat(tmp_path / "a.mat", arrays | {"travel_time": np.linspace(0, 0.05, 200)})
    draft = propose_mapping(tmp_path / "a.mat")
    assert 'dims = ["sample", "scan?"]' in draft
    assert "[time]" not in draft


@pytest.mark.parametrize("turned", [False, True])
def test_a_time_that_may_be_either_is_a_guess(turned, tmp_path):
    data = np.ones((41, 20)).T if turned else np.ones((41, 20))
    np.savez(tmp_path / "a.npz", data=data, time=np.linspace(0, 10, 41))
    draft = propose_mapping(tmp_path / "a.npz")
    assert '"sample?"' in draft
    assert 'variable = "time?"' in draft
    np.savez(tmp_path / "b.npz", data=data, time=np.linspace(0, 5e-8, 41))
    assert '"sample"' in propose_mapping(tmp_path / "b.npz")


def put(text, path):
    path.write_text(text, encoding="utf-8")
    return path


def test_stated_units_are_no_guesses(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["radar/field"] = np.ones((4, 7), np.complex64)
        file["radar/frequency"] = np.linspace(0.5, 3, 7)
        file["radar/frequency"].attrs["units"] = "GHz"
        file["radar/time_ms"] = np.arange(4.0)
    draft = propose_mapping(tmp_path / "a.h5")
    assert 'unit = "GHz"' in draft
    assert 'unit = "ms"' in draft
    assert 'dims = ["scan", "frequency"]' in draft


def test_impulse_data_and_separate_parts_are_seen(tmp_path):
    np.savez(tmp_path / "p.npz", trace=np.ones((5, 64)), t_ns=np.arange(64.0))
    draft = propose_mapping(tmp_path / "p.npz")
    assert "[samples]" in draft
    assert 'unit = "ns"' in draft
    np.savez(
        tmp_path / "q.npz",
        s_real=np.ones((5, 64)),
        s_imag=np.ones((5, 64)),
        freq_hz=1e9 + np.arange(64.0),
    )
    assert 'imaginary = "s_imag"' in propose_mapping(tmp_path / "q.npz")


TONES = 1e9 + 1e7 * np.arange(7)


def drafted(tmp_path, **arrays):
    """Import by a file's own draft, all of whose guesses are taken for right."""
    arrays = {"data": np.ones((5, 7), complex), "freq_hz": TONES} | arrays
    np.savez(tmp_path / "a.npz", **arrays)
    draft = propose_mapping(tmp_path / "a.npz")
    run = import_mapped(put(draft.replace("?", ""), tmp_path / "m.toml"), tmp_path / "a.npz").run
    return run["pose"].values, draft


WAY = np.column_stack([np.zeros(5), 2.0 * np.arange(5), np.full(5, 1.5)])


@pytest.mark.parametrize(
    ("arrays", "lines"),
    [
        ({"pos": WAY}, ['position = {variable = "pos", unit = "m?"}', 'heading = "course?"']),
        (
            {"pos_mm": 1e3 * WAY, "t": np.arange(5.0)},
            ['{variable = "pos_mm", unit = "mm"}', '["scan", "frequency"]'],
        ),
        (
            {"pos_ft": WAY / 0.3048, "yaw_deg": np.zeros(5)},
            ['heading = "yaw_deg?"', 'angle_unit = "deg"', 'unit = "ft"'],
        ),
        (
            {"x_m": WAY[:, 0], "da_m": WAY[:, 1], "z_m": WAY[:, 2]},
            ['x = "x_m"', 'y = "da_m?"', 'unit = "m"'],
        ),
        (
            {"x_m": WAY[:, 0], "y_m": WAY[:, 1], "height_m": WAY[:, 2]},
            ['y = "y_m"', 'z = "height_m?"', 'unit = "m"'],
        ),
        ({"x": WAY[:, 0], "y": WAY[:, 1], "z": WAY[:, 2]}, ['x = "x"', 'y = "y"', 'unit = "m?"']),
        (
            {"gps": np.column_stack([WAY, np.zeros((5, 3))])},
            ['position = {variable = "gps"', 'angle_unit = "rad?"'],
        ),
    ],
)
def test_a_plain_file_needs_only_its_guesses_checked(arrays, lines, tmp_path):
    pose, draft = drafted(tmp_path, **arrays)
    np.testing.assert_allclose(pose, np.column_stack([WAY, np.zeros((5, 3))]), atol=1e-12)
    for line in lines:
        assert line in draft


def test_units_that_differ_are_not_made_one(tmp_path):
    np.savez(
        tmp_path / "a.npz",
        data=np.ones((5, 7), complex),
        freq_hz=TONES,
        x_m=WAY[:, 0],
        y_cm=WAY[:, 1],
    )
    assert 'z = "0?"\nunit = "?"' in propose_mapping(tmp_path / "a.npz")


def test_antennas_are_not_taken_for_the_vehicle(tmp_path):
    np.savez(
        tmp_path / "a.npz",
        data=np.ones((5, 2, 7), complex),
        freq_hz=TONES,
        pos=WAY,
        antenna_pos=np.zeros((2, 3)),
    )
    draft = propose_mapping(tmp_path / "a.npz")
    assert tomllib.loads(draft)["antenna_position"]["variable"] == "antenna_pos"
    assert 'position = {variable = "pos"' in draft
    assert 'dims = ["scan", "pair", "frequency"]' in draft


def test_fixes_of_a_receiver_beside_the_signal_are_a_track(tmp_path):
    np.savez(
        tmp_path / "a.npz",
        data=np.ones((5, 7), complex),
        freq_hz=TONES,
        t_s=np.arange(5.0),
        gps_lat=52 + 1e-5 * np.arange(30),
        gps_lon=np.full(30, 13.0),
        gps_time_s=np.arange(-5.0, 25.0),
    )
    draft = propose_mapping(tmp_path / "a.npz")
    assert "[track]  # 30 fixes of 5 scans" in draft
    answered = draft.replace('above_ground = "?"', "above_ground = 1.5")
    (tmp_path / "m.toml").write_text(answered.replace("?", ""))
    run = import_mapped(tmp_path / "m.toml", anchor_from_track=True).run
    np.testing.assert_allclose(np.diff(run["pose"].values[:, 1]), 1.11, rtol=1e-2)

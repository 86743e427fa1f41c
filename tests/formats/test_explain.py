import re

import h5py
import numpy as np
import pytest

from flgpr.formats import import_fullwave
from flgpr.formats.explain import explain_file, propose_mapping
from flgpr.formats.mapped import import_mapped
from flgpr.formats.mapping import parse_mapping


def put(text, path):
    path.write_text(text, encoding="utf-8")
    return path


def test_a_full_wave_archive_needs_only_its_guesses_checked(fullwave_archive, tmp_path):
    draft = propose_mapping(fullwave_archive)
    with pytest.raises(ValueError, match=r"lane\?|frame"):
        parse_mapping(draft)
    checked = put(draft.replace("?", ""), tmp_path / "m.toml")
    run = import_mapped(checked, fullwave_archive).run
    want = import_fullwave(fullwave_archive).run
    for name in want.variables:
        if want[name].dtype.kind in "fc":
            np.testing.assert_allclose(run[name].values, want[name].values, rtol=0, atol=1e-15)
        else:
            np.testing.assert_array_equal(run[name].values, want[name].values)


def test_guessed_units_stop_an_import(tmp_path):
    tones = np.linspace(500, 3000, 7)
    np.savez(
        tmp_path / "a.npz",
        field=np.ones((7, 2), complex),
        f=tones,
        tx=np.zeros((2, 3)),
        rx=np.zeros((2, 3)),
    )
    draft = propose_mapping(tmp_path / "a.npz")
    assert 'unit = "MHz?"' in draft
    assert 'dims = ["frequency", "pair"]' in draft
    text = re.sub(r'= "\?"', "= 0", draft).replace('["HH?"]', '["HH"]')
    with pytest.raises(ValueError, match="guess, got 'MHz\\?'"):
        import_mapped(put(text, tmp_path / "m.toml"), tmp_path / "a.npz")
    run = import_mapped(put(text.replace("?", ""), tmp_path / "m.toml"), tmp_path / "a.npz").run
    np.testing.assert_allclose(run["frequency"].values, tones * 1e6)


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


def test_content_is_told_in_words(tmp_path):
    np.savez(tmp_path / "a.npz", field=np.array([[3 + 4j, np.nan]]), name=np.array("x"))
    told = explain_file(tmp_path / "a.npz")
    assert told.kind == "NumPy archive"
    assert told.lines[0] == "field: 1 x 2 complex128, magnitude 5 to 5, 1 not finite"
    log = put("$GPGGA,1,2*33\n$GPGGA,1,2*33\n$GPHDT,3,T*11\n", tmp_path / "n.log")
    assert explain_file(log).lines[0] == "2 GGA, 1 HDT"
    with pytest.raises(ValueError, match="without a mapping"):
        propose_mapping(log)
    with pytest.raises(FileNotFoundError):
        explain_file(tmp_path / "no")


def test_a_cphd_file_is_told(small_run, tmp_path):
    pytest.importorskip("sarkit")
    from flgpr.formats.cphd import write_cphd
    from flgpr.geo.anchor import fit_anchor
    from io_geodesy import LANE, on_the_ellipsoid

    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02)
    told = explain_file(write_cphd(small_run, tmp_path / "a.cphd", anchor))
    assert told.lines[0] == "4 channels of 4 vectors x 5 samples, FX domain"
    assert "HH, VV" in told.lines[1]
    assert "anchor" not in told.lines[2]


TONES = 1e9 + 1e7 * np.arange(7)


def drafted(tmp_path, **arrays):
    """Import by a file's own draft, all of whose guesses are taken for right."""
    arrays = {"data": np.ones((5, 7), complex), "freq_hz": TONES} | arrays
    np.savez(tmp_path / "a.npz", **arrays)
    draft = propose_mapping(tmp_path / "a.npz")
    return import_mapped(put(draft.replace("?", ""), tmp_path / "m.toml"), tmp_path / "a.npz").run[
        "pose"
    ].values, draft


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
    assert '[antenna_position]\nvariable = "antenna_pos"' in draft
    assert 'position = {variable = "pos"' in draft
    assert 'dims = ["scan", "pair", "frequency"]' in draft

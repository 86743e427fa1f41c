"""Tones have a phase, or they are refused; magnitude and phase, and parts along an axis, can be mapped."""

import numpy as np
import pytest

from flgpr.formats import import_mapped, propose_mapping
from flgpr.formats.arrays import open_arrays

SCANS, TONES = 7, 16
RNG = np.random.default_rng(0)
SIGNAL = (
    0.1
    * np.exp(2j * np.pi * RNG.uniform(size=(SCANS, TONES)))
    * RNG.uniform(0.5, 1, (SCANS, TONES))
)

MAPPING = """
title = "t"
files.data = "a.npz"
polarization = ["HH"]
[signal]
SIGNAL
[frequency]
span = [1.0, 2.0]
unit = "GHz"
[antenna_position]
values = [[0, 0, 0]]
unit = "m"
[pose]
x = 0
y = "y"
z = 1
unit = "m"
heading = 0
pitch = 0
roll = 0
angle_unit = "rad"
"""


def imported(folder, signal, arrays, dims='["scan", "frequency"]'):
    np.savez(folder / "a.npz", y=np.arange(SCANS) * 0.1, **arrays)
    path = folder / "m.toml"
    path.write_text(MAPPING.replace("SIGNAL", f"{signal}\ndims = {dims}"))
    return import_mapped(path)


DECIBELS = 20 * np.log10(np.abs(SIGNAL))


@pytest.mark.parametrize(
    ("magnitude", "form"), [(DECIBELS, "dB"), (np.abs(SIGNAL), "linear")]
)  # fmt: skip
@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_magnitude_and_phase_are_complex_tones(magnitude, form, unit, tmp_path):
    phase = np.angle(SIGNAL, deg=unit == "deg")
    entries = f'variable = "m"\nmagnitude = "{form}"\nphase = "p"\nphase_unit = "{unit}"'
    run = imported(tmp_path, entries, {"m": magnitude, "p": phase}).run
    np.testing.assert_allclose(run["signal"].values[:, 0, 0], SIGNAL, rtol=1e-5)


@pytest.mark.parametrize("values", [DECIBELS, np.abs(SIGNAL), (100 * SIGNAL.real).astype("i2")])
def test_tones_without_a_phase_are_refused(values, tmp_path):
    with pytest.raises(ValueError, match="must hold complex tones: without a phase"):
        imported(tmp_path, 'variable = "m"', {"m": values})


@pytest.mark.parametrize("unit", ["degrees", "radians"])
def test_a_phase_taken_for_an_imaginary_part_is_told(unit, tmp_path):
    signal = np.exp(2j * np.pi * RNG.uniform(size=(SCANS, TONES)))
    arrays = {"m": DECIBELS, "p": np.angle(signal, deg=unit == "degrees")}
    notes = imported(tmp_path, 'variable = "m"\nimaginary = "p"', arrays).notes
    assert [f"and a phase in {unit}?" in note for note in notes if "one sign" in note] == [True]
    parts = {"m": SIGNAL.real, "p": SIGNAL.imag}
    notes = imported(tmp_path, 'variable = "m"\nimaginary = "p"', parts).notes
    assert not [note for note in notes if "one sign" in note]


@pytest.mark.parametrize("kind", ["one array", "an axis"])
def test_decibels_and_degrees_in_complex_numbers_are_told(kind, tmp_path):
    parts = np.stack([DECIBELS, np.angle(SIGNAL, deg=True)], axis=-1)
    if kind == "one array":
        notes = imported(
            tmp_path, 'variable = "m"', {"m": parts[..., 0] + 1j * parts[..., 1]}
        ).notes
    else:
        dims = '["scan", "frequency", "complex"]'
        notes = imported(tmp_path, 'variable = "m"', {"m": parts}, dims).notes
    assert [note for note in notes if "a phase in degrees?" in note]
    assert not [
        note for note in imported(tmp_path, 'variable = "m"', {"m": SIGNAL}).notes if "?" in note
    ]


@pytest.mark.parametrize(
    ("magnitude", "values", "stated", "words"),
    [
        ("dB", DECIBELS, "deg", "phase_unit is deg, and phases reach 3.1"),
        ("dB", DECIBELS, "rad", "phase_unit is rad, and phases reach 1"),
        (
            "linear",
            DECIBELS,
            "",
            "signal.magnitude is linear, and 100% of the magnitudes are negative",
        ),
    ],
)
def test_magnitudes_and_phases_of_another_unit_are_told(magnitude, values, stated, words, tmp_path):
    in_degrees = stated != "deg"
    unit = stated or "deg"
    arrays = {"m": values, "p": np.angle(SIGNAL, deg=in_degrees)}
    entries = f'variable = "m"\nmagnitude = "{magnitude}"\nphase = "p"\nphase_unit = "{unit}"'
    assert [note for note in imported(tmp_path, entries, arrays).notes if words in note]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_of_real_and_imaginary_parts(axis, tmp_path):
    parts = np.stack([SIGNAL.real, SIGNAL.imag], axis=axis)
    dims = ["scan", "frequency"]
    dims.insert(axis, "complex")
    text = str(dims).replace("'", '"')
    run = imported(tmp_path, 'variable = "m"', {"m": parts}, text).run
    np.testing.assert_allclose(run["signal"].values[:, 0, 0], SIGNAL, rtol=1e-5)
    with pytest.raises(ValueError, match="the axis called complex must hold two real numbers"):
        imported(tmp_path, 'variable = "m"', {"m": np.zeros((3, 3, 3))}, text)


@pytest.mark.parametrize(
    ("entries", "words"),
    [('magnitude = "dB"', "go together"), ('phase = "p"\nphase_unit = "deg"', "go together"),
     ('imaginary = "p"\nmagnitude = "dB"\nphase = "p"\nphase_unit = "deg"', "give one of")],
)  # fmt: skip
def test_forms_that_contradict_one_another(entries, words, tmp_path):
    with pytest.raises(ValueError, match=words):
        imported(tmp_path, f'variable = "m"\n{entries}', {"m": DECIBELS, "p": DECIBELS})


@pytest.mark.parametrize(
    ("names", "form", "unit"),
    [(("S21 Log Mag(dB)", "S21 Phase(deg)"), "dB", "deg"), (("S21(MAG)", "S21(ANG)"), "linear", "deg"),
     (("mag_db", "phase_rad"), "dB", "rad"), (("amplitude", "angle"), "linear", "deg")],
)  # fmt: skip
def test_tables_of_network_analysers_are_drafted(names, form, unit, tmp_path):
    rows = [",".join(["Freq(Hz)", *names])]
    for tone, value in zip(np.linspace(1e9, 2e9, TONES), SIGNAL[0], strict=True):
        rows.append(f"{tone:.1f},{20 * np.log10(abs(value)):.5f},{np.angle(value, deg=True):.4f}")
    path = tmp_path / "sweep.csv"
    path.write_text("!CSV A.10\nBEGIN CH1_DATA\n" + "\n".join(rows) + "\nEND\n")
    draft = propose_mapping(path)
    for line in (f'variable = "{names[0]}"', f'magnitude = "{form}?"', f'phase = "{names[1]}"'):
        assert line in draft
    assert f'phase_unit = "{unit}?"' in draft
    assert 'variable = "Freq(Hz)"' in draft


def test_arrays_saved_one_after_the_other(tmp_path):
    path = tmp_path / "a.npy"
    with path.open("wb") as file:
        np.save(file, SIGNAL)
        np.save(file, np.arange(SCANS))
    opened = open_arrays(path)
    assert list(opened.arrays) == ["array", "array_2"]
    np.testing.assert_array_equal(opened.read("array"), SIGNAL)
    np.testing.assert_array_equal(opened.read("array_2"), np.arange(SCANS))
    assert opened.about == ["2 arrays, saved one after the other"]
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(ValueError, match="its header tells"):
        open_arrays(path)

"""Sweeps of a network analyser: no tone is lost, whatever their order and what follows them."""

import numpy as np
import pytest

from flgpr.formats.arrays import open_arrays


def touchstone(frequencies, ports=2, noise=0, option="# MHz S RI R 50"):
    rows = []
    for f in frequencies:
        values = [f"{f / 1000 + k} {-k}" for k in range(ports**2)]
        rows.append(f"{f} " + " ".join(values) + " ! a tone")
    rows += [f"{100 + k} 1.0 0.5 10 0.2" for k in range(noise)]
    return "\n".join(["! made", option, *rows]) + "\n"


@pytest.mark.parametrize("ports", [1, 2, 3])
def test_a_sweep_from_high_to_low_loses_no_tone(ports, tmp_path):
    pytest.importorskip("skrf")
    up = [100, 200, 300, 400, 500]
    for name, frequencies in (("up", up), ("down", up[::-1]), ("mixed", [300, 100, 500, 200, 400])):
        path = tmp_path / f"{name}.s{ports}p"
        path.write_text(touchstone(frequencies, ports))
        opened = open_arrays(path)
        np.testing.assert_allclose(opened.read("frequency"), 1e6 * np.array(up))
        np.testing.assert_allclose(opened.read("s")[:, 0, 0].real, np.array(up) / 1000)
        assert bool(opened.notes) == (name != "up")
    assert opened.notes == ["its 5 tones do not rise: they are put in the order of frequency"]


def test_noise_behind_a_sweep_is_told_and_what_is_cut_off_refused(tmp_path):
    pytest.importorskip("skrf")
    path = tmp_path / "a.s2p"
    path.write_text(touchstone([500, 600], noise=3))
    opened = open_arrays(path)
    np.testing.assert_allclose(opened.read("frequency"), [5e8, 6e8])
    assert opened.notes == ["3 lines of noise parameters are not read"]
    path.write_text(touchstone([500, 600]).replace(" 3.6 -3", "", 1))
    with pytest.raises(ValueError, match="its numbers must be 9 for every tone of 2 ports, got 16"):
        open_arrays(path)
    path.write_bytes(touchstone([600, 500]).encode("utf-16"))
    assert "a.s2p is text in UTF-16" in open_arrays(path).notes


def test_version_2_says_itself_where_noise_begins(tmp_path):
    pytest.importorskip("skrf")
    keywords = (
        "[Version] 2.0\n# Hz S RI R 50\n[Number of Ports] 1\n[Number of Frequencies] 3\n[Network Data]\n"
        "1e9 0.1 0\n2e9 0.2 0\n3e9 0.3 0\n[End]\n"
    )
    path = tmp_path / "a.ts"
    path.write_text(keywords)
    np.testing.assert_allclose(open_arrays(path).read("frequency"), [1e9, 2e9, 3e9])
    path.write_text(keywords.replace("Frequencies] 3", "Frequencies] 4"))
    with pytest.raises(
        ValueError, match="it holds 4 tones, of which the scikit-rf library reads 3"
    ):
        open_arrays(path)


def test_a_file_without_an_option_line_tells_what_is_taken(tmp_path):
    path = tmp_path / "a.s2p"
    path.write_text(touchstone([1, 2], option="! none"))
    opened = open_arrays(path)
    np.testing.assert_allclose(opened.read("frequency"), [1e9, 2e9])
    assert any("it has no option line: frequencies are taken in GHz" in n for n in opened.notes)
    path.write_text(touchstone([1, 2]))
    assert not open_arrays(path).notes


@pytest.mark.parametrize("option", ["# S MHZ RI", "# mhz ri s r 50", "# R 50 MHz S RI", "# MHz RI"])
def test_an_option_line_may_have_any_order(option, tmp_path):
    path = tmp_path / "a.s2p"
    path.write_text(touchstone([100, 200], option=option))
    opened = open_arrays(path)
    np.testing.assert_allclose(opened.read("frequency"), [1e8, 2e8])
    np.testing.assert_allclose(opened.read("s21"), [1.1 - 1j, 1.2 - 1j])
    assert not opened.notes

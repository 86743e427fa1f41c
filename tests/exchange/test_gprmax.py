"""What is read of gprMax's results: waveforms of its sources."""

import numpy as np
import pytest

from flgpr_exchange.gprmax.output import pulse


def test_waveforms_are_those_of_gprmax():
    time = np.linspace(0, 4e-9, 4001)
    for kind, top in (("gaussian", 1.0), ("gaussiandotnorm", 1.0), ("ricker", 1.0)):
        assert np.abs(pulse(kind, 1e9, time)).max() == pytest.approx(top, abs=1e-4)
    slope = np.gradient(pulse("gaussian", 1e9, time), time)
    np.testing.assert_allclose(
        pulse("gaussiandot", 1e9, time), slope, atol=2e-3 * np.abs(slope).max()
    )


def test_an_unknown_waveform_is_refused_with_those_there_are():
    with pytest.raises(ValueError, match=r"waveform must be .*, got 'square'"):
        pulse("square", 1e9, np.zeros(3))

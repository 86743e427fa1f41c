import numpy as np
import pytest

from flgpr.model import check_run, complete_scans, make_run

FREQUENCY = 1e9 + 1e7 * np.arange(5)


def parts(**changes):
    base = {
        "signal": np.ones((3, 2, 4, 5), complex),
        "frequency": FREQUENCY,
        "polarization": ["HH", "VV"],
        "tx_position": np.zeros((4, 3)),
        "rx_position": np.ones((4, 3)),
        "pose": np.zeros((3, 6)),
    }
    return base | changes


def test_run_has_the_documented_dimensions_and_types():
    run = make_run(**parts(), time=[1, 2, 3], attrs={"a": 1})
    assert run["signal"].dims == ("scan", "polarization", "pair", "frequency")
    assert run["signal"].dtype == np.complex64
    assert list(run["polarization"].values) == ["HH", "VV"]
    assert run.attrs == {"a": 1}
    assert run["valid"].values.all()
    assert check_run(run) is run


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"frequency": FREQUENCY / 1e9}, ["frequency", "hertz", "GHz"]),
        ({"frequency": FREQUENCY / 1e6}, ["frequency", "hertz", "MHz"]),
        ({"frequency": FREQUENCY[::-1]}, ["frequency", "increase"]),
        ({"frequency": FREQUENCY[:4]}, ["frequency", "5 tones"]),
        ({"frequency": np.where(np.arange(5) == 2, np.nan, FREQUENCY)}, ["frequency", "finite"]),
        ({"polarization": ["HH", "LR"]}, ["polarization", "'LR'"]),
        ({"polarization": ["HH", "HH"]}, ["polarization", "different"]),
        ({"polarization": ["HH"]}, ["polarization", "2"]),
        ({"pose": None}, ["pose", "none"]),
        ({"pose": np.zeros((2, 6))}, ["pose", "(3, 6)"]),
        (
            {"pose": np.where(np.arange(18).reshape(3, 6) == 7, np.nan, 0)},
            ["pose", "missing", "scan 1"],
        ),
        ({"pose": np.full((3, 6), 90.0)}, ["pose", "degrees"]),
        ({"tx_position": np.zeros((3, 3))}, ["tx_position", "(4, 3)"]),
        ({"rx_position": np.full((4, 3), np.inf)}, ["rx_position", "finite"]),
        ({"signal": np.ones((2, 4, 5))}, ["signal", "scan, polarization, pair, frequency"]),
        ({"signal": np.ones((0, 2, 4, 5)), "pose": np.zeros((0, 6))}, ["signal", "at least one"]),
        ({"signal": np.full((3, 2, 4, 5), np.nan)}, ["signal", "none"]),
        ({"signal": np.full((3, 2, 4, 5), "a")}, ["signal", "complex"]),
        ({"time": [2.0, 1.0, 3.0]}, ["time", "decrease"]),
    ],
)
def test_bad_input_names_parameter_and_rule(changes, words):
    with pytest.raises(ValueError) as error:
        make_run(**parts(**changes))
    for word in words:
        assert word in str(error.value)


def test_a_sweep_of_nan_is_kept_and_flagged():
    signal = np.ones((3, 2, 4, 5), complex)
    signal[1, 0, 2, 3] = np.nan
    signal[1, 1, 0, 0] = np.inf
    run = make_run(**parts(signal=signal))
    assert np.count_nonzero(~run["valid"].values) == 2
    assert complete_scans(run).tolist() == [True, False, True]
    assert np.isnan(run["signal"].values[1, 0, 2, 3])


def test_a_scan_of_zeros_beside_others_was_not_measured():
    signal = np.ones((3, 2, 4, 5), complex)
    signal[0, 0] = 0  # a polarization
    signal[1] = 0
    assert complete_scans(make_run(**parts(signal=signal))).tolist() == [True, False, True]
    assert make_run(**parts(signal=0 * signal))["valid"].values.all()


def test_check_run_names_what_is_missing():
    with pytest.raises(ValueError, match="missing: pose"):
        check_run(make_run(**parts()).drop_vars("pose"))

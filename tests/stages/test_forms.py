"""Maps by linear-quadratic forms, trained on cuts at mines and clutter away from them."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from flgpr.detect import magnitude_form
from flgpr.detect.scorers.checks import Checked
from flgpr.stages.forms import (
    CutSettings,
    DeflectionMap,
    MagnitudeMap,
    WhiteningMap,
    learnt_of,
    samples_at,
)
from flgpr.stages.too_few import TooFewExamplesError

SETTINGS = CutSettings(length=6, clutter_step=(3, 3), search=0.0)
X = np.linspace(-2, 2, 41)
Y = np.linspace(3, 7, 41)
MINES = np.array([[0.0, 5.0], [9.0, 5.0]])


def band(seed=1):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(2, 41, 41)) + 1j * rng.normal(size=(2, 41, 41))
    coords = {"polarization": ["HH", "VV"], "y": Y, "x": X}
    return xr.DataArray(values.astype(np.complex64), coords, ("polarization", "y", "x"))


def examples(looks=8):
    rng = np.random.default_rng(2)
    samples = samples_at(band(), MINES, SETTINGS)
    target = rng.normal(size=(looks, 12)) + 1j * rng.normal(size=(looks, 12)) + 3
    return {"target": target, "clutter": samples.clutter, "pixel": samples.pixel}


def test_mines_outside_the_image_give_no_cut_and_clutter_keeps_clear():
    samples = samples_at(band(), MINES, SETTINGS)
    assert samples.target.shape == (1, 12)
    inside = (X[:, None] ** 2 + (Y - 5.0) ** 2 < 1.0).T
    values = np.where(inside, 1e6, band().values)
    clean = samples_at(band().copy(data=values.astype(np.complex64)), MINES, SETTINGS)
    assert np.abs(clean.clutter).max() < 1e3
    assert np.abs(clean.pixel).max() < 1e3


def test_the_power_of_the_first_polarization_is_counted_in_deviations_of_clutter():
    """As plain HH in Cosgrove et al. 2004, Sec. IV."""
    learnt, notes = MagnitudeMap.fit(SETTINGS, [examples()])
    assert notes == {"looks_at_mines": 8, "clutter_samples": len(examples()["clutter"])}
    power = magnitude_form(2, 0)(examples()["pixel"])
    np.testing.assert_allclose(learnt["clutter"], [power.min(), power.std()])
    stage = MagnitudeMap(SETTINGS, SimpleNamespace(), learnt)
    image = band(3).expand_dims(subband=["F1"], axis=1)
    own = band(3).values.reshape(2, -1).T.astype(np.complex128)
    wanted = (magnitude_form(2, 0)(own) - power.min()) / power.std()
    np.testing.assert_allclose(stage.map(image).ravel(), wanted, rtol=1e-4, atol=1e-4)


def test_the_constants_of_all_forms_and_the_scale_of_clutter_are_learnt():
    form = magnitude_form(2, 0)
    clutter = np.array([[1.0, 0.0], [3.0, 0.0]])
    learnt = learnt_of([form, form], clutter)
    assert len(learnt["constant"]) == 2
    assert {"strength-0", "vectors-1", "linear-1", "offset-0"} <= learnt.keys()
    values = form(clutter)
    np.testing.assert_allclose(learnt["clutter"], [values.min(), values.std()])


def test_what_was_learnt_is_checked_against_the_chip():
    learnt, _ = WhiteningMap.fit(SETTINGS, [examples()])
    WhiteningMap.check_learnt(SETTINGS, None, Checked({}, learnt))
    with pytest.raises(ValueError, match=r"array 'vectors-0' must have the shape"):
        DeflectionMap.check_learnt(SETTINGS, None, Checked({}, learnt))
    many = learnt | {"constant": np.zeros(65)}
    with pytest.raises(ValueError, match="array 'constant' must be of 1 to 64 forms, got 65"):
        WhiteningMap.check_learnt(SETTINGS, None, Checked({}, many))


def test_too_few_looks_and_unknown_estimators_are_refused():
    with pytest.raises(TooFewExamplesError, match="2 looks at targets or more, got 1"):
        DeflectionMap.fit(SETTINGS, [examples(looks=1)])
    with pytest.raises(ValueError, match=r"moments must be one of .*, got 'median'"):
        CutSettings(moments="median")

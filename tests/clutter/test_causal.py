"""The background of the scans so far against that of the plain functions."""

import numpy as np
import pytest
from drive_images import SHAPE, WINDOWS

from flgpr.clutter import BackgroundEstimator, CausalBackground, scan_gain, self_signature


def test_the_causal_self_signature_is_that_of_the_scans_before(scans):
    causal = CausalBackground(*WINDOWS, step=1, warm_up=4)
    for k, image in enumerate(scans):
        gain, background = causal.add(image)
        np.testing.assert_allclose(gain, scan_gain(image)[..., 0, 0], rtol=1e-6)
        if k < 3:
            assert background is None
            continue
        np.testing.assert_allclose(background.signature, self_signature(scans[:k]), atol=1e-5)
    whole = BackgroundEstimator(*WINDOWS)
    for image in scans:
        whole.add_signature(image)
    for image in scans:
        whole.add_gain(image)
    assert 0.5 < (background.gain / whole.result().gain).mean() < 1.5
    assert (background.shared_gain > 0).all()


@pytest.mark.parametrize("ask", ["learn", "state", "restore"])
def test_what_is_learnt_does_not_hang_on_when(scans, ask):
    late, early = (CausalBackground(*WINDOWS, warm_up=3) for _ in range(2))
    for image in scans:
        (_, want), (_, got) = late.add(image), early.add(image)
        assert (want is None) == (got is None)
        for name, value in vars(want).items() if want else ():
            np.testing.assert_array_equal(getattr(got, name), value)
        getattr(early, ask.replace("restore", "state"))()
        if ask == "restore":
            state = early.state()
            early = CausalBackground(*WINDOWS, warm_up=3)
            early.restore(state)


def test_a_span_follows_a_self_signature_that_changes():
    rng = np.random.default_rng(9)
    fixed = rng.normal(size=(2, *SHAPE)) + 1j * rng.normal(size=(2, *SHAPE))
    noise = [0.1 * rng.normal(size=SHAPE) for _ in range(40)]
    left = {}
    for span in (None, 5):
        causal = CausalBackground(*WINDOWS, span=span)
        for k, one in enumerate(noise):
            gain, background = causal.add((fixed[int(k >= 20)] + one).astype(np.complex64))
        left[span] = np.abs(
            (fixed[1] + noise[-1]) / gain[..., None, None] - background.signature
        ).mean()
    assert left[5] < 0.3 * left[None]


def test_a_scan_with_an_infinite_pixel_spoils_no_others(scans):
    causal = CausalBackground(*WINDOWS, warm_up=3)
    other = CausalBackground(*WINDOWS, warm_up=3)
    huge = scans[0].copy()
    huge[..., -1, -1] = np.inf
    for image in scans:
        causal.add(image)
        with pytest.raises(ValueError, match="finite"):
            causal.add(huge)
        other.add(image)
    for name, value in other.state().items():
        np.testing.assert_array_equal(causal.state()[name], value)


@pytest.mark.parametrize("entry", [{"warm_up": 2}, {"span": 1}])
def test_too_few_scans_are_refused(entry):
    (name,) = entry
    with pytest.raises(ValueError, match=f"{name} must be at least"):
        CausalBackground(**entry)

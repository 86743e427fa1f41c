import numpy as np
import pytest

from flgpr.simulate.ground.soil import (
    mironov,
    one_way_loss,
    peplinski,
    peplinski_conductivity,
    topp,
)
from flgpr.simulate.scene.scene import Soil


@pytest.mark.parametrize(
    ("clay", "moisture", "want"), [(3.0, 0.03, 3.43 - 0.21j), (40.0, 0.25, 10.7 - 1.64j)]
)
def test_mironov_at_the_checked_points(clay, moisture, want):
    got = mironov(1.05e9, clay, moisture).item()
    assert got.real == pytest.approx(want.real, rel=5e-3)
    assert got.imag == pytest.approx(want.imag, rel=2e-2)


def test_permittivity_and_loss_grow_with_moisture():
    eps = np.array([mironov(1e9, 10, m).item() for m in np.linspace(0.0, 0.3, 20)])
    assert (np.diff(eps.real) > 0).all()
    assert (np.diff(-eps.imag) > 0).all()


def test_topp_is_its_polynomial():
    assert topp(0.0).real == pytest.approx(3.03)
    assert topp(0.2).real == pytest.approx(3.03 + 1.86 + 5.84 - 0.6136)


def test_peplinski_is_wrong_for_arid_sand():
    assert peplinski_conductivity(sand=97, clay=3) < 0


def test_peplinski_for_loam_by_hand():
    """Sand 40 %, clay 20 %, m = 0.2: ε_s = 4.692, β' = 1.0368, ε_fw ≈ 79.9, so 1.15·5.03^(1/0.65) - 0.68 = 13.1."""
    assert peplinski(1.0e9, 40, 20, 0.2).item().real == pytest.approx(13.1, abs=0.1)


def test_one_way_loss_is_close_to_the_rule_of_thumb():
    eps = 3.4 * (1 - 0.02j)
    assert one_way_loss(1e9, eps) == pytest.approx(91 * np.sqrt(3.4) * 0.02, rel=0.01)


def test_a_scene_can_override_the_loss_tangent():
    soil = Soil(model="mironov", clay=3, moisture=0.03, loss_tangent=0.01)
    eps = soil.media(np.array([1e9]))[0][0]
    assert -eps.imag / eps.real == pytest.approx(0.01)


@pytest.mark.parametrize("moisture", [-0.1, 0.9])
def test_moisture_out_of_range_is_refused(moisture):
    with pytest.raises(ValueError, match="moisture"):
        mironov(1e9, 10, moisture)

"""Grounds of a site or of constants, and what is refused."""

import numpy as np
import pytest

from flgpr.design import ground_model


def test_ground_models():
    site = ground_model("temperate", rms_height=0.002)
    assert site.surface.rms_height == 0.002
    assert site.surface.unevenness == ground_model("temperate").surface.unevenness
    fixed = ground_model("temperate", permittivity=9.0, loss_tangent=0.02)
    np.testing.assert_allclose(fixed.soil.media(np.array([1e9])), [[9 - 0.18j]])
    assert fixed.surface == ground_model("temperate").surface
    less = ground_model("temperate", loss_tangent=0.01).soil.media(np.array([1e9]))[0][0]
    assert -less.imag / less.real == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({}, "site or permittivity must be given"),
        (
            {"permittivity": 5.0},
            "loss_tangent must be given with permittivity, got permittivity 5 alone",
        ),
        ({"site": "moon"}, "site must be one of .*'moon'"),
        ({"site": "gravel", "rms_height": -1e-3}, "surface.rms_height.*-0.001"),
        ({"permittivity": 0.5, "loss_tangent": 0.0}, "soil.permittivity.*0.5"),
    ],
)
def test_faults_of_grounds(asked, words):
    with pytest.raises(ValueError, match=words):
        ground_model(**asked)

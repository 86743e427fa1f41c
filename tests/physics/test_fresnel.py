"""Measured dielectric cylinders in air (Institut Fresnel 2005): where they are and how large, by focus.

FoamDielExt, E along the cylinders: a foam cylinder of 80 mm diameter at the centre (permittivity about 1.45) and,
touching it, a plastic one of 31 mm (about 3), so that their axes are 55.5 mm apart (Geffrin, Sabouroux & Eyraud,
Inverse Problems 21 (2005) S117-S130). Source and receivers stand 1.67 m from the centre in one plane.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from flgpr.clutter import subtract_run
from flgpr.formats.mapped import import_mapped
from flgpr.imaging import ImagingOperator

DISTANCE = 1.67  # m, of source and receivers from the centre
# m, radii
FOAM = 0.0400
PLASTIC = 0.0155
APART = FOAM + PLASTIC
PIXEL = 0.002
SIDE = np.arange(-0.12, 0.12 + PIXEL / 2, PIXEL)


def circle(degrees):
    """Places on the circle, x, y, z in m."""
    angle = np.radians(degrees)
    return (DISTANCE * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)).tolist()


def mapping(variable, conjugate):
    """Write the mapping of one field: source and receivers are told as turning in opposite senses."""
    return f"""
title = "FoamDielExt TM, {variable}"
files.data = "foamdielexttm.npz"
polarization = ["VV"]
[signal]
variable = "{variable}"
dims = ["tx", "rx", "frequency"]
conjugate = {str(conjugate).lower()}   # the institute's phase is exp(+jkL)
[frequency]
variable = "frequency_hz"
unit = "Hz"
[tx_position]
values = {circle(45.0 * np.arange(8))}
unit = "m"
[rx_position]
values = {circle(-np.arange(360.0))}
unit = "m"
[pose]
x = 0
y = 0
z = 0
unit = "m"
heading = 0
pitch = 0
roll = 0
angle_unit = "deg"
"""


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """Import a field, ``total`` or ``incident``, by its mapping."""
    folder = Path(os.environ.get("FLGPR_MEASURED_DATA", "")) / "fresnel"
    if not os.environ.get("FLGPR_MEASURED_DATA") or not folder.is_dir():
        pytest.skip("FLGPR_MEASURED_DATA has no fresnel folder")
    home = tmp_path_factory.mktemp("fresnel")

    def read(variable, conjugate=True):
        path = home / f"{variable}.toml"
        path.write_text(mapping(variable, conjugate))
        return import_mapped(path, folder=folder).run

    return read


def image(run):
    """Focus the pairs that were measured, in the plane; |image| with y down the rows and x along them."""
    measured = run["valid"].values[0, 0]
    operator = ImagingOperator(
        run["frequency"].values,
        run["tx_position"].values[measured],
        run["rx_position"].values[measured],
        np.stack([*np.meshgrid(SIDE, SIDE), np.zeros((SIDE.size, SIDE.size))], axis=-1),
    )
    return np.abs(operator.adjoint(run["signal"].values[0][:, measured])[0, 0])


@pytest.fixture(scope="module")
def echo(field):
    return image(subtract_run(field("total"), field("incident")))


def brightest(picture):
    row, column = np.unravel_index(picture.argmax(), picture.shape)
    return SIDE[column], SIDE[row]


def contrast(picture):
    """How far the brightest pixel stands over the median, dB."""
    return 20 * np.log10(picture.max() / np.median(picture))


def edge(line, start, step):
    """Where a line of pixels falls to half of its value at ``start``, between pixels, m."""
    here = start
    while line[here + step] > line[start] / 2:
        here += step
    part = (line[here] - line[start] / 2) / (line[here] - line[here + step])
    return SIDE[here] + step * PIXEL * part


def test_what_was_not_measured_is_missing_and_the_rest_is_all_there(field):
    """Within 60 degrees of the source there are no receivers: 241 of 360 are left."""
    run = field("total")
    assert run["signal"].sizes["pair"] == 8 * 360
    assert run["valid"].values[0, 0].reshape(8, 360).sum(axis=1).tolist() == [241] * 8


def test_the_plastic_cylinder_is_brightest_where_it_touches_the_foam(echo):
    x, y = brightest(echo)
    assert (x, y) == pytest.approx((APART, 0.0), abs=0.003)
    assert contrast(echo) > 20


def test_the_radii_are_the_published_ones(echo):
    """The plastic by its width across the axis, the foam by its edge on the far side; resolution is some 10 mm."""
    centre = SIDE.size // 2
    column = int(np.abs(SIDE - APART).argmin())
    across = echo[:, column]
    assert (edge(across, centre, 1) - edge(across, centre, -1)) / 2 == pytest.approx(
        PLASTIC, abs=0.003
    )
    assert -edge(echo[centre], centre, -1) == pytest.approx(FOAM, abs=0.006)


def test_subtraction_takes_the_source_out_of_the_picture(field, echo):
    """The cylinder is seen without it, too, but half as far over all else: 12 dB in place of 25."""
    assert contrast(echo) - contrast(image(field("total"))) > 10


def test_with_the_other_phase_convention_the_cylinder_is_not_found(field):
    turned = image(subtract_run(field("total", False), field("incident", False)))
    assert np.hypot(brightest(turned)[0] - APART, brightest(turned)[1]) > 0.02

"""Tables of a scene that say what lies and grows in the ground beside the targets; none of it unless given."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from flgpr.simulate.tables import NotNegative, Part, Positive


def _ascending(span: tuple[float, float]) -> tuple[float, float]:
    if not 0 <= span[0] < span[1]:
        raise ValueError(f"must have 0 <= least < greatest, got {span}")
    return span


Span = Annotated[tuple[float, float], AfterValidator(_ascending)]


class Stones(Part):
    """Stones in the soil: a Poisson process over depth with a power law of radii."""

    on: bool = True  #: False takes them out, whatever the rest says
    density: NotNegative = 0.0  #: stones of at least the least radius per m² of ground, all depths together
    radius: Span = (0.01, 0.08)  #: least and greatest radius of the sphere of equal volume, m
    exponent: Positive = 2.5  #: D of ``N(>r) ~ r^-D`` (Turcotte 1986: about 2.5 for broken rock)
    depth: Positive = 0.4  #: they lie anywhere down to here, m, whole below the surface
    permittivity: Span = (4.5, 7.5)  #: each stone's is drawn between these (Ulaby et al. 1990: rocks by density)
    #: each stone is a spheroid whose axis is between 1/stretch and stretch times the others, in any direction
    stretch: Annotated[float, Field(ge=1)] = 1.8


class Roots(Part):
    """Coarse roots: thin moist cylinders that wind through the upper soil."""

    on: bool = True  #: False takes them out, whatever the rest says
    density: NotNegative = 0.0  #: roots per m²
    length: Annotated[float, Field(gt=0, le=2)] = 1.0  #: of each, m
    radius: Span = (0.002, 0.01)  #: least and greatest, m; log-uniform between
    #: depth over which their number falls by e, m (Jackson et al. 1996: 0.17 in temperate grassland, 0.29 in forest)
    depth: Positive = 0.17
    plunge: NotNegative = 0.2  #: rms inclination, rad
    #: permittivity, loss_tangent: of the moist wood (Mavrovic et al. 2018 for living wood at L band)
    permittivity: Annotated[float, Field(ge=1)] = 22.0
    loss_tangent: NotNegative = 0.25


class Lenses(Part):
    """Moisture lenses: flat round bodies of soil with other water than around them."""

    on: bool = True  #: False takes them out, whatever the rest says
    density: NotNegative = 0.0  #: lenses per m²
    radius: Span = (0.05, 0.25)  #: least and greatest radius, m
    depth: Span = (0.03, 0.3)  #: least and greatest depth, m
    thickness: Positive = 0.03  #: m
    contrast: NotNegative = 1.0  #: rms of the Gaussian difference of their permittivity, either sign


class Heterogeneity(Part):
    """Fluctuation of the soil's permittivity without bound: a Gaussian field of exponential correlation."""

    on: bool = True  #: False makes the soil even, whatever the rest says
    deviation: NotNegative = 0.0  #: standard deviation of ε'
    #: horizontal, vertical: correlation lengths, m (Igel 2008: a few decimetres along sandy soils)
    horizontal: Positive = 0.2
    vertical: Positive = 0.1
    depth: Positive = 0.4  #: down to where it scatters, m
    density: Positive | None = None  #: scatterers per m²; None takes a quarter of the surface's


class Holes(Part):
    """Holes dug and filled again, over targets and for nothing."""

    on: bool = True  #: False takes them out, whatever the rest says
    over: Annotated[float, Field(ge=0, le=1)] = 0.0  #: share of the buried targets that lie in one
    empty: NotNegative = 0.0  #: holes with nothing in them per m² of the lane
    margin: Span = (0.03, 0.12)  #: by how much the hole over a target is wider than it, m
    #: radius, depth: least and greatest radius and depth of the empty ones, m
    radius: Span = (0.18, 0.3)
    depth: Span = (0.1, 0.3)
    looseness: Span = (0.85, 0.97)  #: least and greatest density of the fill over that of the soil around it
    moisture: NotNegative = 0.02  #: rms change of the fill's volumetric moisture, m³/m³
    cap: NotNegative = 0.01  #: rms height by which the fill stands over the surface or is sunk below it, m
    wall: NotNegative = 0.01  #: rms unevenness of the wall, m
    rough_db: float = 2.0  #: by how much the fill's surface scatters more than that around it, dB

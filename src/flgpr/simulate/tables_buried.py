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
    """Stones in the soil: a Poisson process over depth with a power law of radii.

    Attributes
    ----------
    on : bool
        False takes them out, whatever the rest says.
    density : float
        Stones of at least the least radius per m² of ground, all depths together.
    radius : (float, float)
        Least and greatest radius of the sphere of equal volume, m.
    exponent : float
        D of ``N(>r) ~ r^-D`` (Turcotte 1986: about 2.5 for broken rock).
    depth : float
        They lie anywhere down to here, m, whole below the surface.
    permittivity : (float, float)
        Each stone's is drawn between these (Ulaby et al. 1990: rocks by density).
    stretch : float
        Each stone is a spheroid whose axis is between 1/stretch and stretch times the others, in any direction.
    """

    on: bool = True
    density: NotNegative = 0.0
    radius: Span = (0.01, 0.08)
    exponent: Positive = 2.5
    depth: Positive = 0.4
    permittivity: Span = (4.5, 7.5)
    stretch: Annotated[float, Field(ge=1)] = 1.8


class Roots(Part):
    """Coarse roots: thin moist cylinders that wind through the upper soil.

    Attributes
    ----------
    on : bool
        False takes them out, whatever the rest says.
    density : float
        Roots per m².
    length : float
        Of each, m.
    radius : (float, float)
        Least and greatest, m; log-uniform between.
    depth : float
        Depth over which their number falls by e, m (Jackson et al. 1996: 0.17 in temperate grassland, 0.29 in forest).
    plunge : float
        Rms inclination, rad.
    permittivity, loss_tangent : float
        Of the moist wood (Mavrovic et al. 2018 for living wood at L band).
    """

    on: bool = True
    density: NotNegative = 0.0
    length: Annotated[float, Field(gt=0, le=2)] = 1.0
    radius: Span = (0.002, 0.01)
    depth: Positive = 0.17
    plunge: NotNegative = 0.2
    permittivity: Annotated[float, Field(ge=1)] = 22.0
    loss_tangent: NotNegative = 0.25


class Lenses(Part):
    """Moisture lenses: flat round bodies of soil with other water than around them.

    Attributes
    ----------
    on : bool
        False takes them out, whatever the rest says.
    density : float
        Lenses per m².
    radius, depth : (float, float)
        Least and greatest radius and depth, m.
    thickness : float
        m.
    contrast : float
        Rms of the Gaussian difference of their permittivity, either sign.
    """

    on: bool = True
    density: NotNegative = 0.0
    radius: Span = (0.05, 0.25)
    depth: Span = (0.03, 0.3)
    thickness: Positive = 0.03
    contrast: NotNegative = 1.0


class Heterogeneity(Part):
    """Fluctuation of the soil's permittivity without bound: a Gaussian field of exponential correlation.

    Attributes
    ----------
    on : bool
        False makes the soil even, whatever the rest says.
    deviation : float
        Standard deviation of ε'.
    horizontal, vertical : float
        Correlation lengths, m (Igel 2008: a few decimetres along sandy soils).
    depth : float
        Down to where it scatters, m.
    density : float or None
        Scatterers per m²; None takes a quarter of the surface's.
    """

    on: bool = True
    deviation: NotNegative = 0.0
    horizontal: Positive = 0.2
    vertical: Positive = 0.1
    depth: Positive = 0.4
    density: Positive | None = None


class Holes(Part):
    """Holes dug and filled again, over targets and for nothing.

    Attributes
    ----------
    on : bool
        False takes them out, whatever the rest says.
    over : float
        Share of the buried targets that lie in one.
    empty : float
        Holes with nothing in them per m² of the lane.
    margin : (float, float)
        By how much the hole over a target is wider than it, m.
    radius, depth : (float, float)
        Least and greatest radius and depth of the empty ones, m.
    looseness : (float, float)
        Least and greatest density of the fill over that of the soil around it.
    moisture : float
        Rms change of the fill's volumetric moisture, m³/m³.
    cap : float
        Rms height by which the fill stands over the surface or is sunk below it, m.
    wall : float
        Rms unevenness of the wall, m.
    rough_db : float
        By how much the fill's surface scatters more than that around it, dB.
    """

    on: bool = True
    over: Annotated[float, Field(ge=0, le=1)] = 0.0
    empty: NotNegative = 0.0
    margin: Span = (0.03, 0.12)
    radius: Span = (0.18, 0.3)
    depth: Span = (0.1, 0.3)
    looseness: Span = (0.85, 0.97)
    moisture: NotNegative = 0.02
    cap: NotNegative = 0.01
    wall: NotNegative = 0.01
    rough_db: float = 2.0

"""Tables of a scene: the shape of the ground, what stands on it and what lies in it."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from flgpr.model.bounds import Decibels, Entries, Moderate, NotNegative, Positive, Share


def _ascending(span: tuple[float, float]) -> tuple[float, float]:
    """Return a span of least and greatest value, or raise a ValueError for another one."""
    least, greatest = span
    if not 0 <= least < greatest <= 50:
        raise ValueError(f"must have 0 <= least < greatest <= 50, got {span}")
    return span


Length = Annotated[float, Field(ge=1e-3, le=1000)]
Steepness = Annotated[float, Field(gt=-0.5, lt=0.5)]
Span = Annotated[tuple[float, float], AfterValidator(_ascending)]


class SceneTable(Entries):
    """A table of a scene.

    Unknown entries are errors, numbers have bounds, and nothing changes once the table is read.
    """


class Terrain(SceneTable):
    """The shape of the ground on scales above the surface's roughness.

    The ground is flat unless a slope, an undulation or ruts are given.
    """

    on: bool = True  #: False makes the ground flat, whatever the rest says
    #: slope_along, slope_across: rise of the mean ground towards +y and +x, rad, about the lane's
    #: middle
    slope_along: Steepness = 0.0
    slope_across: Steepness = 0.0
    #: undulation, undulation_length: rms height s and length l of undulation with correlation
    #: ``s²·exp(-r²/l²)``, m. ISO 8608's class C has 8 mm in waves of 3 to 30 m, D 17 mm and E 33
    #: mm; 2.1 m then gives their slopes
    undulation: Moderate = 0.0
    undulation_length: Annotated[float, Field(ge=0.2)] = 2.1
    #: rut_depth, rut_width, rut_spacing: depth, width at half the depth, and distance of the two
    #: wheel tracks along the lane, m
    rut_depth: Moderate = 0.0
    rut_width: Annotated[float, Field(ge=0.05)] = 0.3
    rut_spacing: Length = 1.6
    #: rut_wander, rut_wander_length: rms and length of the tracks' slow wandering, m, across the
    #: lane
    rut_wander: Moderate = 0.1
    rut_wander_length: Length = 20.0
    follow: bool = True  #: whether the vehicle rises, pitches and rolls with the ground
    wheelbase: Length = 3.0  #: distance of the axles, m; the wheels run ``rut_spacing`` apart

    @property
    def flat(self) -> bool:
        """Whether there is no relief at all."""
        relief = (self.slope_along, self.slope_across, self.undulation, self.rut_depth)
        return not self.on or not any(relief)


class Grass(SceneTable):
    """Grass over all of the ground: a layer of scatterers, and a loss for all that lies below.

    There is none unless a height is given.
    """

    on: bool = True  #: False mows it, whatever the rest says
    height: Annotated[float, Field(ge=0, le=2)] = 0.0  #: of the layer, m; 0 is no grass
    water: Moderate = 0.2  #: vegetation water content W, kg/m²
    #: b of the optical depth ``τ = b·W`` at nadir at 1.4 GHz, m²/kg (O'Neill et al. 2019: 0.13 for
    #: grassland); it grows as f (Schmugge & Jackson 1992)
    loss: Moderate = 0.13
    #: how much more V is lost than H where rays are level, ``τ_V = τ·(cos²θ + upright·sin²θ)``: 1
    #: for leaves of every direction, 2 for crops (Wigneron et al. 2017)
    upright: Moderate = 2.0
    #: albedo, growth: single-scattering albedo ω at 1.4 GHz, which sets the echo, and the power of
    #: frequency it grows with. Between 0 of SMOS's low vegetation (Fernandez-Moran et al. 2017) and
    #: 0.05 of grassland (Wigneron et al. 2017); growth is 0 for large and 3 for small particles, 1
    #: is assumed
    albedo: Share = 0.02
    growth: Annotated[float, Field(ge=0, le=3)] = 1.0
    cross_db: Decibels = -7.0  #: HV under HH, dB
    correlation: Share = 0.2  #: correlation of HH and VV
    texture_shape: Positive | None = 3.0  #: as of the surface
    texture_length: Annotated[float, Field(gt=0.05)] = 0.5  #: as of the surface
    density: Positive | None = None  #: scatterers per m²; None takes half of the surface's

    @property
    def grown(self) -> bool:
        """Whether there is any grass."""
        return self.on and self.height > 0


class Shadow(SceneTable):
    """Shadows behind posts, bushes, larger rocks and metal bodies on the ground."""

    on: bool = False  #: whether they are thrown
    #: one-way loss of a bush at 0.87 GHz, dB per metre of leaves: 12 dB, the median of single trees
    #: (Vogel & Goldhirsh 1986), over some 9 m of crown (assumed). It grows as the root of frequency
    #: (Goldhirsh & Vogel 1998)
    foliage: Moderate = 1.3


class Stones(SceneTable):
    """Stones in the soil: a Poisson process over depth with a power law of radii."""

    on: bool = True  #: False takes them out, whatever the rest says
    #: stones of at least the least radius per m² of ground, all depths together
    density: NotNegative = 0.0
    radius: Span = (0.01, 0.08)  #: least and greatest radius of the sphere of equal volume, m
    #: D of ``N(>r) ~ r^-D`` (Turcotte 1986: about 2.5 for broken rock)
    exponent: Annotated[float, Field(gt=0, le=100)] = 2.5
    depth: Length = 0.4  #: they lie anywhere down to here, m, whole below the surface
    #: least and greatest; each stone's is drawn between these (Ulaby et al. 1990: rocks by density)
    permittivity: Span = (4.5, 7.5)
    #: each stone is a spheroid whose axis is between 1/stretch and stretch times the others, in any
    #: direction
    stretch: Annotated[float, Field(ge=1, le=100)] = 1.8


class Roots(SceneTable):
    """Coarse roots: thin moist cylinders that wind through the upper soil."""

    on: bool = True  #: False takes them out, whatever the rest says
    density: NotNegative = 0.0  #: roots per m²
    length: Annotated[float, Field(gt=0, le=2)] = 1.0  #: of each, m
    radius: Span = (0.002, 0.01)  #: least and greatest, m; log-uniform between
    #: depth over which their number falls by e, m (Jackson et al. 1996: 0.17 in temperate
    #: grassland, 0.29 in forest)
    depth: Length = 0.17
    plunge: Moderate = 0.2  #: rms inclination, rad
    #: permittivity, loss_tangent: of the moist wood (Mavrovic et al. 2018 for living wood at L
    #: band)
    permittivity: Annotated[float, Field(ge=1, le=1000)] = 22.0
    loss_tangent: Moderate = 0.25


class Lenses(SceneTable):
    """Moisture lenses: flat round bodies of soil with other water than around them."""

    on: bool = True  #: False takes them out, whatever the rest says
    density: NotNegative = 0.0  #: lenses per m²
    radius: Span = (0.05, 0.25)  #: least and greatest radius, m
    depth: Span = (0.03, 0.3)  #: least and greatest depth, m
    thickness: Length = 0.03  #: m
    contrast: Moderate = 1.0  #: rms of the Gaussian difference of their permittivity, either sign


class Heterogeneity(SceneTable):
    """Fluctuation of the soil's permittivity: a Gaussian field of exponential correlation."""

    on: bool = True  #: False makes the soil even, whatever the rest says
    deviation: Moderate = 0.0  #: standard deviation of ε'
    #: horizontal, vertical: correlation lengths, m (Igel 2008: a few decimetres along sandy soils)
    horizontal: Length = 0.2
    vertical: Length = 0.1
    depth: Length = 0.4  #: down to where it scatters, m
    density: Positive | None = None  #: scatterers per m²; None takes a quarter of the surface's


class Holes(SceneTable):
    """Holes dug and filled again, over targets and for nothing."""

    on: bool = True  #: False takes them out, whatever the rest says
    over: Share = 0.0  #: share of the buried targets that lie in one
    empty: NotNegative = 0.0  #: holes with nothing in them per m² of the lane
    margin: Span = (0.03, 0.12)  #: by how much the hole over a target is wider than it, m
    #: radius, depth: least and greatest radius and depth of the empty ones, m
    radius: Span = (0.18, 0.3)
    depth: Span = (0.1, 0.3)
    #: least and greatest density of the fill over that of the soil around it
    looseness: Span = (0.85, 0.97)
    moisture: NotNegative = 0.02  #: rms change of the fill's volumetric moisture, m³/m³
    #: rms height by which the fill stands over the surface or is sunk below it, m
    cap: Moderate = 0.01
    wall: Moderate = 0.01  #: rms unevenness of the wall, m
    #: by how much the fill's surface scatters more than that around it, dB
    rough_db: Decibels = 2.0

"""Scenes: what lies in and beside a lane, as validated TOML."""

from __future__ import annotations

import math
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field, NonNegativeInt, model_validator

from flgpr.door import read_named
from flgpr.model import Lane
from flgpr.model.bounds import Angle, Decibels, Moderate, NotNegative, Positive, Share
from flgpr.model.faults import parse_entries, preset_names
from flgpr.simulate.bodies.rims import Profile, cylinder
from flgpr.simulate.bodies.signature.table import body_size
from flgpr.simulate.ground import soil as soils
from flgpr.simulate.scene.scene_tables import (
    Grass,
    Heterogeneity,
    Holes,
    Lenses,
    Roots,
    SceneTable,
    Shadow,
    Stones,
    Terrain,
)
from flgpr.toml_text import parse_toml
from flgpr.types import AnyArray, ArrayLike, Complex128Array, FloatArray, floats

Percent = Annotated[float, Field(ge=0, le=100)]
Size = Annotated[float, Field(gt=0, le=100)]
Stride = Annotated[float, Field(ge=0.001, le=10_000)]
RoadsideDistance = Annotated[float, Field(ge=0, le=1000)]
DriveNumber = Annotated[int, Field(ge=1, le=1000)]
_SITES = resources.files("flgpr.simulate.scene") / "sites"


class Layer(SceneTable):
    """A layer of soil over the rest."""

    thickness: Positive  #: m
    moisture: Share  #: volumetric, m³/m³


_OF_MODEL = {
    "mironov": {"clay"},
    "peplinski": {"sand", "clay"},
    "topp": set[str](),
    "fixed": {"permittivity", "conductivity"},
}
"""Entries of a soil that a dielectric model takes, of those that not every model does."""
_NOT_FOR_ALL = set.union(*_OF_MODEL.values())


class Soil(SceneTable):
    """The soil's permittivity."""

    model: Literal["mironov", "topp", "peplinski", "fixed"] = "mironov"  #: dielectric model
    clay: Percent = 3.0  #: per cent by weight
    sand: Percent = 90.0  #: per cent by weight
    moisture: Share = 0.03  #: volumetric, m³/m³, below all layers
    layers: tuple[Layer, ...] = ()  #: layers of other moisture above, from the top down
    #: permittivity, conductivity: ε' and ohmic conductivity (S/m) of the model "fixed"
    permittivity: Annotated[float, Field(ge=1, le=1000)] = 3.0
    conductivity: Annotated[float, Field(ge=0, le=1000)] = 0.0
    #: overrides the model's loss when given
    loss_tangent: Moderate | None = None

    @model_validator(mode="after")
    def _check_model(self) -> Soil:
        """Refuse an entry that the model does not take, unless it is the default of all soils."""
        for name in sorted(_NOT_FOR_ALL - _OF_MODEL[self.model]):
            value = getattr(self, name)
            if value != type(self).model_fields[name].default:
                models = [model for model, taken in _OF_MODEL.items() if name in taken]
                raise ValueError(
                    f"{name} goes with the model {' or '.join(models)}, got {value:g} with model "
                    f"{self.model}"
                )
        return self

    def media(self, frequency: ArrayLike) -> list[Complex128Array]:
        """Return the complex permittivity of every layer, the half-space last.

        Parameters
        ----------
        frequency : array_like
            Frequencies, Hz.

        Returns
        -------
        list of ndarray of complex
            From the top down, each in the shape of ``frequency``.
        """
        f = floats(frequency)
        moistures = [layer.moisture for layer in self.layers]
        moistures.append(self.moisture)
        return [self._permittivity(f, moisture) for moisture in moistures]

    def thicknesses_above(self, depth: float) -> list[float]:
        """Return how much of every layer, the half-space last, lies above a depth, m.

        Parameters
        ----------
        depth : float
            Depth of a point below the surface, m.
        """
        above = []
        remaining = max(depth, 0.0)
        for layer in self.layers:
            thickness = min(layer.thickness, remaining)
            above.append(thickness)
            remaining -= thickness
        above.append(remaining)
        return above

    def wetter(self, moisture: float) -> Soil:
        """Return the soil with so much more water by volume in all its layers, m³/m³.

        Where the permittivity is given, the water takes the place of air by refractive mixing
        (Birchak et al. 1974), with 80 for that of water.
        """
        if moisture == 0:
            return self
        entries = self.model_dump(exclude_unset=True)
        if self.model == "fixed":
            index = math.sqrt(self.permittivity) + (math.sqrt(80) - 1) * moisture
            entries["permittivity"] = max(index, 1.0) ** 2
        entries["moisture"] = min(max(self.moisture + moisture, 0.0), 1.0)
        entries["layers"] = [
            {
                "thickness": layer.thickness,
                "moisture": min(max(layer.moisture + moisture, 0.0), 1.0),
            }
            for layer in self.layers
        ]
        return Soil.model_validate(entries)

    def _permittivity(self, f: FloatArray, moisture: float) -> Complex128Array:
        """Return the complex permittivity of a layer of the given moisture at frequencies ``f``."""
        if self.model == "mironov":
            eps: AnyArray = soils.mironov(f, self.clay, moisture)
        elif self.model == "peplinski":
            eps = soils.peplinski(f, self.sand, self.clay, moisture)
        elif self.model == "topp":
            eps = np.full(f.shape, soils.topp(moisture))
        else:
            eps = soils.fixed(f, self.permittivity, 0.0, self.conductivity)
        if self.loss_tangent is not None:
            eps = eps.real * (1 - 1j * self.loss_tangent)
        return eps


class Surface(SceneTable):
    """The rough surface."""

    echo: bool = True  #: whether it scatters
    phase_screen: bool = True  #: whether its heights disturb the phase of what lies below
    rms_height: Annotated[float, Field(ge=0, le=10)] = 0.005  #: s of the exponential correlation, m
    correlation_length: Size = 0.05  #: l of the exponential correlation, m
    #: spectral density of the ground's profile at 0.1 waves per metre, m³, whose longer waves come
    #: on top of these (ISO 8608: 256e-6 in class C, 1024e-6 in D, 4096e-6 in E); 0 leaves the
    #: exponential correlation alone
    unevenness: Share = 0.0
    waviness: Annotated[float, Field(gt=1, lt=3)] = 2.0  #: exponent with which that density falls
    #: rms tilt of the larger scale, rad
    slope: Annotated[float, Field(ge=0, lt=math.pi / 2)] = math.radians(5)
    cross_db: Decibels = -12.0  #: HV under HH, dB
    correlation: Share = 0.65  #: correlation of HH and VV
    #: shape of the gamma-distributed local power (K-distributed amplitudes); None is Rayleigh
    #: clutter
    texture_shape: Annotated[float, Field(ge=0.01)] | None = 4.0
    #: correlation length of the local power, m
    texture_length: Annotated[float, Field(gt=0.05)] = 0.5
    #: scatterers per m²; None takes 3 per resolution cell of the sensor at 10 m
    density: Positive | None = None
    level_db: Decibels = 0.0  #: added to σ⁰, dB: for sites whose level was measured


class Patch(SceneTable):
    """A round patch of ground that scatters more, as wet ground does."""

    x: float  #: m
    y: float  #: m
    radius: Size  #: m
    gain_db: Decibels = 4.0  #: by how much σ⁰ is higher in its middle, dB


def _with_body_size(data: Any, size_entries: tuple[str, ...]) -> Any:
    """Return a target's entries with the size of the body that it names.

    A size that differs from the body's is a ValueError.
    """
    if not isinstance(data, dict) or not isinstance(data.get("body"), str):
        return data
    size = body_size(data["body"])
    present = [entry for entry in size_entries if data.get(entry) is not None]
    for entry in present:
        if data[entry] != size.get(entry):
            raise ValueError(
                f"{present[0]} must not be given with body = {data['body']!r}, which has its own"
            )
    return {**data, **size}


class Target(SceneTable):
    """A mine or another body in or on the ground."""

    #: "metal", "plastic", "simulant" (plastic without an air gap) or any other name, which then is
    #: metal unless it has a ``permittivity`` or a ``body``
    kind: str
    #: what scatters in the ground: a packaged body ("tm-62p"; ``flgpr simulate signature`` lists
    #: them) or the file of a table made by the user. It brings its radius and height. None takes a
    #: generic metal or plastic mine of the radius and height given here
    body: str | None = None
    #: x, y, depth: centre and depth of the top below the ground there, m; ``depth = -height`` lies
    #: on the ground
    x: float
    y: float
    depth: float = 0.0
    #: radius, height: of the cylinder, m, unless there is a ``profile``
    radius: Size = 0.16
    height: Size = 0.15
    #: corners of the body from its top's centre to its bottom's, m
    profile: tuple[tuple[float, float], ...] | None = None
    #: of a dielectric body; None takes 2.9 for plastic and simulant and makes the rest metal
    permittivity: Annotated[float, Field(ge=1, le=1000)] | None = None
    #: air under a dielectric body's top, m; None takes 1.5 cm for plastic and nothing for the rest
    gap: NotNegative | None = None
    #: tilt, azimuth: tilt of the axis and the direction it leans to, clockwise from +y, rad
    tilt: Angle = 0.0
    azimuth: Angle = 0.0
    heading: Angle = 0.0  #: direction of a box's long side, clockwise from +y, rad
    #: laid, lifted: drive from which on it lies there, and drive from which on it is gone
    laid: DriveNumber = 1
    lifted: DriveNumber | None = None

    @model_validator(mode="before")
    @classmethod
    def _take_body(cls, data: Any) -> Any:
        """Return the entries with the body's size."""
        return _with_body_size(data, ("radius", "height", "profile", "permittivity", "gap"))

    @property
    def outline(self) -> Profile:
        """Corners of the body from its top's centre to its bottom's, m."""
        return self.profile or cylinder(self.radius, self.height)

    @property
    def extent(self) -> tuple[float, float]:
        """Greatest radius, and height, m."""
        greatest_radius = max(radius for radius, _ in self.outline)
        height = self.outline[-1][1]
        return greatest_radius, height

    @property
    def dielectric(self) -> float | None:
        """Permittivity of the body, None for metal."""
        if self.permittivity is None and self.kind in {"plastic", "simulant"}:
            return 2.9
        return self.permittivity

    @property
    def air_gap(self) -> float:
        """Air under the top, m."""
        if self.gap is None:
            return 0.015 if self.kind == "plastic" else 0.0
        return self.gap


class TargetDraw(SceneTable):
    """A number of alike targets put into the lane at random."""

    kind: str  #: as of a target
    body: str | None = None  #: as of a target; boxes lie at any heading
    depth: float  #: depth of the top, m
    count: Annotated[int, Field(ge=0, le=1_000_000)]
    radius: Size = 0.16  #: m
    height: Size = 0.15  #: m
    #: depth_jitter, position_jitter, tilt: rms of the depth (m), of the place off an even grid
    #: along the lane (m), and of the tilt (rad) in each axis
    depth_jitter: NotNegative = 0.005
    position_jitter: NotNegative = 0.3
    tilt: Annotated[float, Field(ge=0, le=math.pi)] = math.radians(4)
    #: laid, lifted: as of a target
    laid: DriveNumber = 1
    lifted: DriveNumber | None = None

    @model_validator(mode="before")
    @classmethod
    def _take_body(cls, data: Any) -> Any:
        """Return the entries with the body's size."""
        return _with_body_size(data, ("radius", "height"))


class SceneObject(SceneTable):
    """An object that is no target."""

    #: a rock lies half in the ground; a post is a metal or wet wooden upright; a bush is a cloud of
    #: scatterers; a fiducial is a corner reflector
    kind: Literal["rock", "post", "bush", "fiducial"]
    x: float  #: m
    y: float  #: m
    radius: Size = 0.05  #: m
    height: Moderate = 0.0  #: m; height above the ground there
    rcs_db: Decibels | None = None  #: cross section at 1 GHz of a bush or fiducial, dBsm


class Clutter(SceneTable):
    """Discrete clutter drawn from the seed."""

    rocks: NotNegative = 0.0  #: rocks per m² on and beside the lane
    bushes: NotNegative = 0.0  #: per metre of roadside, both sides together
    posts: NotNegative = 0.0  #: per metre of roadside, both sides together
    patches: NotNegative = 0.0  #: wet patches per m²
    #: least and greatest distance of bushes and posts from the lane's middle, m
    roadside: tuple[RoadsideDistance, RoadsideDistance] = (3.5, 7.0)

    @model_validator(mode="after")
    def _check(self) -> Clutter:
        """Raise a ValueError for distances that do not increase."""
        least, greatest = self.roadside
        if not least <= greatest:
            raise ValueError(
                f"roadside must be the least and the greatest distance, got {self.roadside}"
            )
        return self


class Departure(SceneTable):
    """A stretch over which the vehicle is off the lane and takes no scans."""

    #: start, length: where it leaves the lane, and how far on it returns, m
    start: float
    length: Positive


class Track(SceneTable):
    """The vehicle's track: positions of the array's reference point at each scan."""

    #: start, stop: first and last position along the lane, m; None begins 20 m before the lane and
    #: ends 5 m before its end
    start: float | None = None
    stop: float | None = None
    step: tuple[Stride, Stride] = (1.0, 3.0)  #: least and greatest distance between scans, m
    #: wander, wander_length: rms and length of slow wandering across the lane, m; the heading
    #: follows it
    wander: Moderate = 0.0
    wander_length: Annotated[float, Field(ge=0.01)] = 20.0
    attitude: Share = 0.0  #: rms pitch and roll, rad
    bounce: Moderate = 0.0  #: rms change of height, m
    #: positions at which the vehicle stands, m, and how many scans it takes there besides its own
    stops: tuple[tuple[float, NonNegativeInt], ...] = ()
    departures: tuple[Departure, ...] = ()  #: where it leaves the lane and re-enters
    #: exact positions along the lane, m, instead of drawn ones
    positions: tuple[float, ...] | None = None

    @model_validator(mode="after")
    def _check(self) -> Track:
        """Raise a ValueError for distances that do not increase."""
        least, greatest = self.step
        if not 0 < least <= greatest:
            raise ValueError(f"step must have 0 < least <= greatest, got {self.step}")
        return self


class Drive(SceneTable):
    """A later drive over the road: what has changed since the first one.

    Which targets lie there say their entries ``laid`` and ``lifted``; who lifts one fills its hole.
    Noise, drifts, and the places of scans are drawn anew for every drive. Antennas and what stands
    on the vehicle stay, and so does all of the ground that has no entry here.
    """

    #: beside, higher: of this track over the first one, m to the right and up
    beside: Annotated[float, Field(ge=-100, le=100)] = 0.0
    higher: Annotated[float, Field(ge=-10, le=10)] = 0.0
    moisture: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0  #: water added to the soil, m³/m³
    #: shares of the power of the surface's and the grass's echo that come from scatterers of this
    #: drive: traffic, rain and wind have moved theirs
    surface: Share = 0.0
    grass: Share = 0.0
    rocks: Share = 0.0  #: share of the rocks that lie elsewhere
    decoys: NotNegative = (
        0.0  #: holes dug and filled again with nothing in them, per m² of the lane
    )
    position: NotNegative | None = None  #: rms of the reported position, m; None: the sensor's own
    #: drift: rms of an error of the reported place that changes slowly, over some ten scans, m
    drift: NotNegative = 0.0


class Scene(SceneTable):
    """A lane and all that is in it."""

    name: str = "lane"
    #: one of the packaged sites, or the path of a TOML file like theirs (``.toml``), whose soil,
    #: surface and clutter stand wherever the scene says nothing itself
    site: str | None = None
    x_min: float = -1.5  #: m
    x_max: float = 1.5  #: m
    length: Annotated[float, Field(gt=0, le=100_000)] = 60.0  #: m; the lane begins at y = 0
    soil: Soil = Soil()
    surface: Surface = Surface()
    clutter: Clutter = Clutter()
    terrain: Terrain = Terrain()
    grass: Grass = Grass()
    shadow: Shadow = Shadow()
    stones: Stones = Stones()
    roots: Roots = Roots()
    lenses: Lenses = Lenses()
    heterogeneity: Heterogeneity = Heterogeneity()
    holes: Holes = Holes()
    track: Track = Track()
    targets: tuple[Target, ...] = ()  #: at given places, as objects and patches
    draws: tuple[TargetDraw, ...] = ()  #: targets to be drawn
    objects: tuple[SceneObject, ...] = ()
    patches: tuple[Patch, ...] = ()
    drives: tuple[Drive, ...] = ()  #: later drives over the road, the second one first
    drive: DriveNumber = 1  #: the one that is simulated, see :meth:`at_drive`

    @model_validator(mode="before")
    @classmethod
    def _take_site(cls, data: Any) -> Any:
        """Return the entries over those of the site that they name."""
        if not isinstance(data, dict) or data.get("site") is None:
            return data
        merged = dict(data)
        for name, site_entries in site_tables(data["site"]).items():
            scene_entries = data.get(name, {})
            if isinstance(scene_entries, BaseModel):
                scene_entries = scene_entries.model_dump(exclude_unset=True)
            if name == "soil":
                model = scene_entries.get("model", site_entries.get("model"))
                others = _NOT_FOR_ALL - _OF_MODEL.get(model, _NOT_FOR_ALL)
                site_entries = {k: v for k, v in site_entries.items() if k not in others}
            merged[name] = {**site_entries, **scene_entries}
        return merged

    @model_validator(mode="after")
    def _check(self) -> Scene:
        """Raise a ValueError for a lane without width."""
        if not self.x_max > self.x_min:
            raise ValueError(f"x_max must be greater than x_min, got {self.x_min} and {self.x_max}")
        if self.drive > len(self.drives) + 1:
            raise ValueError(
                f"drive must be at most {len(self.drives) + 1}, of which drives tells, got {self.drive}"
            )
        placed: tuple[Target | TargetDraw, ...] = (*self.targets, *self.draws)
        for one in placed:
            if one.laid > len(self.drives) + 1:
                raise ValueError(
                    f"laid must be a drive that the scene tells of, at most {len(self.drives) + 1}, "
                    f"got {one.laid}"
                )
            if one.lifted is not None and one.lifted <= one.laid:
                raise ValueError(
                    f"lifted must be a drive after laid, got {one.lifted} and {one.laid}: it would "
                    "never lie there"
                )
        return self

    def at_drive(self, number: int) -> Scene:
        """Return the scene as a later drive over the road finds it.

        Parameters
        ----------
        number : int
            1 for the first drive, 2 for the first of ``drives``, and so on.

        Raises
        ------
        ValueError
            If the scene has no such drive.
        """
        if not 1 <= number <= len(self.drives) + 1:
            raise ValueError(
                f"drive must be from 1 to {len(self.drives) + 1}, of which the scene tells, got {number}"
            )
        if number == 1:
            return self
        soil = self.soil.wetter(self.drives[number - 2].moisture)
        return self.model_copy(update={"drive": number, "soil": soil})

    @property
    def change(self) -> Drive:
        """What has changed since the first drive."""
        return Drive() if self.drive == 1 else self.drives[self.drive - 2]

    @property
    def track_ends(self) -> tuple[float, float]:
        """First and last position along the lane at which scans are drawn, m."""
        start = -20.0 if self.track.start is None else self.track.start
        return start, self.length - 5.0 if self.track.stop is None else self.track.stop

    @property
    def lane(self) -> Lane:
        """The rectangle that is scored."""
        return Lane(self.x_min, self.x_max, 0.0, self.length)


def site_tables(site: Any) -> dict[str, Any]:
    """Return the tables of a packaged site or of a TOML file.

    Parameters
    ----------
    site : Any
        Name of a packaged site, or the path of a file whose name ends in ``.toml``.

    Raises
    ------
    ValueError
        If there is no such site or file, or if the file is not TOML in UTF-8 or holds a table that
        is none of a site's.
    """
    path = Path(str(site))
    if path.suffix == ".toml" and path.is_file():
        return _read_site(path)
    packaged = sites()
    if site not in packaged:
        raise ValueError(
            f"site must be one of {', '.join(packaged)} or a TOML file that is there, got {site!r}"
        )
    return tomllib.loads((_SITES / f"{site}.toml").read_text(encoding="utf-8"))


def _read_site(path: Path) -> dict[str, Any]:
    """Return the tables of a site's file, or raise a ValueError."""
    try:
        tables = parse_toml(read_named(path))
    except ValueError as error:
        raise ValueError(f"site {path} must be TOML in UTF-8 ({error})") from None
    allowed = set()
    for name, field in Scene.model_fields.items():
        # The track belongs to a drive, not to the ground.
        if isinstance(field.default, SceneTable) and name != "track":
            allowed.add(name)
    unknown = sorted(set(tables) - allowed)
    if unknown:
        raise ValueError(f"site {path} must hold the tables of a site alone, got {unknown[0]}")
    return tables


def sites() -> list[str]:
    """Return the names of the packaged sites."""
    return preset_names(_SITES)


def load_scene(path: str | Path) -> Scene:
    """Read a scene from a TOML file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Scene
        The validated scene.

    Raises
    ------
    ValueError
        If the file is not there, or an entry breaks a rule; the entry is named.
    """
    if not Path(path).is_file():
        raise ValueError(f"scene file not found: {path}")
    return parse_entries(Scene, read_named(path), f"scene {path}", "scene")

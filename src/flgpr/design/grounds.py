"""Soil and rough surface that a body lies in: of a site, or of constants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from flgpr.model import Sensor
from flgpr.model.faults import first_fault
from flgpr.simulate import Scene, Simulator
from flgpr.simulate.scene.scene import Soil, Surface, Target, Track


@dataclass(frozen=True)
class GroundModel:
    """Soil and rough surface that a body lies in."""

    name: str  #: site, or the permittivity and loss tangent
    soil: Soil
    surface: Surface


def ground_model(
    site: str | None = None,
    *,
    permittivity: float | None = None,
    loss_tangent: float | None = None,
    rms_height: float | None = None,
    correlation_length: float | None = None,
    unevenness: float | None = None,
) -> GroundModel:
    """Return the soil and surface of a site, or of a permittivity; other arguments replace theirs.

    Parameters
    ----------
    site : str, optional
        Packaged site, or the path of a TOML file like theirs. Without one the surface is that of a
        scene that says nothing, and ``permittivity`` is required.
    permittivity, loss_tangent : float, optional
        Real relative permittivity, which asks for a loss tangent, and loss tangent at all tones,
        which alone replaces that of the site.
    rms_height, correlation_length : float, optional
        Of the exponential correlation of the surface, m.
    unevenness : float, optional
        Spectral density of the ground's profile at 0.1 waves per metre, m³ (ISO 8608: 16e-6 in
        class A, 1024e-6 in D).

    Raises
    ------
    ValueError
        If there is no such site, if neither a site nor a permittivity is given, or if a value is
        out of its range.
    """
    if site is None and permittivity is None:
        raise ValueError("site or permittivity must be given, got neither")
    if permittivity is not None and loss_tangent is None:
        raise ValueError(
            f"loss_tangent must be given with permittivity, got permittivity {permittivity:g} alone"
        )
    soil: dict[str, Any] = {}
    if permittivity is not None:
        soil |= {"model": "fixed", "permittivity": permittivity, "layers": ()}
    if loss_tangent is not None:
        soil["loss_tangent"] = loss_tangent
    shape = {
        "rms_height": rms_height,
        "correlation_length": correlation_length,
        "unevenness": unevenness,
    }
    surface = {name: value for name, value in shape.items() if value is not None}
    try:
        scene = Scene.model_validate({"site": site, "soil": soil, "surface": surface})
    except ValidationError as error:
        raise ValueError(first_fault(error, Scene)) from None
    return GroundModel(_ground_name(site, permittivity, loss_tangent), scene.soil, scene.surface)


def _ground_name(site: str | None, permittivity: float | None, loss_tangent: float | None) -> str:
    """Return a ground's name: its site, and the soil's constants that were given."""
    name = str(site) if permittivity is None else "soil"
    constants = []
    if permittivity is not None:
        constants.append(f"permittivity {permittivity:g}")
    if loss_tangent is not None:
        constants.append(f"loss tangent {loss_tangent:g}")
    if not constants:
        return name
    return f"{name} of {' and '.join(constants)}"


def bare_lane(
    ground: GroundModel,
    sensor: Sensor,
    seed: int,
    length: float,
    positions: tuple[float, ...],
    surface: dict[str, Any],
    targets: tuple[Target, ...] = (),
) -> Simulator:
    """Return the simulator, without errors, of a lane with nothing but a ground and targets.

    Parameters
    ----------
    ground : GroundModel
        Its soil and surface, of which ``surface`` changes entries.
    sensor : Sensor
        The array.
    seed : int
        Of the surface.
    length : float
        Length of the lane, m.
    positions : tuple of float
        Of the array along the lane, a scan each, m.
    surface : dict
        Entries of the surface that are not the ground's.
    targets : tuple of Target
        What lies in the ground.
    """
    scene = Scene(
        length=length,
        soil=ground.soil,
        surface=ground.surface.model_copy(update=surface),
        track=Track(positions=positions),
        targets=targets,
    )
    return Simulator(scene, sensor, seed, errors=False)

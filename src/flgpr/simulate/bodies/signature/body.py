"""Bodies: what a mine is made of, layer by layer, as TOML."""

from __future__ import annotations

import itertools
import math
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from flgpr.model.bounds import Entries
from flgpr.model.faults import load_preset, preset_names

_PRESETS = resources.files("flgpr.simulate.bodies.signature") / "bodies"
Length = Annotated[float, Field(gt=0.001, le=1.0)]


class BodyLayer(Entries):
    """One level layer of a body."""

    thickness: Length  #: m
    #: from the axis outwards: radii of a round body, half-widths of a square one, m
    zones: tuple[tuple[Length, Annotated[float, Field(ge=1, le=100)] | Literal["metal"]], ...]

    @model_validator(mode="after")
    def _check(self) -> BodyLayer:
        widths = [width for width, _ in self.zones]
        if not widths or any(b <= a for a, b in itertools.pairwise(widths)):
            raise ValueError(
                f"zones must be at least one, each wider than the one before, got {widths}"
            )
        return self


class Body(Entries):
    """A body in the ground, upright: round about its axis, or a box."""

    name: str
    source: str = ""  #: where its dimensions come from
    shape: Literal["round", "box"] = (
        "round"  #: a box is as long (``aspect`` times) as its layers' widths say
    )
    elongation: Annotated[float, Field(ge=1, le=10)] = 1.0  #: length over width of a box
    layers: Annotated[tuple[BodyLayer, ...], Field(min_length=1)]  #: from the top down

    @property
    def height(self) -> float:
        """From top to bottom, m."""
        return math.fsum(layer.thickness for layer in self.layers)

    @property
    def radius(self) -> float:
        """Greatest half-width, m."""
        return self.radii()[-1]

    @property
    def metal(self) -> bool:
        """Whether any of it is metal."""
        return any(eps == "metal" for layer in self.layers for _, eps in layer.zones)

    def radii(self) -> list[float]:
        """All half-widths at which the medium changes, ascending, m."""
        return sorted({round(width, 9) for layer in self.layers for width, _ in layer.zones})

    def drops(self) -> list[float]:
        """List the drops below the top at which a layer begins or ends, ascending from 0, m."""
        return [0.0, *np.cumsum([layer.thickness for layer in self.layers]).tolist()]

    def densest(self) -> float:
        """Greatest permittivity of its dielectrics, 1 if there is none."""
        found = [eps for layer in self.layers for _, eps in layer.zones if eps != "metal"]
        return max([1.0, *(float(eps) for eps in found)])

    def inside(self, half_width: ArrayLike, drop: ArrayLike) -> NDArray[np.bool_]:
        """Whether points at a half-width from the axis and a drop below the top (m, broadcast) lie in the body."""
        return np.asarray(self.permittivity(half_width, drop, -1.0) != -1.0)

    def permittivity(
        self, half_width: ArrayLike, drop: ArrayLike, soil: complex
    ) -> NDArray[np.complex128]:
        """Relative permittivity at half-widths and drops (m, broadcast): NaN in metal, the soil's outside."""
        r, d = np.broadcast_arrays(
            np.asarray(half_width, dtype=float), np.asarray(drop, dtype=float)
        )
        out = np.full(r.shape, soil, complex)
        edges = self.drops()
        for layer, (top, bottom) in zip(self.layers, itertools.pairwise(edges), strict=True):
            level = (d > top) & (d < bottom)
            for width, eps in reversed(layer.zones):
                out[level & (r < width)] = np.nan if eps == "metal" else eps
        return out


def packaged_bodies() -> list[str]:
    """Names of the packaged bodies."""
    return preset_names(_PRESETS)


def load_body(name: str | Path) -> Body:
    """Load a body from a packaged name or a TOML file; an entry that breaks a rule is a ValueError that names it."""
    return load_preset(Body, "body", name, _PRESETS)

"""Bodies: what a mine is made of, layer by layer, as TOML."""

from __future__ import annotations

import itertools
import math
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from flgpr.model.bounds import Entries
from flgpr.model.faults import load_preset, preset_names
from flgpr.types import ArrayLike, BoolArray, Complex128Array, floats

_PRESETS = resources.files("flgpr.simulate.bodies.signature") / "bodies"
Length = Annotated[float, Field(gt=0.001, le=1.0)]


class BodyLayer(Entries):
    """One level layer of a body."""

    thickness: Length  #: m
    #: from the axis outwards: radii of a round body, half-widths of a square one, m
    zones: tuple[tuple[Length, Annotated[float, Field(ge=1, le=100)] | Literal["metal"]], ...]

    @model_validator(mode="after")
    def _check(self) -> BodyLayer:
        """Raise a ValueError for zones that are none or not each wider than the one before."""
        widths = [width for width, _ in self.zones]
        ascending = all(inner < outer for inner, outer in itertools.pairwise(widths))
        if not widths or not ascending:
            raise ValueError(
                f"zones must be at least one, each wider than the one before, got {widths}"
            )
        return self


class Body(Entries):
    """A body in the ground, upright: round about its axis, or a box."""

    name: str
    source: str = ""  #: where its dimensions come from
    #: a box is ``elongation`` times as long as its layers' widths say
    shape: Literal["round", "box"] = "round"
    elongation: Annotated[float, Field(ge=1, le=10)] = 1.0  #: length over width of a box
    layers: Annotated[tuple[BodyLayer, ...], Field(min_length=1)]  #: from the top down

    @property
    def height(self) -> float:
        """Distance from top to bottom, m."""
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
        """Return all half-widths at which the medium changes, ascending, m."""
        # Rounded, so that equal widths are found to be equal.
        widths = {round(width, 9) for layer in self.layers for width, _ in layer.zones}
        return sorted(widths)

    def drops(self) -> list[float]:
        """Return the drops below the top at which a layer begins or ends, ascending from 0, m."""
        bottoms = np.cumsum([layer.thickness for layer in self.layers])
        return [0.0, *bottoms.tolist()]

    def densest(self) -> float:
        """Return the greatest permittivity of its dielectrics, 1 if there is none."""
        greatest = 1.0
        for layer in self.layers:
            for _, eps in layer.zones:
                if eps != "metal":
                    greatest = max(greatest, float(eps))
        return greatest

    def inside(self, half_width: ArrayLike, drop: ArrayLike) -> BoolArray:
        """Return whether points lie in the body.

        Parameters
        ----------
        half_width : array_like
            Distance from the axis, m; of a box the greater of those along its sides.
        drop : array_like
            Drop below the top, m, broadcast with it.
        """
        return self.permittivity(half_width, drop, -1.0) != -1.0

    def permittivity(
        self, half_width: ArrayLike, drop: ArrayLike, soil: complex
    ) -> Complex128Array:
        """Return the relative permittivity at points, NaN in metal and the soil's outside.

        Parameters
        ----------
        half_width, drop : array_like
            Of the points, as in :meth:`inside`.
        soil : complex
            Permittivity of the soil.
        """
        r, d = np.broadcast_arrays(floats(half_width), floats(drop))
        out = np.full(r.shape, soil, complex)
        edges = self.drops()
        for layer, (top, bottom) in zip(self.layers, itertools.pairwise(edges), strict=True):
            level = (d > top) & (d < bottom)
            for width, eps in reversed(layer.zones):
                out[level & (r < width)] = np.nan if eps == "metal" else eps
        return out


def packaged_bodies() -> list[str]:
    """Return the names of the packaged bodies."""
    return preset_names(_PRESETS)


def load_body(name: str | Path) -> Body:
    """Read a body by a packaged name or from a TOML file.

    Raises
    ------
    ValueError
        If there is neither, or an entry breaks a rule; the entry is named.
    """
    return load_preset(Body, "body", name, _PRESETS)

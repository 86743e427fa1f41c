"""A map of how far every channel of a look stands out of its surroundings, with weights learnt over all channels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.ndimage import uniform_filter
from scipy.optimize import minimize

from flgpr.chain.passes import Accumulator, Arrays
from flgpr.chain.stages import FloatArray, MapStage, Positive, Table
from flgpr.model import Lane
from flgpr.screen import MeanViewSums, local_maxima

_LEAST = 0.1  # dB; the map stays positive, so that it can be drawn as a magnitude


class LevelSettings(Table):
    """Half widths of squares, distances (m) and how weights are learnt.

    A pixel's power is the mean over ``inner``, its surroundings' that over ``outer`` less ``guard``. Mines of these
    ``kinds`` are examples where the map is largest within ``reach`` of them, clutter at the map's maxima, ``radius``
    apart, beyond ``clear`` of all targets; with every one of the ``rounds`` the map is that of the weights so far.
    ``penalty`` times the squared weights is added to the mean logistic loss, in which mines and clutter count alike.
    ``offset`` (dB) lifts the map.
    """

    inner: Positive = 0.15
    guard: Positive = 0.65
    outer: Positive = 1.55
    kinds: tuple[str, ...] = ("metal", "plastic", "ap")
    reach: Positive = 0.3
    radius: Positive = 0.4
    clear: Positive = 1.0
    rounds: Annotated[int, Field(ge=1)] = 3
    penalty: Positive = 0.06
    offset: Positive = 30.0

    @model_validator(mode="after")
    def _nested(self) -> LevelSettings:
        if not self.inner < self.guard < self.outer:
            raise ValueError(f"inner, guard and outer must rise, got {self.inner:g}, {self.guard:g} and {self.outer:g}")
        return self


class LevelMap(MapStage):
    """Weighted mean, over all polarizations and sub-bands, of the contrast of a look's pixels to their surroundings.

    The contrast of a channel is the power about a pixel over that of the ring about it, dB: so a look in which the
    ground is bright counts no more than others. Means over looks are those of the run-view, ``look = "mean"``. Weights
    are those of a logistic regression of mines against clutter's own maxima in the mean over the looks, none below
    zero: a channel may say nothing of mines, but that one stands out never speaks against a mine.
    """

    learns = True
    single = False
    waits = "its self-signature is that of the whole run"
    Settings: ClassVar[type[Table]] = LevelSettings

    def map(self, image: xr.DataArray) -> NDArray[np.float32]:
        """Give the weighted mean of all channels, dB, ``offset`` added."""
        contrast = contrasts(image, self.settings)
        mean = np.tensordot(self.learnt["weight"], contrast.reshape(-1, *contrast.shape[-2:]), axes=1)
        return np.asarray(np.maximum(mean + self.settings.offset, _LEAST), dtype=np.float32)

    def examples(self, truth: pd.DataFrame, image: Callable[[int], xr.DataArray]) -> Accumulator:
        """Take the mean contrasts of all looks on the run-view's pixels."""
        sums, grid = MeanViewSums(self.setup.view, self.setup.images.extent()[3]), self.setup.images
        area, places = self.setup.lane, truth[["x", "y"]].to_numpy(dtype=np.float64).reshape(-1, 2)
        wanted = np.array([kind in self.settings.kinds for kind in truth.get("kind", ())], bool)

        def add(index: int) -> None:
            one = image(index)
            sums.add(contrasts(one, self.settings), grid, np.asarray(one.attrs["pose"]))

        def result() -> Arrays:
            values, looks = sums.result()
            seen = np.where(looks > 0, values.reshape(-1, *looks.shape), np.nan).astype(np.float32)
            borders = np.array([area.x_min, area.x_max, area.y_min, area.y_max])
            axes = {"x": self.setup.view.x, "y": self.setup.view.y}
            return {"view": seen, "places": places, "wanted": wanted, "borders": borders, **axes}

        return Accumulator(add, lambda _: sums.state(), sums.merge, result)

    @classmethod
    def fit(cls, settings: Any, examples: list[Any]) -> tuple[Arrays, dict[str, Any]]:
        """Learn the weights of the channels."""
        channels = len(examples[0]["view"])
        weight = np.full(channels, 1 / channels)
        for _ in range(settings.rounds):
            pairs = [_examples(lane, weight, settings) for lane in examples]
            mines, clutter = (np.concatenate(some) for some in zip(*pairs, strict=True))
            if not len(mines) or not len(clutter):
                raise ValueError(f"levels need mines and clutter, got {len(mines)} and {len(clutter)}")
            learnt = logistic_weights(mines, clutter, settings.penalty)
            weight = learnt / max(learnt.sum(), np.finfo(float).tiny)
        if not learnt.any():
            raise ValueError("mines must stand out of clutter in some channel, they do in none")
        return {"weight": weight, "steepness": np.array(learnt.sum())}, {"mines": len(mines), "clutter": len(clutter)}


def contrasts(image: xr.DataArray, settings: LevelSettings) -> NDArray[np.float32]:
    """Contrast (polarization, subband, y, x) of every pixel of an image to the ring about it, dB."""
    power = np.abs(image.values) ** 2
    steps = [float(image[axis].values[1] - image[axis].values[0]) for axis in "yx"]

    def mean(half: float) -> tuple[Any, float]:
        size = tuple(2 * round((half - step / 2) / step) + 1 for step in steps)
        return uniform_filter(power, (1, 1, *size), mode="nearest"), float(np.prod(size))

    (inner, _), (guard, few), (outer, count) = (mean(half) for half in (settings.inner, settings.guard, settings.outer))
    ring = (count * outer - few * guard) / (count - few)
    tiny = np.finfo(np.float32).tiny
    return np.asarray(10 * np.log10(np.maximum(inner, tiny) / np.maximum(ring, tiny)), dtype=np.float32)


def _examples(lane: Mapping[str, NDArray[Any]], weight: FloatArray, settings: Any) -> tuple[FloatArray, FloatArray]:
    """Contrasts (example, channel) at a lane's mines and at its clutter's maxima, by the map of the weights so far."""
    view, x, y = lane["view"].astype(float), lane["x"], lane["y"]
    score = np.tensordot(weight, view, axes=1)
    mines = []
    for place in lane["places"][lane["wanted"]]:
        near = np.hypot(x - place[0], y[:, None] - place[1]) <= settings.reach
        some = np.where(near & np.isfinite(score), score, -np.inf)
        if np.isfinite(some.max()):
            mines.append(view.reshape(len(view), -1)[:, some.argmax()])
    maxima = local_maxima(xr.DataArray(score, dims=("y", "x"), coords={"y": y, "x": x}), settings.radius)
    where = maxima[["x", "y"]].to_numpy(dtype=np.float64)
    off = where[:, None] - lane["places"]
    far = np.hypot(off[..., 0], off[..., 1]).min(axis=1, initial=np.inf) > settings.clear
    where = where[far & Lane(*lane["borders"]).contains(where[:, 0], where[:, 1])]
    row, column = (np.searchsorted(axis, where[:, k]) for axis, k in ((y, 1), (x, 0)))  # maxima lie on pixels
    return np.array(mines).reshape(-1, len(view)), view[:, row, column].T


def logistic_weights(mines: FloatArray, clutter: FloatArray, penalty: float) -> FloatArray:
    """Weights (channel,), none below zero, of a logistic regression in which both classes count alike."""
    X = np.concatenate([mines, clutter])
    side = np.concatenate([np.ones(len(mines)), -np.ones(len(clutter))])
    share = np.concatenate([np.full(len(one), 0.5 / len(one)) for one in (mines, clutter)])

    def loss(w: FloatArray) -> tuple[float, FloatArray]:
        margin = side * (X @ w[:-1] + w[-1])
        slope = -share * side * np.exp(-np.logaddexp(0, margin))
        value = share @ np.logaddexp(0, -margin) + 0.5 * penalty * w[:-1] @ w[:-1]
        return float(value), np.append(X.T @ slope + penalty * w[:-1], slope.sum())

    bounds = [(0, None)] * X.shape[1] + [(None, None)]
    return np.asarray(minimize(loss, np.zeros(X.shape[1] + 1), jac=True, method="L-BFGS-B", bounds=bounds).x[:-1])

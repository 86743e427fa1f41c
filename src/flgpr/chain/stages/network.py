"""A small convolutional network on chips of the run-view: the rival that needs no features."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, ClassVar

import numpy as np
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from pydantic import Field

from flgpr.chain.engine import Arrays
from flgpr.chain.stages import FeatureStage, FloatArray, Positive, Setup, Table, TrainingView
from flgpr.chain.too_few import Tally, TooFewExamplesError, clear_change, kinds_change
from flgpr.detect.scorers.checks import Checked
from flgpr.features import cut_regions
from flgpr.screen import local_maxima
from flgpr.screen.views import grid_of

_STRIDES = (1, 2, 2)
_BATCH = 256
_FLOOR = 1e-3
Count = Annotated[int, Field(ge=1)]
Chips = NDArray[np.float32]


class NetworkSettings(Table):
    """Chips and training; lengths in m.

    A chip is ``size`` wide and long. Mines of these ``kinds`` are shown at their places and at the
    run-view's maxima within ``reach`` of them, clutter at the maxima beyond ``clear`` of all
    targets; maxima lie ``radius`` apart. Every ``epoch`` shows all of clutter once and as many
    mines, mirrored across the track and moved by up to ``jitter``. Of ``networks`` begun at
    different points the mean counts.
    """

    size: tuple[Positive, Positive] = (2.1, 2.1)
    kinds: tuple[str, ...] = ("metal", "plastic", "ap")
    reach: Positive = 0.5
    clear: Positive = 1.0
    radius: Positive = 0.5
    jitter: Annotated[float, Field(ge=0)] = 0.1
    channels: tuple[Count, Count, Count] = (16, 24, 32)
    networks: Count = 3
    epochs: Count = 20
    rate: Positive = 1e-3
    decay: Annotated[float, Field(ge=0)] = 1e-2
    seed: int = 0


class ChipNetwork(FeatureStage):
    """The column ``cnn``: log-odds, up to a constant, of a mine against clutter that looks like one.

    Three 3 x 3 convolutions, each followed by max(0, ·), the mean over what is left of the chip,
    and a linear layer, on log-magnitudes (dB) of all channels, each brought to zero mean and unit
    deviation over the training chips. Trained with PyTorch (AdamW on the logistic loss); what was
    learnt are plain arrays, and detection needs no PyTorch.
    """

    learns = True
    Settings: ClassVar[type[Table]] = NetworkSettings

    @classmethod
    def margin(cls, settings: Any) -> float:
        """Return how far a chip reaches."""
        return float(settings.size[1])

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:  # noqa: ARG003
        """Take the scale of the chips, and the weights of as many networks as the recipe has."""
        images = learnt.array("mean", (None, 1, 1)).shape[0]
        deviation = learnt.array("deviation", (images, 1, 1))
        if not (deviation > 0).all():
            raise ValueError(f"array 'deviation' must be positive, got {deviation.min():g}")
        for number in range(settings.networks):
            given = images
            for layer, channels in enumerate(settings.channels):
                kernel = (channels, given, 3, 3)
                learnt.array(f"{number}-kernel{layer}", kernel, np.float32)
                learnt.array(f"{number}-bias{layer}", (channels,), np.float32)
                given = channels
            learnt.array(f"{number}-last", (given,), np.float32)
            learnt.array(f"{number}-bias", (1,), np.float32)

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Cut the chips of the alarms and run the networks."""
        images = len(self.learnt["mean"])
        if math.prod(view.shape[:-2]) != images:
            raise ValueError(
                f"model must have been trained on run-views of {math.prod(view.shape[:-2])} "
                "images, as this one, "
                f"got {images}"
            )
        scores = np.zeros(len(points))
        for begin in range(0, len(points), _BATCH):
            some = slice(begin, begin + _BATCH)
            chips = _chips(view, points[some], self.settings.size)
            x = _normal(chips, self.learnt["mean"], self.learnt["deviation"])
            scores[some] = np.mean(
                [forward(x, weights) for weights in weights_of(self.learnt)], axis=0
            )
        return {"cnn": scores}

    @classmethod
    def fit(cls, settings: Any, examples: list[TrainingView]) -> tuple[Arrays, dict[str, Any]]:
        """Train the networks."""
        rng = np.random.default_rng(settings.seed)
        mines, clutter = (
            np.concatenate(some)
            for some in zip(*(_examples(e, settings, rng) for e in examples), strict=True)
        )
        if not len(mines) or not len(clutter):
            needed = f"mines and clutter, got {len(mines)} and {len(clutter)} chips"
            changes = kinds_change(settings, examples) if len(clutter) else [clear_change(settings)]
            counts = [Tally(len(mines), "chips of mines"), Tally(len(clutter), "chips of clutter")]
            raise TooFewExamplesError(needed, counts, changes)
        both = np.concatenate([mines, clutter])
        mean = both.mean(axis=(0, 2, 3), keepdims=True, dtype=float)[0]
        deviation = np.maximum(both.std(axis=(0, 2, 3), keepdims=True, dtype=float)[0], 1e-6)
        mines, clutter = (_normal(one, mean, deviation) for one in (mines, clutter))
        learnt: Arrays = {"mean": mean, "deviation": deviation}
        for number in range(settings.networks):
            trained = train_network(mines, clutter, settings, settings.seed + number)
            learnt |= {f"{number}-{name}": array for name, array in trained.items()}
        return learnt, {"chips_of_mines": len(mines), "chips_of_clutter": len(clutter)}


def weights_of(learnt: Mapping[str, NDArray[Any]]) -> list[Arrays]:
    """Take the arrays of every network out of what was learnt."""
    numbers = sorted({name.partition("-")[0] for name in learnt if "-" in name}, key=int)
    return [
        {key.partition("-")[2]: learnt[key] for key in learnt if key.startswith(f"{number}-")}
        for number in numbers
    ]


def forward(x: Chips, weights: Mapping[str, NDArray[Any]]) -> FloatArray:
    """Run a network on normalised chips (chip, channel, y, x): a score each."""
    for layer, stride in enumerate(_STRIDES):
        windows = sliding_window_view(x, (3, 3), axis=(2, 3))[:, :, ::stride, ::stride]
        x = np.einsum("ncyxvu,ocvu->noyx", windows, weights[f"kernel{layer}"], optimize=True)
        x = np.maximum(x + weights[f"bias{layer}"][:, None, None], 0)
    return np.asarray(x.mean(axis=(2, 3)) @ weights["last"] + weights["bias"], dtype=np.float64)


def train_network(mines: Chips, clutter: Chips, settings: NetworkSettings, seed: int) -> Arrays:
    """Train one network on normalised chips (chip, channel, y, x) and give its arrays."""
    try:
        import torch
        from torch.nn import functional
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "stage network needs PyTorch to be trained: pip install 'flgpr[network]'"
        ) from error
    drawn = torch.Generator().manual_seed(seed)
    sizes = (mines.shape[1], *settings.channels)
    weights: dict[str, Any] = {}
    for layer, (of, to) in enumerate(pairwise(sizes)):
        weights[f"kernel{layer}"] = (
            torch.randn(to, of, 3, 3, generator=drawn) * (2 / (9 * of)) ** 0.5
        )
        weights[f"bias{layer}"] = torch.zeros(to)
    weights |= {
        "last": torch.randn(sizes[-1], generator=drawn) / sizes[-1] ** 0.5,
        "bias": torch.zeros(1),
    }
    for one in weights.values():
        one.requires_grad_()
    steps = torch.optim.AdamW(weights.values(), settings.rate, weight_decay=settings.decay)
    shown = [torch.from_numpy(one) for one in (mines, clutter)]
    half = 32
    rounds = settings.epochs * -(-len(clutter) // half)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(steps, rounds)
    label = torch.cat([torch.ones(half), torch.zeros(half)])
    for _ in range(rounds):
        x = torch.cat([one[torch.randint(len(one), (half,), generator=drawn)] for one in shown])
        mirrored = torch.rand(len(x), generator=drawn) < 0.5
        x = torch.where(mirrored[:, None, None, None], x.flip(3), x)
        for layer, stride in enumerate(_STRIDES):
            x = functional.relu(
                functional.conv2d(x, weights[f"kernel{layer}"], weights[f"bias{layer}"], stride)
            )
        loss = functional.binary_cross_entropy_with_logits(
            x.mean((2, 3)) @ weights["last"] + weights["bias"], label
        )
        steps.zero_grad()
        loss.backward()
        steps.step()
        slower.step()
    return {name: one.detach().numpy() for name, one in weights.items()}


def _examples(
    lane: TrainingView, settings: NetworkSettings, rng: np.random.Generator
) -> tuple[Chips, Chips]:
    """Cut the chips of a lane's mines, moved about a little, and of its clutter."""
    level = np.log(np.maximum(lane.view.values, _FLOOR)).mean(axis=(0, 1))
    found = local_maxima(lane.view[0, 0].copy(data=level), settings.radius)[["x", "y"]].to_numpy(
        dtype=float
    )
    found = found[lane.lane.contains(found[:, 0], found[:, 1])]
    every = lane.truth[["x", "y"]].to_numpy(dtype=float)
    mines = every[lane.truth["kind"].isin(settings.kinds).to_numpy()]
    near, far = (
        np.hypot(*(found[:, None] - some).T).T.min(axis=1, initial=np.inf)
        for some in (mines, every)
    )
    shown = np.repeat(np.concatenate([mines, found[near <= settings.reach]]), 9, axis=0)
    shown[np.arange(len(shown)) % 9 > 0] += rng.uniform(
        -settings.jitter, settings.jitter, (len(shown) // 9 * 8, 2)
    )
    chosen = shown, found[far > settings.clear]
    return _chips(lane.view, chosen[0], settings.size), _chips(lane.view, chosen[1], settings.size)


def _chips(view: xr.DataArray, points: FloatArray, size: tuple[float, float]) -> Chips:
    """Cut log-magnitudes (chip, channel, y, x), dB; -60, below all clutter, where nothing was seen."""
    values = view.values.reshape(-1, *view.shape[-2:])
    chips = cut_regions(np.maximum(np.nan_to_num(values), _FLOOR), grid_of(view), points, size)
    return np.asarray(20 * np.log10(np.maximum(chips, _FLOOR)), dtype=np.float32)


def _normal(chips: Chips, mean: FloatArray, deviation: FloatArray) -> Chips:
    return np.asarray((chips - mean) / deviation, dtype=np.float32)

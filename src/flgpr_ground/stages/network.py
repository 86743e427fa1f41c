"""A small convolutional network on chips of the run-view: the rival that needs no features."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view

from flgpr.detect.scorers.checks import Checked
from flgpr.features import cut_regions
from flgpr.model.bounds import AtLeastOne, NotNegative
from flgpr.screen.views import grid_of
from flgpr.stages import FeatureStage, Positive, Setup, Table, TrainingView
from flgpr.stages.too_few import Tally, TooFewExamplesError, clear_change
from flgpr.types import Arrays, Entries, Float32Array, FloatArray, floats
from flgpr_ground.stages.run_views import check_images, kinds_change, maxima_in_lane

_STRIDES = (1, 2, 2)
_BATCH = 256  # chips that are scored at once
_FLOOR = 1e-3  # of magnitudes in units of the background
Chips = Float32Array


class NetworkSettings(Table):
    """Chips and training; lengths in m.

    Mines are shown at their positions and at the run-view's maxima near them, clutter at the maxima
    far from all targets. Each epoch shows all of clutter once and as many mines, mirrored across
    the track and moved about a little.
    """

    size: tuple[Positive, Positive] = (2.1, 2.1)  #: width and length of a chip
    kinds: tuple[str, ...] = ("metal", "plastic", "ap")  #: kinds of targets that are mines
    reach: Positive = 0.5  #: farthest maximum from a mine that still shows it
    clear: Positive = 1.0  #: least distance of clutter's maxima from all targets
    radius: Positive = 0.5  #: distance between maxima
    jitter: NotNegative = 0.1  #: by up to which mines are moved
    channels: tuple[AtLeastOne, AtLeastOne, AtLeastOne] = (16, 24, 32)  #: of the three convolutions
    networks: AtLeastOne = 3  #: whose scores are averaged; they begin with different weights
    epochs: AtLeastOne = 20
    rate: Positive = 1e-3  #: step of the optimizer
    decay: NotNegative = 1e-2  #: of the weights
    seed: int = 0


class ChipNetwork(FeatureStage):
    """The column ``cnn``: log-odds, up to a constant, of a mine against clutter that resembles one.

    Three 3 x 3 convolutions, each followed by max(0, ·), the mean over what is left of the chip,
    and a linear layer, on log-magnitudes (dB) of all channels, each brought to zero mean and unit
    deviation over the training chips. Trained with PyTorch (AdamW on the logistic loss); what was
    learnt are plain arrays, and detection needs no PyTorch.
    """

    learns = True
    Settings: ClassVar[type[Table]] = NetworkSettings

    @classmethod
    def margin(cls, settings: Any) -> float:
        """Return how far a chip reaches, m."""
        return float(settings.size[1])

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:  # noqa: ARG003
        """Check the scale of the chips, and the weights of the recipe's networks."""
        images = learnt.array("mean", (None, 1, 1)).shape[0]
        deviation = learnt.array("deviation", (images, 1, 1))
        if not (deviation > 0).all():
            raise ValueError(f"array 'deviation' must be positive, got {deviation.min():g}")
        for number in range(settings.networks):
            inputs = images
            for layer, channels in enumerate(settings.channels):
                kernel = (channels, inputs, 3, 3)
                learnt.array(f"{number}-kernel{layer}", kernel, np.float32)
                learnt.array(f"{number}-bias{layer}", (channels,), np.float32)
                inputs = channels
            learnt.array(f"{number}-last", (inputs,), np.float32)
            learnt.array(f"{number}-bias", (1,), np.float32)

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Cut the chips of the alarms and run the networks."""
        check_images(view, len(self.learnt["mean"]))
        networks = weights_of(self.learnt)
        scores = np.zeros(len(points))
        for begin in range(0, len(points), _BATCH):
            batch = slice(begin, begin + _BATCH)
            chips = _chips(view, points[batch], self.settings.size)
            x = _normal(chips, self.learnt["mean"], self.learnt["deviation"])
            scores[batch] = np.mean([run_network(x, weights) for weights in networks], axis=0)
        return {"cnn": scores}

    @classmethod
    def fit(cls, settings: Any, examples: list[TrainingView]) -> tuple[Arrays, Entries]:
        """Train the networks."""
        rng = np.random.default_rng(settings.seed)
        cut = [_examples(lane, settings, rng) for lane in examples]
        mines, clutter = (np.concatenate(chips) for chips in zip(*cut, strict=True))
        if not len(mines) or not len(clutter):
            needed = f"mines and clutter, got {len(mines)} and {len(clutter)} chips"
            counts = [Tally(len(mines), "chips of mines"), Tally(len(clutter), "chips of clutter")]
            changes = kinds_change(settings, examples) if len(clutter) else [clear_change(settings)]
            raise TooFewExamplesError(needed, counts, changes)

        chips = np.concatenate([mines, clutter])
        mean = chips.mean(axis=(0, 2, 3), keepdims=True, dtype=float)[0]
        deviation = np.maximum(chips.std(axis=(0, 2, 3), keepdims=True, dtype=float)[0], 1e-6)
        mines = _normal(mines, mean, deviation)
        clutter = _normal(clutter, mean, deviation)
        learnt: Arrays = {"mean": mean, "deviation": deviation}
        for number in range(settings.networks):
            trained = train_network(mines, clutter, settings, settings.seed + number)
            learnt |= {f"{number}-{name}": array for name, array in trained.items()}
        return learnt, {"chips_of_mines": len(mines), "chips_of_clutter": len(clutter)}


def weights_of(learnt: Arrays) -> list[Arrays]:
    """Return the weights of every network that was learnt, by name."""
    by_number: dict[int, Arrays] = {}
    for key in learnt:
        number, dash, name = key.partition("-")
        if dash:
            by_number.setdefault(int(number), {})[name] = learnt[key]
    return [by_number[number] for number in sorted(by_number)]


def run_network(x: Chips, weights: Arrays) -> FloatArray:
    """Run a network.

    Parameters
    ----------
    x : (chip, channel, y, x) ndarray
        Normalised chips.
    weights : mapping of str to ndarray
        What :func:`weights_of` returned of it.

    Returns
    -------
    (chip,) ndarray
        The scores.
    """
    for layer, stride in enumerate(_STRIDES):
        kernel = weights[f"kernel{layer}"]
        bias = weights[f"bias{layer}"][:, None, None]
        windows = sliding_window_view(x, (3, 3), axis=(2, 3))[:, :, ::stride, ::stride]
        x = np.einsum("ncyxvu,ocvu->noyx", windows, kernel, optimize=True)
        x = np.maximum(x + bias, 0)
    mean = x.mean(axis=(2, 3))
    return floats(mean @ weights["last"] + weights["bias"])


def train_network(mines: Chips, clutter: Chips, settings: NetworkSettings, seed: int) -> Arrays:
    """Train one network with PyTorch.

    Parameters
    ----------
    mines, clutter : (chip, channel, y, x) ndarray
        Normalised chips.
    settings : NetworkSettings
        The network and its training.
    seed : int
        Of the weights that it begins with, and of the chips that are shown.

    Returns
    -------
    dict of str to ndarray
        The weights.

    Raises
    ------
    ModuleNotFoundError
        If PyTorch is not installed.
    """
    try:
        import torch
        from torch.nn import functional
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "stage network needs PyTorch to be trained: pip install 'flgpr[network]'"
        ) from error
    generator = torch.Generator().manual_seed(seed)
    sizes = (mines.shape[1], *settings.channels)
    weights = _first_weights(torch, sizes, generator)

    classes = [torch.from_numpy(chips) for chips in (mines, clutter)]
    half = 32  # chips of each class in a batch
    label = torch.cat([torch.ones(half), torch.zeros(half)])
    rounds = settings.epochs * -(-len(clutter) // half)
    optimizer = torch.optim.AdamW(weights.values(), settings.rate, weight_decay=settings.decay)
    scheduler = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, rounds)
    for _ in range(rounds):
        drawn = [
            chips[torch.randint(len(chips), (half,), generator=generator)] for chips in classes
        ]
        x = torch.cat(drawn)
        mirrored = torch.rand(len(x), generator=generator) < 0.5
        x = torch.where(mirrored[:, None, None, None], x.flip(3), x)

        for layer, stride in enumerate(_STRIDES):
            kernel = weights[f"kernel{layer}"]
            x = functional.relu(functional.conv2d(x, kernel, weights[f"bias{layer}"], stride))
        score = x.mean((2, 3)) @ weights["last"] + weights["bias"]
        loss = functional.binary_cross_entropy_with_logits(score, label)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        scheduler.step()
    return {name: weight.detach().numpy() for name, weight in weights.items()}


def _first_weights(torch: Any, sizes: tuple[int, ...], generator: Any) -> Entries:
    """Draw the weights that a network of layers of these channels begins with."""
    weights: Entries = {}
    for layer, (inputs, outputs) in enumerate(pairwise(sizes)):
        # Variance 2 / inputs of a unit, so that signals keep their power from layer to layer.
        scale = (2 / (9 * inputs)) ** 0.5
        weights[f"kernel{layer}"] = torch.randn(outputs, inputs, 3, 3, generator=generator) * scale
        weights[f"bias{layer}"] = torch.zeros(outputs)
    weights["last"] = torch.randn(sizes[-1], generator=generator) / sizes[-1] ** 0.5
    weights["bias"] = torch.zeros(1)
    for weight in weights.values():
        weight.requires_grad_()
    return weights


def _examples(
    lane: TrainingView, settings: NetworkSettings, rng: np.random.Generator
) -> tuple[Chips, Chips]:
    """Cut the chips of a lane's mines, moved about a little, and of its clutter."""
    level = np.log(np.maximum(lane.view.values, _FLOOR)).mean(axis=(0, 1))
    maxima = maxima_in_lane(lane, level, settings.radius)
    targets = floats(lane.truth[["x", "y"]])
    mines = targets[lane.truth["kind"].isin(settings.kinds).to_numpy()]

    at_mines = maxima[_distance_to_nearest(maxima, mines) <= settings.reach]
    clutter = maxima[_distance_to_nearest(maxima, targets) > settings.clear]
    # Every mine is shown nine times, first where it is and then moved at random.
    shown = np.repeat(np.concatenate([mines, at_mines]), 9, axis=0)
    is_moved = np.arange(len(shown)) % 9 > 0
    shown[is_moved] += rng.uniform(-settings.jitter, settings.jitter, (len(shown) // 9 * 8, 2))
    return _chips(lane.view, shown, settings.size), _chips(lane.view, clutter, settings.size)


def _distance_to_nearest(points: FloatArray, targets: FloatArray) -> FloatArray:
    """Return the distance of each point (n, 2) to the nearest target; infinity for none."""
    apart = points[:, None] - targets
    return floats(np.hypot(apart[..., 0], apart[..., 1]).min(axis=1, initial=np.inf))


def _chips(view: xr.DataArray, points: FloatArray, size: tuple[float, float]) -> Chips:
    """Cut log-magnitudes (chip, channel, y, x), dB, about points of a run-view.

    Where nothing was seen they are -60, below all clutter.
    """
    values = view.values.reshape(-1, *view.shape[-2:])
    chips = cut_regions(np.maximum(np.nan_to_num(values), _FLOOR), grid_of(view), points, size)
    return np.asarray(20 * np.log10(np.maximum(chips, _FLOOR)), dtype=np.float32)


def _normal(chips: Chips, mean: FloatArray, deviation: FloatArray) -> Chips:
    """Return chips of zero mean and unit deviation in every channel."""
    return np.asarray((chips - mean) / deviation, dtype=np.float32)

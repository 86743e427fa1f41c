"""Whether ground is unlike that of the training lanes, so that confidences do not hold on it.

Four figures of a lane are compared with those of the training lanes, each of these measured as if it
had not been trained on: by how many dB the level of the images departs over range and channels, how
far the lane's covariance lies from the learnt one (:func:`departures`), its largest eigenvalue where
the learnt one is white, and the share of chips that whitening leaves more power of than of 99.9 % of
those of training. No truth enters. Chips most like a mine are left out, and of a lane as many scans
are looked at as ``MOST_SCANS``.

The limit of a figure is the prediction limit of one more training lane: of figures whose logarithms
are Gaussian, it is passed with probability ``CHANCE``. How ``CHANCE`` was fixed:
docs/evidence/unlike-ground.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field
from scipy.special import stdtrit

from flgpr.model import Grid
from flgpr.model.bounds import Entries, NotNegative, Positive
from flgpr.stages.standing import spread_scans
from flgpr.stages.textured_clutter import SHAPES
from flgpr.types import AnyArray, FloatArray, IndexArray

MEASURED = "unlike"
"""Name of the pass that measures a lane's clutter, and of its result."""
SIZES = (1, 2, 4, 8)
"""Numbers of scans at which training lanes are measured; a lane counts by the next lower one."""
MOST_SCANS = SIZES[-1]
"""Scans of a lane that are looked at, at even distances."""
LEAST_LANES = 3
"""Training lanes from which there are limits."""
CHANCE = 0.0005
"""Probability with which a lane like those of training passes the limit of one of the figures."""
OWN_UP_TO = 0.1
"""Divergence over its limit, nats per value, up to which the lane's own covariance is used."""
UNLIKE_CHOICES = ("fallback", "keep", "refuse")
"""What can be done on ground that is unlike the training."""
SENTENCE = "this ground is unlike the training: the confidences do not hold"
_HIGHEST_RATE = 10  # false alarms per m² that may be asked for
_BEYOND = 1e-3  # share of the training's chips that lies beyond what the share is counted from
# Least standard deviation of logarithms, as figures of few lanes may agree by chance, and what is added
# before. Chips overlap, so that those beyond come in clusters: their share is coarse where there are few.
_LEAST_SPREAD = {"level": 0.05, "divergence": 0.05, "eigenvalue": 0.05, "beyond": 0.4}
_ADDED = {"level": 1e-9, "divergence": 1e-9, "eigenvalue": 1e-9, "beyond": 0.01}
_FIGURES = {
    "level": ("the level of the images over range and channels departs by", "dB"),
    "divergence": ("the covariance of the clutter lies", "nats per value"),
    "eigenvalue": ("the largest eigenvalue of the whitened clutter is", ""),
    "beyond": ("the share of chips beyond 99.9 % of those of training is", ""),
}
_Figures = list[Annotated[float, Field(ge=0, le=1e30)]]


class OfSize(Entries):
    """Figures of the training lanes, of so many of their scans."""

    scans: Annotated[int, Field(ge=1, le=MOST_SCANS)]
    divergence: _Figures
    eigenvalue: _Figures
    beyond: _Figures


class FreeGround(Entries):
    """Alarms of a training lane that are of no target."""

    area: Positive  #: that was searched, m²
    confidence: list[Annotated[float, Field(ge=-1e30, le=1e30)]]  #: descending


class TrainingGround(Entries):
    """What a model knows of the ground of its training lanes."""

    lanes: Annotated[int, Field(ge=0)]
    #: of each lane, by how much its level departs from the mean of the others, dB
    level: _Figures = Field(default_factory=list)
    #: mean level of the images (channel, metre), dB over the mean of all
    profile: list[list[Annotated[float, Field(ge=-300, le=300)]]] = Field(default_factory=list)
    sizes: list[OfSize] = Field(default_factory=list)
    tail: list[Positive] = Field(
        default_factory=list
    )  #: by metre, what 99.9 % of the chips lie below
    apart: NotNegative = 0.0  #: distance of the scans that were looked at, m
    free: list[FreeGround] = Field(default_factory=list)  #: by lane

    @property
    def judges(self) -> bool:
        """Whether there are enough lanes for limits."""
        return self.lanes >= LEAST_LANES and bool(self.level)


@dataclass(frozen=True)
class Trust:
    """What is asked of a detection about how far it can be trusted."""

    #: what is done on ground that is unlike the training: "fallback", "keep" or "refuse"
    unlike: str = "fallback"
    far: float | None = None  #: false alarms per m² that a threshold is wanted for
    #: whether the passes end with what is compared with the training lanes
    only_measures: bool = False

    def __post_init__(self) -> None:
        if self.unlike not in UNLIKE_CHOICES:
            choices = ", ".join(UNLIKE_CHOICES)
            raise ValueError(f"unlike must be one of {choices}, got {self.unlike!r}")
        if self.far is not None and not 0 < self.far <= _HIGHEST_RATE:
            raise ValueError(
                f"far must be above 0 and at most {_HIGHEST_RATE} per m², got {self.far!r}"
            )


@dataclass(frozen=True)
class Figure:
    """A figure of a lane with its limit."""

    name: str
    value: float
    limit: float
    where: str = ""  #: where in range, or in which channel, it is largest

    @property
    def is_beyond(self) -> bool:
        """Whether it passes its limit."""
        return self.value > self.limit

    @property
    def words(self) -> str:
        """The figure and its limit in words."""
        words, unit = _FIGURES[self.name]
        value = f"{self.value:.3g} {unit}".strip()
        from_learnt = " from that of the training" if self.name == "divergence" else ""
        where = f", most {self.where}" if self.where else ""
        return f"{words} {value}{from_learnt}{where} (limit {self.limit:.3g})"


@dataclass(frozen=True)
class Comparison:
    """What the comparison of a lane with the training lanes gave."""

    figures: tuple[Figure, ...] = ()
    cannot: str = ""  #: why the lane cannot be judged; "" if it can

    @property
    def unlike(self) -> bool:
        """Whether any figure passes its limit."""
        return any(figure.is_beyond for figure in self.figures)

    @property
    def substitute(self) -> str:
        """What stands in for what was learnt of clutter: "own", "contrast", or "" for nothing.

        The lane's own covariance mends a covariance that is a little off. Farther off, the images
        hold something that the training never saw, and the contrast is all that is left.
        """
        if not self.unlike:
            return ""
        for figure in self.figures:
            if figure.name == "divergence" and figure.value <= figure.limit + OWN_UP_TO:
                return "own"
        return "contrast"

    def differences(self) -> list[str]:
        """Return in words what passes its limit, and by how much."""
        return [figure.words for figure in self.figures if figure.is_beyond]

    def notes(self, done: str = "") -> list[str]:
        """Return in plain words whether confidences hold.

        Parameters
        ----------
        done : str
            What was done about it on ground that is unlike the training.
        """
        if self.cannot:
            return [f"it cannot be judged whether this ground is like the training: {self.cannot}"]
        if not self.unlike:
            return []
        return [SENTENCE + (f"; {done}" if done else ""), *self.differences()]

    def as_json(self, done: str = "", more: Sequence[str] = ()) -> dict[str, Any]:
        """Return the verdict, all figures and the notes as JSON values."""
        figures = {}
        for figure in self.figures:
            figures[figure.name] = {
                "value": round(figure.value, 6),
                "limit": round(figure.limit, 6),
                "beyond": figure.is_beyond,
            }
        return {
            "judged": not self.cannot,
            "unlike": self.unlike,
            "figures": figures,
            "notes": [*self.notes(done), *more],
        }


# What is measured of a lane


def chosen_scans(scans: int) -> IndexArray:
    """Return the indices of the scans of a lane that are looked at, at even distances."""
    return spread_scans(scans, MOST_SCANS)


def size_number(place: int) -> int:
    """Return the number of the first size that holds the scan at a place among those looked at."""
    return int(np.searchsorted(SIZES, place + 1))


def level_profile(gain: AnyArray, grid: Grid, across: tuple[float, float]) -> FloatArray:
    """Return the level of images by channel and metre, dB over the mean of all.

    Parameters
    ----------
    gain : (polarization, subband, y, x) ndarray
        Gain background.
    grid : Grid
        Its pixels.
    across : tuple of float
        From where to where columns count, m; all of them, where none lies there.

    Returns
    -------
    (channel, metre) ndarray
        The median of a metre's power, which a bright target does not lift. A begun metre of less
        than half its rows is left out.
    """
    rows = max(1, round(1 / grid.dy))
    inside = (grid.x >= across[0]) & (grid.x <= across[1])
    columns = inside if inside.any() else np.ones(grid.nx, bool)
    power = gain[..., columns].astype(float).reshape(-1, gain.shape[-2], columns.sum()) ** 2
    edges = np.arange(0, power.shape[1], rows)
    if len(edges) > 1 and 2 * (power.shape[1] - edges[-1]) < rows:
        edges = edges[:-1]
    parts = np.split(power, edges[1:], axis=1)
    by_metre = np.stack([np.median(part, axis=(1, 2)) for part in parts], axis=1)
    decibels = 10 * np.log10(np.maximum(by_metre, np.finfo(np.float32).tiny))
    return np.asarray(decibels - decibels.mean())


def departures(
    covariance: AnyArray, count: FloatArray, whitener: AnyArray
) -> tuple[FloatArray, FloatArray]:
    """Return how far a lane's covariance lies from the learnt one, by metre.

    Of the whitened covariance of a metre and those before and after it, λ being its d eigenvalues,
    the divergence is (Σ λ - ln λ - 1) / d, the Stein loss per value. As many white chips as there
    are values are added, so that few chips do not seem far off.

    Parameters
    ----------
    covariance : (metre, value, value) ndarray of complex
        Sums of x x^H of chips of unit power.
    count : (metre,) ndarray
        Number of chips.
    whitener : (metre, value, value) ndarray of complex
        Whitens what was learnt.

    Returns
    -------
    divergence, eigenvalue : (metre,) ndarray
        Nats per value, and the largest eigenvalue. Zero and one where there are fewer chips than
        values.
    """
    size = covariance.shape[-1]
    divergence = np.zeros(len(count))
    eigenvalue = np.ones(len(count))
    white = whitener.astype(complex)
    whitened = white @ covariance @ white.conj().transpose(0, 2, 1)
    for metre in range(len(count)):
        near = slice(max(metre - 1, 0), metre + 2)
        chips = count[near].sum()
        if chips < size:
            continue
        mean = (whitened[near].sum(axis=0) + size * np.eye(size)) / (chips + size)
        values = np.maximum(np.linalg.eigvalsh(mean), 1e-12)
        divergence[metre] = np.mean(values - np.log(values) - 1)
        eigenvalue[metre] = values[-1]
    return divergence, eigenvalue


def share_beyond(shape: FloatArray, tail: Sequence[float]) -> float:
    """Return the share of chips (metre, class) beyond a border by metre."""
    beyond = 0.0
    for counts, border in zip(shape, tail, strict=True):
        beyond += counts[np.searchsorted(SHAPES, border, side="right") :].sum()
    return float(beyond / max(shape.sum(), 1))


def tail_of(shape: FloatArray) -> list[float]:
    """Return by metre the border of ``SHAPES`` that 99.9 % of the chips (metre, class) lie below."""
    borders = []
    everywhere = shape.sum(axis=0)
    for counts in shape:
        some = counts if counts.sum() >= 1 / _BEYOND else everywhere
        below = np.cumsum(some[:-1])
        number = int(np.searchsorted(below, (1 - _BEYOND) * some.sum()))
        borders.append(float(SHAPES[min(number, len(SHAPES) - 1)]))
    return borders


# What is learnt of training lanes, and how a lane compares


def departure_of_level(profile: FloatArray, mean: FloatArray) -> tuple[float, int, int]:
    """Return by how many dB a profile departs most from the mean, in which channel and metre."""
    off = np.abs(profile - mean)
    channel, metre = np.unravel_index(int(off.argmax()), off.shape)
    return float(off.max()), int(channel), int(metre)


def learn_levels(profiles: Sequence[FloatArray]) -> tuple[list[float], list[list[float]]]:
    """Return how far each lane's profile departs from the mean of the others, and the mean of all."""
    total = np.sum(profiles, axis=0)
    departs = []
    for profile in profiles:
        others = (total - profile) / max(len(profiles) - 1, 1)
        departs.append(departure_of_level(profile, others)[0])
    return departs, (total / len(profiles)).round(4).tolist()


def learn_clutter(
    lanes: Sequence[Mapping[str, AnyArray]], whiteners: Sequence[AnyArray]
) -> tuple[list[OfSize], list[float]]:
    """Return the figures of training lanes by size, and what 99.9 % of their chips lie below.

    Parameters
    ----------
    lanes : sequence of dict of str to ndarray
        Results of the pass ``MEASURED``, each by what was learnt without its lane.
    whiteners : sequence of (metre, value, value) ndarray
        What whitens by what was learnt without each lane.
    """
    tail = tail_of(np.sum([lane["shape"].sum(axis=0) for lane in lanes], axis=0))
    sizes = []
    for number, scans in enumerate(SIZES):
        figures: dict[str, list[float]] = {"divergence": [], "eigenvalue": [], "beyond": []}
        for lane, whitener in zip(lanes, whiteners, strict=True):
            if lane["scans"] < scans:
                continue
            so_far = {name: lane[name][: number + 1].sum(axis=0) for name in _SUMS}
            for name, (value, _) in figures_of_clutter(so_far, whitener, tail).items():
                figures[name].append(value)
        if len(figures["beyond"]) >= LEAST_LANES:
            sizes.append(OfSize(scans=scans, **figures))
    return sizes, tail


_SUMS = ("covariance", "count", "shape")


def figures_of_clutter(
    sums: Mapping[str, AnyArray], whitener: AnyArray, tail: Sequence[float]
) -> dict[str, tuple[float, int | None]]:
    """Return the figures of sums of clutter, each with the metre where it is largest.

    Divergence and eigenvalue are means over the metres by their chips: the largest would be that of
    the metre with the fewest.
    """
    divergence, eigenvalue = departures(sums["covariance"], sums["count"], whitener)
    weight = sums["count"] / max(sums["count"].sum(), 1)
    return {
        "divergence": (float(weight @ divergence), int(divergence.argmax())),
        "eigenvalue": (float(weight @ eigenvalue), int(eigenvalue.argmax())),
        "beyond": (share_beyond(sums["shape"], tail), None),
    }


def limit_of(name: str, figures: Iterable[float], chance: float = CHANCE) -> float:
    """Return what one more lane like these passes with a small probability."""
    logs = np.log(np.array(list(figures)) + _ADDED[name])
    spread = max(float(logs.std(ddof=1)), _LEAST_SPREAD[name])
    times = float(stdtrit(len(logs) - 1, 1 - chance)) * math.sqrt(1 + 1 / len(logs))
    return math.exp(min(float(logs.mean()) + times * spread, 60.0)) - _ADDED[name]


def compare_clutter(
    ground: TrainingGround,
    sums: Mapping[str, AnyArray],
    scans: float,
    whitener: AnyArray,
    nearest: float,
) -> list[Figure]:
    """Compare a lane's clutter with that of the training lanes.

    Parameters
    ----------
    ground : TrainingGround
        What the model knows.
    sums : dict of str to ndarray
        ``covariance``, ``count`` and ``shape`` of the lane.
    scans : float
        Number of scans that entered them.
    whitener : (metre, value, value) ndarray
        What was learnt.
    nearest : float
        Distance of the images' near border, m.

    Returns
    -------
    list of Figure
        None where there are limits for no so few scans.
    """
    fitting = [size for size in ground.sizes if size.scans <= scans + 1e-6]
    if not fitting or len(ground.tail) != len(sums["count"]):
        return []
    figures = []
    for name, (value, metre) in figures_of_clutter(sums, whitener, ground.tail).items():
        limit = limit_of(name, getattr(fitting[-1], name))
        where = "" if metre is None else _ahead(nearest + metre)
        figures.append(Figure(name, value, limit, where))
    return figures


def _ahead(first: float) -> str:
    """Return a metre of the range in words."""
    return f"{first:.1f} to {first + 1:.1f} m ahead"


def compare_level(
    ground: TrainingGround, profile: FloatArray, channels: Sequence[str], nearest: float
) -> list[Figure]:
    """Compare a lane's level of the images with that of the training lanes."""
    mean = np.array(ground.profile)
    if mean.shape != profile.shape:
        return []
    value, channel, metre = departure_of_level(profile, mean)
    where = f"in {channels[channel]} {_ahead(nearest + metre)}"
    return [Figure("level", value, limit_of("level", ground.level), where)]


def why_not(ground: TrainingGround | None) -> str:
    """Return why a model cannot judge ground; "" if it can."""
    if ground is None:
        return "the model was trained before that was learnt; train it again"
    if not ground.judges:
        return (
            f"the model was trained on {ground.lanes} of the {LEAST_LANES} lanes that are needed; "
            "train it on more"
        )
    return ""

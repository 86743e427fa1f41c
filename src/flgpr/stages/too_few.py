"""Training on too few mines: the counts of every step, and what to change in the recipe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.toml_text import toml_value
from flgpr.types import BoolArray, FloatArray, IndexArray

if TYPE_CHECKING:
    from flgpr.stages import TrainingView

TrainedOn = Literal["all", "mines", "clutter"]
"""The classes of alarms that a detector is trained on."""
HALF = 0.5
"""Largest share of the mines that makes templates and thresholds where a detector learns, too."""
_HEADERS = {
    "clutter": "[[clutter]]",
    "map": "[map]",
    "screen": "[screen]",
    "features": "[[columns]]",
}


class Tally(NamedTuple):
    """How many targets, alarms or samples a step left."""

    number: int
    what: str

    def __str__(self) -> str:
        return f"{self.what}: {self.number}"


class Change(NamedTuple):
    """An entry of a recipe with a value that lets more through."""

    key: str
    value: Any
    now: Any  #: the value that it has
    table: str = ""  #: header of its table

    def __str__(self) -> str:
        return f"{self.key} = {toml_value(self.value)} in {self.table} (now {toml_value(self.now)})"


class TooFewExamplesError(ValueError):
    """Examples that do not suffice for training.

    Parameters
    ----------
    needed : str
        What is needed, and what is there, such as "2 looks at mines or more, got 1".
    counts : sequence of Tally
        What each step left, in their order.
    changes : sequence of Change
        Entries that let more through; without a ``table``, entries of the stage's own.
    """

    def __init__(
        self, needed: str, counts: Sequence[Tally] = (), changes: Sequence[Change] = ()
    ) -> None:
        super().__init__(f"training needs {needed}")
        self.needed = needed
        self.counts = tuple(counts)
        self.changes = tuple(changes)

    def of_stage(self, name: str, before: Sequence[Tally] = ()) -> ValueError:
        """Return the error of a stage by its name in the recipe.

        ``before`` counts what the steps before it left.
        """
        changes = []
        for change in self.changes:
            if not change.table:
                change = change._replace(table=header(name))
            changes.append(change)
        return cannot_be_trained(name, f"it needs {self.needed}", [*before, *self.counts], changes)


def check_classes(trained_on: TrainedOn, hits: int, false_alarms: int) -> None:
    """Refuse training without an example of a class that a detector is trained on."""
    lacks_hits = trained_on != "clutter" and not hits
    lacks_false_alarms = trained_on != "mines" and not false_alarms
    if lacks_hits or lacks_false_alarms:
        classes = {"all": "hits and false alarms", "mines": "hits", "clutter": "false alarms"}
        raise TooFewExamplesError(
            f"{classes[trained_on]}, got {hits} hits and {false_alarms} false alarms"
        )


def cannot_be_trained(
    name: str, why: str, counts: Sequence[Tally], changes: Sequence[Change] = ()
) -> ValueError:
    """Return the error of a stage or detector that cannot be trained.

    Parameters
    ----------
    name : str
        Its name.
    why : str
        The reason.
    counts : sequence of Tally
        What each step left.
    changes : sequence of Change
        Entries of the recipe that let more through.
    """
    sentences = [f"{name} cannot be trained: {why.removesuffix('.')}."]
    if counts:
        sentences.append(f"Step by step: {'; '.join(map(str, counts))}.")
    if changes:
        sentences.append(f"Set {', or '.join(map(str, changes))}; or give more lanes with mines.")
    else:
        sentences.append("Give more lanes with mines.")
    return ValueError(" ".join(sentences))


def header(name: str) -> str:
    """Return which table of a recipe holds a stage, by its name such as "clutter.masks"."""
    kind, _, stage = name.partition(".")
    table = _HEADERS[kind]
    return f'{table} of stage "{stage}"' if table.startswith("[[") else table


def looser_entries(settings: Any, values: Mapping[str, Any], table: str = "") -> list[Change]:
    """Return the entries of a table that do not have these values yet."""
    changes = []
    for key, value in values.items():
        present = getattr(settings, key)
        if present != value:
            changes.append(Change(key, value, present, table))
    return changes


def count_targets(truths: Sequence[pd.DataFrame]) -> Tally:
    """Count the targets of truth tables, by kind."""
    kinds = pd.concat([truth["kind"] for truth in truths]).value_counts().sort_index()
    counts = ", ".join(f"{number} {kind}" for kind, number in kinds.items())
    what = "targets in the truth"
    if counts:
        what += f" ({counts})"
    return Tally(int(kinds.sum()), what)


def count_in_views(views: Sequence[TrainingView], spent: Sequence[pd.DataFrame]) -> list[Tally]:
    """Count the targets that run-views hold.

    Parameters
    ----------
    views : sequence of TrainingView
        Run-view and truth of every training lane.
    spent : sequence of DataFrame
        Of each lane the rows of the truth that the stage learns from; may be empty.

    Returns
    -------
    list of Tally
        Targets in the run-views, those that scans saw in all channels, and how many of these the
        stage learns from.
    """
    in_view = 0
    in_all_channels = 0
    spent_in_all_channels = 0
    for number, lane in enumerate(views):
        is_seen = _seen_in_all_channels(lane.view, lane.truth)
        in_view += int(_inside(lane.view, lane.truth).sum())
        in_all_channels += int(is_seen.sum())
        if spent:
            is_spent = lane.truth.index.isin(spent[number].index)
            spent_in_all_channels += int(is_seen[is_spent].sum())
    counts = [
        Tally(in_view, "in the run-view"),
        Tally(in_all_channels, "seen in all of its channels"),
    ]
    if not spent:
        return counts
    return [
        *counts,
        Tally(sum(map(len, spent)), "taken for this stage"),
        Tally(spent_in_all_channels, "of these seen in all channels"),
    ]


def _inside(view: xr.DataArray, truth: pd.DataFrame) -> BoolArray:
    """Return which targets lie within the borders of a run-view."""
    x = view["x"].values
    y = view["y"].values
    inside = truth["x"].between(x[0], x[-1]) & truth["y"].between(y[0], y[-1])
    return np.asarray(inside, dtype=bool)


def _seen_in_all_channels(view: xr.DataArray, truth: pd.DataFrame) -> BoolArray:
    """Return which targets lie on a pixel of the run-view that has a magnitude in all channels."""
    column = _nearest(view["x"].values, truth["x"])
    row = _nearest(view["y"].values, truth["y"])
    magnitude = view.values.reshape(-1, *view.shape[-2:])[:, row, column]
    return np.asarray(_inside(view, truth) & (magnitude > 0).all(axis=0), dtype=bool)


def _nearest(axis: FloatArray, coordinates: pd.Series[float]) -> IndexArray:
    """Return the index of the pixel of an axis that is nearest to each coordinate."""
    distance = np.abs(axis - coordinates.to_numpy(dtype=np.float64)[:, None])
    return distance.argmin(axis=1)


def share_changes(settings: Any, name: str) -> list[Change]:
    """Return the change that lets more of the mines make what a stage learns.

    None where its table has no ``share``, or one that is large enough.
    """
    share = getattr(settings, "share", HALF)
    return [Change("share", HALF, share, header(name))] if share < HALF else []


def clear_change(settings: Any) -> Change:
    """Return the change that takes clutter from nearer to the targets.

    It is half as far, and no farther than the stage's default.
    """
    default = type(settings).model_fields["clear"].default
    return Change("clear", min(settings.clear / 2, default), settings.clear)

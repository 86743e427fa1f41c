"""Training on too few mines: how it is told what there was, step by step, and what to change in the recipe."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

if TYPE_CHECKING:
    from flgpr.chain.stages import TrainingView

Shown = Literal["all", "mines", "clutter"]
_HEADERS = {
    "clutter": "[[clutter]]",
    "map": "[map]",
    "screen": "[screen]",
    "features": "[[columns]]",
}
# of the mines make templates and thresholds, at most, where a detector learns from the others
HALF = 0.5


class Tally(NamedTuple):
    """How many of what a step left."""

    number: int
    what: str

    def __str__(self) -> str:
        return f"{self.what}: {self.number}"


class Change(NamedTuple):
    """An entry of a recipe, a value that lets more through, and the value it has; ``table`` is its header."""

    key: str
    value: Any
    now: Any
    table: str = ""

    def __str__(self) -> str:
        return f"{self.key} = {_toml(self.value)} in {self.table} (now {_toml(self.now)})"


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
        """Word it for a stage by its name in the recipe; ``before`` counts what the steps before it left."""
        changes = [one if one.table else one._replace(table=header(name)) for one in self.changes]
        return cannot_be_trained(name, f"it needs {self.needed}", [*before, *self.counts], changes)


def check_classes(shown: Shown, hits: int, false_alarms: int) -> None:
    """Refuse training without an example of a class that a detector is shown."""
    if (shown != "clutter" and not hits) or (shown != "mines" and not false_alarms):
        words = {"all": "hits and false alarms", "mines": "hits", "clutter": "false alarms"}[shown]
        raise TooFewExamplesError(f"{words}, got {hits} hits and {false_alarms} false alarms")


def cannot_be_trained(
    name: str, why: str, counts: Sequence[Tally], changes: Sequence[Change] = ()
) -> ValueError:
    """Word that something cannot be trained: why, what each step left, and what to change."""
    parts = [f"{name} cannot be trained: {why.removesuffix('.')}."]
    if counts:
        parts.append(f"Step by step: {'; '.join(map(str, counts))}.")
    if changes:
        parts.append(f"Set {', or '.join(map(str, changes))}; or give more lanes with mines.")
    else:
        parts.append("Give more lanes with mines.")
    return ValueError(" ".join(parts))


def header(name: str) -> str:
    """Return which table of a recipe holds a stage, by its name such as "clutter.masks"."""
    kind, _, stage = name.partition(".")
    table = _HEADERS[kind]
    return f'{table} of stage "{stage}"' if table.startswith("[[") else table


def _toml(value: Any) -> str:
    """Write a value as TOML does: JSON is the same for words, numbers, truth values and lists of them."""
    return json.dumps(list(value) if isinstance(value, tuple) else value, ensure_ascii=False)


def looser_entries(settings: Any, values: Mapping[str, Any], table: str = "") -> list[Change]:
    """List the entries of a table that do not have these values yet."""
    present = {key: getattr(settings, key) for key in values}
    return [
        Change(key, value, present[key], table)
        for key, value in values.items()
        if present[key] != value
    ]


def count_targets(truths: Sequence[pd.DataFrame]) -> Tally:
    """Count the targets of truth tables by kind."""
    kinds = pd.concat([truth["kind"] for truth in truths]).value_counts().sort_index()
    each = ", ".join(f"{number} {kind}" for kind, number in kinds.items())
    return Tally(
        int(kinds.sum()), f"targets in the truth ({each})" if each else "targets in the truth"
    )


def count_in_views(views: Sequence[TrainingView], spent: Sequence[pd.DataFrame]) -> list[Tally]:
    """Count the targets that run-views hold, that scans saw in all channels, and that a stage learns from."""
    inside = seen = seen_of_spent = 0
    for number, lane in enumerate(views):
        shown = _seen(lane.view, lane.truth)
        inside += int(_inside(lane.view, lane.truth).sum())
        seen += int(shown.sum())
        if spent:
            seen_of_spent += int(shown[lane.truth.index.isin(spent[number].index)].sum())
    counts = [Tally(inside, "in the run-view"), Tally(seen, "seen in all of its channels")]
    if not spent:
        return counts
    taken = sum(map(len, spent))
    return [
        *counts,
        Tally(taken, "taken for this stage"),
        Tally(seen_of_spent, "of these seen in all channels"),
    ]


def _inside(view: xr.DataArray, truth: pd.DataFrame) -> NDArray[np.bool_]:
    x, y = view["x"].values, view["y"].values
    return np.asarray(truth["x"].between(x[0], x[-1]) & truth["y"].between(y[0], y[-1]), dtype=bool)


def _seen(view: xr.DataArray, truth: pd.DataFrame) -> NDArray[np.bool_]:
    """Return which targets lie on a pixel of the run-view that has a magnitude in all channels."""
    x, y = (view[axis].values for axis in "xy")
    column = np.abs(x - truth["x"].to_numpy(dtype=np.float64)[:, None]).argmin(axis=1)
    row = np.abs(y - truth["y"].to_numpy(dtype=np.float64)[:, None]).argmin(axis=1)
    magnitude = view.values.reshape(-1, *view.shape[-2:])[:, row, column]
    return np.asarray(_inside(view, truth) & (magnitude > 0).all(axis=0), dtype=bool)


def share_changes(settings: Any, name: str) -> list[Change]:
    """Offer to let more of the mines make what a stage learns, where its table says how many."""
    share = getattr(settings, "share", HALF)
    return [Change("share", HALF, share, header(name))] if share < HALF else []


def clear_change(settings: Any) -> Change:
    """Offer clutter nearer to the targets: half as far, and no farther than the stage does by itself."""
    usual = type(settings).model_fields["clear"].default
    return Change("clear", min(settings.clear / 2, usual), settings.clear)


def kinds_change(settings: Any, views: Sequence[TrainingView]) -> list[Change]:
    """Offer the kinds of targets that the truth holds, where these are others than a stage learns from."""
    kinds = sorted(set(pd.concat([lane.truth["kind"] for lane in views])))
    return (
        [Change("kinds", kinds, list(settings.kinds))] if set(kinds) - set(settings.kinds) else []
    )

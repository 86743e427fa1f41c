"""What each step before the training of a detector left of targets and alarms, and where these ran out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.chain.classifier import label_lanes
from flgpr.chain.recipe import Recipe
from flgpr.chain.too_few import (
    HALF,
    Change,
    Shown,
    Tally,
    TooFewExamplesError,
    cannot_be_trained,
    count_targets,
    header,
    looser_entries,
)
from flgpr.model import Lane

_USUAL_DENSITY = 0.75  # alarms per m² of Wang et al. 2007
LaneOfAlarms = tuple[str, pd.DataFrame, pd.DataFrame, pd.DataFrame, Lane]


@dataclass(frozen=True)
class AlarmSteps:
    """How many targets and alarms each step before the training of a detector left."""

    targets: Tally
    spent: Mapping[
        str, int
    ]  #: targets by the stage that took them, which the detector does not learn from
    left: int  #: targets that no stage took
    raised: int  #: alarms, of which those with a confidence are labelled
    hits: int
    false_alarms: int
    neither: int
    hits_left: int  #: hits on targets that no stage took
    complete: tuple[
        int, int
    ]  #: hits and false alarms that have all features, on targets that no stage took
    radius: float  #: of hits about a target, m
    have: Mapping[str, tuple[int, int]] = field(
        default_factory=dict
    )  #: of these, how many have a feature, by feature

    def counts(self, recipe: Recipe) -> list[Tally]:
        """List what each step left, in their order."""
        taken = [Tally(number, f"taken by {name}") for name, number in self.spent.items()]
        lost = [
            Tally(number, f"alarms without the feature {name}")
            for name, number in self._lacking().items()
        ]
        unranked = self.raised - self.hits - self.false_alarms - self.neither
        return [
            self.targets,
            *taken,
            Tally(self.left, "targets left for the detector"),
            Tally(self.raised, f"alarms raised by {_screen_of(recipe)}"),
            *([Tally(unranked, "of these without a confidence, left out")] if unranked else []),
            Tally(self.hits, f"hits, within {self.radius:g} m of a target"),
            Tally(self.false_alarms, "false alarms"),
            Tally(self.neither, "outside the lane, neither"),
            Tally(self.hits_left, "hits on targets left for the detector"),
            *lost,
            Tally(self.complete[0], "hits with all features"),
            Tally(self.complete[1], "false alarms with all features"),
        ]

    def told(self, error: TooFewExamplesError, recipe: Recipe, shown: Shown) -> ValueError:
        """Word that a detector, shown both classes or one, has too few examples."""
        lost = self.ran_out(recipe, shown)
        why = f"it needs {error.needed}" + (f": {lost}" if lost else "")
        return cannot_be_trained(
            "detector", why, self.counts(recipe), [*error.changes, *self.changes(recipe, shown)]
        )

    def _lacking(self) -> dict[str, int]:
        """Count the hits and false alarms left without a feature, by feature."""
        total = self.hits_left + self.false_alarms
        return {name: total - sum(both) for name, both in self.have.items() if sum(both) < total}

    def ran_out(self, recipe: Recipe, shown: Shown) -> str:
        """Return at which step hits, or false alarms, ran out; "" if some are left."""
        screen = _screen_of(recipe)
        names = ", ".join(self._lacking())
        if shown != "clutter" and not self.complete[0]:
            if not self.targets.number:
                return "the truth holds no target"
            if not self.left:
                return f"{' and '.join(self.spent)} took all targets"
            if not self.hits_left:
                return f"{screen} raised no alarm at the targets left for the detector"
            return f"no hit has all features ({names})"
        if shown != "mines" and not self.complete[1]:
            return (
                f"no false alarm has all features ({names})"
                if self.false_alarms
                else f"{screen} raised no false alarm"
            )
        return ""

    def changes(self, recipe: Recipe, shown: Shown) -> list[Change]:
        """List entries of the recipe that let more through where they ran out."""
        no_hit = shown != "clutter" and not self.complete[0]
        if no_hit and not self.targets.number:
            return []
        if no_hit and not self.left:
            named = recipe.named()
            shares = {name: getattr(named[name].settings, "share", 0.0) for name in self.spent}
            return [
                Change("share", HALF, share, header(name))
                for name, share in shares.items()
                if share > HALF
            ]
        no_false_alarm = shown != "mines" and not self.complete[1]
        if (no_hit and self.hits_left) or (not no_hit and no_false_alarm and self.false_alarms):
            return self._fewer_features(recipe, shown)
        return screen_changes(recipe)

    def _fewer_features(self, recipe: Recipe, shown: Shown) -> list[Change]:
        """Offer those features that some hit and some false alarm, as far as they are shown, have."""
        usable = [
            name
            for name, (hits, false_alarms) in self.have.items()
            if (hits or shown == "clutter") and (false_alarms or shown == "mines")
        ]
        present = list(recipe.detector.features) if recipe.detector is not None else list(self.have)
        return (
            [Change("features", usable, present, "[detector]")]
            if 0 < len(usable) < len(self.have)
            else []
        )


def screen_changes(recipe: Recipe) -> list[Change]:
    """List entries of the recipe with which more alarms are raised."""
    if recipe.screen is not None:
        return looser_entries(recipe.screen.settings, recipe.screen.stage_class.looser, "[screen]")
    density = recipe.prescreen.density
    return [Change("density", max(2 * density, _USUAL_DENSITY), density, "[prescreen]")]


def _screen_of(recipe: Recipe) -> str:
    return "the prescreener" if recipe.screen is None else f"screen.{recipe.screen.stage}"


def count_alarm_steps(
    lanes: Sequence[LaneOfAlarms],
    raised: int,
    spent: Mapping[str, Sequence[pd.DataFrame]],
    columns: Sequence[str],
    label_radius: float,
) -> AlarmSteps:
    """Count what each step of :func:`flgpr.chain.classifier.make_training_set` leaves.

    Parameters
    ----------
    lanes : sequence of tuple
        Name, alarms, features, truth and borders of every lane.
    raised : int
        Alarms of all lanes before those without a confidence were left out.
    spent : mapping of str to sequence of DataFrame
        By stage, the rows of each lane's truth that made what it learnt.
    columns : sequence of str
        Features that the detector reads.
    label_radius : float
        r_label, m.
    """
    truths = [truth for *_, truth, _ in lanes]
    taken = np.concatenate([_taken(truth, number, spent) for number, truth in enumerate(truths)])
    labels = label_lanes(
        [(name, alarms, truth, lane) for name, alarms, _, truth, lane in lanes], label_radius
    )
    known = np.isfinite(
        pd.concat([one[2] for one in lanes])[list(columns)].to_numpy(dtype=np.float64)
    )
    hit = (labels["label"] == "hit").to_numpy()
    false = (labels["label"] == "false").to_numpy()
    hit_left = hit & ~np.append(taken, True)[labels["target"].to_numpy()]
    whole = known.all(axis=1)
    return AlarmSteps(
        targets=count_targets(truths),
        spent={name: sum(map(len, rows)) for name, rows in spent.items()},
        left=int((~taken).sum()),
        raised=raised,
        hits=int(hit.sum()),
        false_alarms=int(false.sum()),
        neither=int((labels["label"] == "neither").sum()),
        hits_left=int(hit_left.sum()),
        complete=(int((hit_left & whole).sum()), int((false & whole).sum())),
        radius=label_radius,
        have={
            name: (int(known[hit_left, k].sum()), int(known[false, k].sum()))
            for k, name in enumerate(columns)
        },
    )


def _taken(
    truth: pd.DataFrame, lane: int, spent: Mapping[str, Sequence[pd.DataFrame]]
) -> NDArray[np.bool_]:
    """Return which targets of a lane, by its number, some stage took."""
    taken = np.zeros(len(truth), bool)
    for rows in spent.values():
        taken |= truth.index.isin(rows[lane].index)
    return taken

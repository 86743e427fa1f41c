"""How many targets and alarms each step before the training of a detector left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from flgpr.method.classifier import LaneOfAlarms, label_lanes
from flgpr.recipe.schema import Recipe
from flgpr.stages.too_few import (
    HALF,
    Change,
    Tally,
    TooFewExamplesError,
    TrainedOn,
    cannot_be_trained,
    count_targets,
    header,
    looser_entries,
)
from flgpr.types import BoolArray

_USUAL_DENSITY = 0.75  # alarms per area of an alarm, Wang et al. 2007


@dataclass(frozen=True)
class AlarmSteps:
    """How many targets and alarms each step before the training of a detector left."""

    targets: Tally
    spent: Mapping[str, int]  #: number of targets that made what a stage has learnt, by stage
    left: int  #: targets that no stage learnt from; the detector learns from these alone
    raised: int  #: alarms, of which those with a confidence are labelled
    hits: int
    false_alarms: int
    neither: int
    hits_left: int  #: hits on targets that no stage learnt from
    #: hits on targets that no stage learnt from, and false alarms, that have all features
    complete: tuple[int, int]
    radius: float  #: of hits about a target, m
    #: how many of the same have a feature, by feature
    have: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    def counts(self, recipe: Recipe) -> list[Tally]:
        """Return what each step left, in their order."""
        counts = [self.targets]
        for stage, number in self.spent.items():
            counts.append(Tally(number, f"taken by {stage}"))
        counts.append(Tally(self.left, "targets left for the detector"))

        counts.append(Tally(self.raised, f"alarms raised by {_screen_of(recipe)}"))
        unranked = self.raised - self.hits - self.false_alarms - self.neither
        if unranked:
            counts.append(Tally(unranked, "of these without a confidence, left out"))
        counts.append(Tally(self.hits, f"hits, within {self.radius:g} m of a target"))
        counts.append(Tally(self.false_alarms, "false alarms"))
        counts.append(Tally(self.neither, "outside the lane, neither"))

        counts.append(Tally(self.hits_left, "hits on targets left for the detector"))
        for feature, number in self._lacking().items():
            counts.append(Tally(number, f"alarms without the feature {feature}"))
        hits, false_alarms = self.complete
        counts.append(Tally(hits, "hits with all features"))
        counts.append(Tally(false_alarms, "false alarms with all features"))
        return counts

    def error(
        self, error: TooFewExamplesError, recipe: Recipe, trained_on: TrainedOn
    ) -> ValueError:
        """Return the error of a detector that has too few examples.

        Parameters
        ----------
        error : TooFewExamplesError
            What the training of the detector raised.
        recipe : Recipe
            The recipe.
        trained_on : {"all", "mines", "clutter"}
            The classes of alarms that the detector is trained on.
        """
        why = f"it needs {error.needed}"
        reason = self.ran_out(recipe, trained_on)
        if reason:
            why += f": {reason}"
        changes = [*error.changes, *self.changes(recipe, trained_on)]
        return cannot_be_trained("detector", why, self.counts(recipe), changes)

    def _lacking(self) -> dict[str, int]:
        """Return how many hits and false alarms lack a feature, by feature."""
        total = self.hits_left + self.false_alarms
        lacking = {}
        for feature, numbers in self.have.items():
            if sum(numbers) < total:
                lacking[feature] = total - sum(numbers)
        return lacking

    def _lacks_hits(self, trained_on: TrainedOn) -> bool:
        """Return whether the detector needs hits and there are none."""
        return trained_on != "clutter" and not self.complete[0]

    def _lacks_false_alarms(self, trained_on: TrainedOn) -> bool:
        """Return whether the detector needs false alarms and there are none."""
        return trained_on != "mines" and not self.complete[1]

    def ran_out(self, recipe: Recipe, trained_on: TrainedOn) -> str:
        """Return at which step hits, or false alarms, ran out; "" if some are left."""
        screen = _screen_of(recipe)
        features = ", ".join(self._lacking())
        if self._lacks_hits(trained_on):
            if not self.targets.number:
                return "the truth holds no target"
            if not self.left:
                return f"{' and '.join(self.spent)} took all targets"
            if not self.hits_left:
                return f"{screen} raised no alarm at the targets left for the detector"
            return f"no hit has all features ({features})"
        if self._lacks_false_alarms(trained_on):
            if self.false_alarms:
                return f"no false alarm has all features ({features})"
            return f"{screen} raised no false alarm"
        return ""

    def changes(self, recipe: Recipe, trained_on: TrainedOn) -> list[Change]:
        """Return entries of the recipe that let more through where they ran out."""
        lacks_hits = self._lacks_hits(trained_on)
        if lacks_hits and not self.targets.number:
            return []
        if lacks_hits and not self.left:
            stages = recipe.named()
            changes = []
            for name in self.spent:
                share = getattr(stages[name].settings, "share", 0.0)
                if share > HALF:
                    changes.append(Change("share", HALF, share, header(name)))
            return changes
        if lacks_hits:
            fewer_features_help = self.hits_left > 0
        else:
            fewer_features_help = self._lacks_false_alarms(trained_on) and self.false_alarms > 0
        if fewer_features_help:
            usable = []
            for feature, (hits, false_alarms) in self.have.items():
                enough_hits = hits > 0 or trained_on == "clutter"
                enough_false_alarms = false_alarms > 0 or trained_on == "mines"
                if enough_hits and enough_false_alarms:
                    usable.append(feature)
            if not 0 < len(usable) < len(self.have):
                return []
            present = list(self.have)
            if recipe.detector is not None:
                present = list(recipe.detector.features)
            return [Change("features", usable, present, "[detector]")]
        if recipe.screen is not None:
            return looser_entries(
                recipe.screen.settings, recipe.screen.stage_class.looser, "[screen]"
            )
        density = recipe.prescreen.density
        return [Change("density", max(2 * density, _USUAL_DENSITY), density, "[prescreen]")]


def _screen_of(recipe: Recipe) -> str:
    """Return the name of what raises alarms."""
    return "the prescreener" if recipe.screen is None else f"screen.{recipe.screen.stage}"


def count_alarm_steps(
    lanes: Sequence[LaneOfAlarms],
    raised: int,
    spent: Mapping[str, Sequence[pd.DataFrame]],
    columns: Sequence[str],
    label_radius: float,
) -> AlarmSteps:
    """Count what each step of :func:`flgpr.method.classifier.make_training_set` leaves.

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

    Returns
    -------
    AlarmSteps
        The counts.
    """
    truths = [truth for *_, truth, _ in lanes]
    is_spent = np.concatenate(
        [_spent_targets(truth, number, spent) for number, truth in enumerate(truths)]
    )
    labels = label_lanes(lanes, label_radius)
    features = pd.concat([features for _, _, features, _, _ in lanes])
    known = np.isfinite(features[list(columns)].to_numpy(dtype=np.float64))
    complete = known.all(axis=1)

    hit = (labels["label"] == "hit").to_numpy()
    false = (labels["label"] == "false").to_numpy()
    # Alarms that hit nothing have the number -1, which picks the True at the end.
    hit_left = hit & ~np.append(is_spent, True)[labels["target"].to_numpy()]
    have = {}
    for number, name in enumerate(columns):
        hits_with = int(known[hit_left, number].sum())
        false_alarms_with = int(known[false, number].sum())
        have[name] = (hits_with, false_alarms_with)
    return AlarmSteps(
        targets=count_targets(truths),
        spent={name: sum(map(len, rows)) for name, rows in spent.items()},
        left=int((~is_spent).sum()),
        raised=raised,
        hits=int(hit.sum()),
        false_alarms=int(false.sum()),
        neither=int((labels["label"] == "neither").sum()),
        hits_left=int(hit_left.sum()),
        complete=(int((hit_left & complete).sum()), int((false & complete).sum())),
        radius=label_radius,
        have=have,
    )


def _spent_targets(
    truth: pd.DataFrame, lane: int, spent: Mapping[str, Sequence[pd.DataFrame]]
) -> BoolArray:
    """Return which targets of a lane, by its number, some stage has learnt from."""
    is_spent = np.zeros(len(truth), bool)
    for rows in spent.values():
        is_spent |= truth.index.isin(rows[lane].index)
    return is_spent

"""What the JSON of a score holds: the members of its objects.

``evidence/make_schemas.py`` makes the published JSON Schemas of them. Infinite and unknown values
are null in the JSON.
"""

from __future__ import annotations

from typing import Annotated, Literal, NotRequired

from pydantic import Field

# Pydantic reads the typed dictionaries of ``typing`` only from Python 3.12 on.
from typing_extensions import TypedDict

from flgpr.scoring.lane_roc import AreaRule
from flgpr.scoring.places import SurveyShare
from flgpr.types import Entries

Count = Annotated[int, Field(ge=0)]
Number = Annotated[float, Field(ge=0)]
Probability = Annotated[float, Field(ge=0, le=1)]
Difference = Annotated[float, Field(ge=-1, le=1)]
Area = Annotated[float, Field(gt=0)]


class Rates(TypedDict):
    """Pd and false alarm rate (FAR) at a point of a ROC."""

    pd: Probability | None  #: null without targets
    #: pd_low, pd_high: exact interval of ``pd``
    pd_low: Probability
    pd_high: Probability
    far: Number  #: false alarms per m²
    #: far_low, far_high: exact interval of ``far``, per m²
    far_low: Number
    far_high: Number
    n_detected: Count  #: targets found
    n_false: Count  #: false alarms
    chance: Probability | None  #: Pd of alarms that know nothing of the targets


class CurvePoint(Rates):
    """A point of a ROC."""

    threshold: float | None  #: least confidence that is declared; null: nothing is


class OperatingPoint(CurvePoint):
    """The point at which targets count as found."""

    far_asked: Number  #: FAR of the rules, per m²
    far_allowed: Number  #: that, or one false alarm where the lane cannot tell less, per m²
    n_targets: Count
    area: Area  #: area of the FAR, m²
    random: Probability | None  #: Pd of alarms strewn at random at the same FAR


class KindPoint(Rates):
    """A point of the ROC of a kind of target."""

    far_allowed: Number  #: largest FAR that was allowed, per m²


class MeanPd(TypedDict):
    """Pd averaged over the FAR."""

    value: Probability | None
    chance: Probability | None  #: that of alarms that know nothing of the targets


class MeanPdInterval(MeanPd):
    """Pd averaged over the FAR, with a bootstrap interval."""

    #: low, high: interval of ``value``
    low: Probability | None
    high: Probability | None
    far_max: Number  #: end of the averaging, per m²


class KindEntries(TypedDict):
    """The score of a kind of target."""

    n_targets: Count
    pd_mean: MeanPd
    points: list[KindPoint]


class TargetOutcome(TypedDict):
    """What became of a target; its row of the truth table stands here, too."""

    detected: bool  #: whether any alarm lies in its halo
    found: bool  #: whether it is found at the operating point
    alarm: Annotated[int, Field(ge=-1)]  #: row of its best alarm, from 0; -1 for none
    confidence: float | None  #: of that alarm
    #: dx, dy: offset of that alarm from the target, m
    dx: float | None
    dy: float | None
    distance: Number | None  #: of that alarm from the target, m
    rank: Count  #: of that alarm, 1 for the highest; 0 for none
    n_false: Count  #: false alarms at or above its confidence
    far: Number | None  #: the same per m²: the FAR at which the target is found; null: never
    #: how far beyond its position its image lies by refraction, m; of a result
    expected_shift: NotRequired[float | None]


class DetectionEntries(TypedDict):
    """The score of an alarm list."""

    title: str
    n_alarms: Count
    n_targets: Count  #: targets that are scored
    n_known_targets: Count  #: targets whose halos hold no false alarm
    area: Area  #: area of the FAR, m²
    n_false: Count  #: false alarms in all
    operating_point: OperatingPoint
    pd_mean: MeanPdInterval | None  #: null without targets
    points: list[CurvePoint]  #: the ROC
    kinds: dict[str, KindEntries]  #: by the kind of target
    targets: list[TargetOutcome]


class Draws(TypedDict):
    """The draws of the bootstrap."""

    draws: Count
    seed: int


class Shifts(TypedDict):
    """The shifts of the chance level."""

    shifts: Count
    seed: int


class RulesEntries(TypedDict):
    """The convention and all choices, which are the same for all lists of a lane."""

    convention: str  #: name of the convention
    source: str  #: where it is published
    far_is: str  #: what its FAR is
    area_rule: AreaRule
    halo_radius: Area  #: m
    lanes: list[str]  #: names of the lanes; one lane without a name is ""
    subset: str  #: targets that are scored
    shared: Literal["drop", "count"]  #: what an alarm near a target outside the subset counts
    refraction: str  #: correction of the truth
    level: Probability  #: level of the intervals
    far: Number  #: FAR of the operating point, per m²
    bootstrap: Draws
    chance: Shifts
    survey_error: NotRequired[SurveyShare]  #: where it is known


class ScoreFile(TypedDict):
    """``roc.json`` of a score."""

    format: Literal["flgpr-score"]
    version: Literal[1]
    flgpr: str  #: version of the program
    rules: RulesEntries
    notes: Entries  #: digests, sources and remarks
    detections: dict[str, DetectionEntries]  #: by name; ``main`` is the first


class BlindPoint(Rates):
    """A point of a group of targets in a blind score."""

    group: str  #: ``all`` or a group of targets
    far_allowed: Number  #: per m²
    n_targets: Count


class BlindTarget(TypedDict):
    """A target of a blind score, where its owner allows it; never its position."""

    target_id: str
    lane: NotRequired[str]
    kind: str
    depth: float | None  #: m
    found_from: Number | None  #: least allowed FAR at which it is found, per m²; null at none


class BlindDetection(TypedDict):
    """The blind score of an alarm list."""

    title: str
    n_alarms: Count
    n_targets: Count
    area: Area  #: area of the FAR, m²
    points: list[BlindPoint]
    targets: NotRequired[list[BlindTarget]]


class BlindDetections(TypedDict):
    """The detections of a blind score."""

    main: BlindDetection


class BlindRules(TypedDict):
    """The rules of a blind score."""

    area_rule: AreaRule
    halo_radius: Area  #: m


class BlindNotes(TypedDict):
    """The looks at a sealed truth; other notes stand beside them."""

    looks: Annotated[int, Field(ge=1)]  #: how often this truth was scored or opened, this included
    lists: Annotated[int, Field(ge=1)]  #: number of different alarm lists among them


class BlindScoreFile(TypedDict):
    """``roc.json`` of a blind score."""

    format: Literal["flgpr-score"]
    version: Literal[1]
    flgpr: str  #: version of the program
    rules: BlindRules
    notes: BlindNotes
    detections: BlindDetections


class AllAlarms(TypedDict):
    """What all alarms of a list find, whatever their confidence."""

    found: Count
    false_alarms: Count
    chance: Probability | None


class SummaryOutcome(TypedDict):
    """What became of a target, in a summary."""

    detection: str  #: name of the alarm list
    target_id: str
    kind: str
    depth: float | None  #: m
    found: bool  #: whether it is found at the operating point
    detected: bool  #: whether any alarm lies in its halo
    far: Number | None  #: FAR at which it is found, per m²
    rank: Count  #: of its best alarm; 0 for none
    n_false: Count  #: false alarms at or above its confidence
    distance: Number | None  #: of that alarm, m


class ScoreSummary(TypedDict):
    """What ``flgpr score --json`` prints for a result or a list."""

    result: str  #: folder of the result or of the score
    targets: Count
    found: Count  #: targets found at the operating point
    false_alarms: Count  #: false alarms there
    operating_point: OperatingPoint
    all_alarms: AllAlarms
    area_m2: Area  #: area of the FAR, m²
    pd_mean: MeanPdInterval | None
    rules: RulesEntries
    notes: Entries  #: digests, sources and remarks
    outcomes: list[SummaryOutcome]


class ComparedPoint(Rates):
    """A detector at an allowed FAR."""

    detector: str
    far_allowed: Number  #: per m²
    n_targets: Count


class ComparedPair(TypedDict):
    """Two detectors at an allowed FAR."""

    #: first, second: their names
    first: str
    second: str
    far_allowed: Number  #: per m²
    difference: Difference  #: Pd of the first less that of the second
    #: low, high: interval of ``difference``
    low: Difference
    high: Difference
    #: only_first, only_second: targets that one alone finds
    only_first: Count
    only_second: Count
    p: Probability  #: two-sided p of McNemar's exact test


class ComparedMeans(TypedDict):
    """Two detectors' Pd averaged over the FAR."""

    #: first, second: their names
    first: str
    second: str
    #: pd_mean_a, pd_mean_b: mean Pd of the first and of the second
    pd_mean_a: Probability
    pd_mean_b: Probability
    #: low_a, high_a, low_b, high_b: intervals of the two
    low_a: Probability
    high_a: Probability
    low_b: Probability
    high_b: Probability
    #: chance_a, chance_b: mean Pd that chance gives
    chance_a: Probability | None
    chance_b: Probability | None
    difference: Difference  #: that of the first less that of the second
    #: low, high: interval of ``difference``
    low: Difference
    high: Difference
    p_value: Probability  #: two-sided p of the sign-flip test


class ComparisonRules(RulesEntries):
    """The rules of a comparison."""

    far_max: Number  #: end of the averaging of Pd, per m²


class BlindComparisonRules(BlindRules):
    """The rules of a comparison against a sealed truth."""

    level: Probability  #: level of the intervals
    far_max: Number  #: end of the averaging of Pd, per m²


class ComparisonFile(TypedDict):
    """``comparison.json`` of detectors side by side."""

    format: Literal["flgpr-comparison"]
    version: Literal[1]
    flgpr: str  #: version of the program
    rules: ComparisonRules | BlindComparisonRules
    notes: dict[str, Entries]  #: digests, sources and remarks by detector
    points: list[ComparedPoint]
    pairs: list[ComparedPair]
    means: list[ComparedMeans] | None  #: null where a sealed truth was scored

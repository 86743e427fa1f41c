"""What the events of live detection and its report hold: the members of their JSON objects.

The functions that make events return these types. ``evidence/make_schemas.py`` makes the published
JSON Schema of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, NotRequired

from pydantic import Field

# Pydantic reads the typed dictionaries of ``typing`` only from Python 3.12 on.
from typing_extensions import TypedDict

from flgpr.live.updates import SettledOutcome, State
from flgpr.model.plausible import StepEntries

Event = Mapping[str, Any]
"""An event of any kind."""
Count = Annotated[int, Field(ge=0)]
ScanNumber = Annotated[int, Field(ge=0)]
Probability = Annotated[float, Field(ge=0, le=1)]
ProbabilityInterval = Annotated[list[Probability], Field(min_length=2, max_length=2)]
Pose = Annotated[list[float], Field(min_length=6, max_length=6)]


class LaneBorders(TypedDict):
    """The lane that is searched."""

    #: x_min, x_max, y_min, y_max: its borders in the lane frame, m
    x_min: float
    x_max: float
    y_min: float
    y_max: float


class ViewGrid(TypedDict):
    """The lattice of the run-view."""

    #: x, y: centre of its first pixel in the lane frame, m
    x: float
    y: float
    nx: Annotated[int, Field(ge=1)]  #: number of columns
    #: dx, dy: spacings of the pixels, m
    dx: float
    dy: float


class VehicleEntries(TypedDict):
    """The vehicle and its brakes."""

    speed: float | None  #: m/s; null where none is stated
    reaction: float  #: time from the word to brakes that hold, s
    deceleration: float  #: m/s²
    front: float  #: how far the vehicle's front lies ahead of the array's reference point, m
    stopping_distance: float | None  #: m; null without a speed
    # Runs of versions before 2026-11-28 lack these.
    warning: NotRequired[float]  #: time from a word of caution to the word to brake, s
    clearance: NotRequired[float]  #: kept between vehicle and alarm on all sides, m
    width: NotRequired[float]  #: of the vehicle, m
    tyre: NotRequired[float]  #: width of a wheel, m
    axle: NotRequired[float]  #: how far the rear axle lies behind the reference point, m
    walk: NotRequired[float]  #: speed while no ground has been seen ahead, m/s


class StartEvent(TypedDict):
    """Detection starts: what the run, the recipe and the vehicle are."""

    event: Literal["start"]
    title: str  #: of the run
    recipe: str  #: name of the recipe
    lane: LaneBorders | None  #: null: as long as the vehicle drives
    grid: ViewGrid | None  #: lattice of the run-view
    channel: Annotated[
        list[str], Field(min_length=2, max_length=2)
    ]  #: polarization and sub-band of the run-view
    georeference: Any  #: what ties the lane to the Earth; null where nothing does
    threshold: float | None  #: confidence from which an alarm counts; null: all count
    vehicle: VehicleEntries
    notes: NotRequired[list[str]]  #: what alarms are, where earlier drives are subtracted


class ScanEvent(TypedDict):
    """What became of a scan."""

    event: Literal["scan"]
    scan: ScanNumber  #: number of the scan
    pose: Pose  #: x, y, z (m), heading, pitch, roll (rad) in the lane frame
    outcome: SettledOutcome
    arrived: float  #: when it arrived, s since 1970
    latency_ms: Annotated[float, Field(ge=0)]  #: from its arrival to this line


class ViewEvent(TypedDict):
    """Rows of the run-view that may have changed."""

    event: Literal["view"]
    row: Count  #: first of the rows, counted from the first of the run-view
    rows: Count  #: number of rows
    median_db: float  #: median of their pixels, dB over the background
    halves: str  #: dB over the background (row, column) as little-endian half floats in base64


class ForecastEntries(TypedDict):
    """What the model says of an alarm's probability; only some models have learnt that."""

    p: NotRequired[Probability]  #: probability that it is a target
    looks_left: NotRequired[Count]  #: looks to come
    next_p: NotRequired[ProbabilityInterval]  #: 80 % interval of ``p`` after the next look
    #: probability that the next look brings the confidence to the other side of the threshold
    change: NotRequired[Probability]
    last_p: NotRequired[ProbabilityInterval]  #: 80 % interval of ``p`` after the last look
    wait: NotRequired[bool]  #: whether one more look is worth waiting for


class AlarmEvent(ForecastEntries):
    """An alarm that a scan raised or changed; a known ``alarm_id`` replaces the alarm."""

    event: Literal["alarm"]
    alarm_id: str
    state: State  #: withdrawn: it is an alarm no more; final: no scan will see it again
    scan: ScanNumber  #: number of the newest scan
    #: x, y: its place in the lane frame, m
    x: float
    y: float
    confidence: float
    magnitude: float  #: value of the run-view there
    scans: Count  #: scans that entered the confidence
    left_m: float  #: distance along the heading from the vehicle's front, m
    raised_left_m: float  #: the same when the alarm was new, m
    latency_ms: Annotated[float, Field(ge=0)]  #: from the arrival of the scan to this line
    in_time: NotRequired[bool]  #: whether the vehicle can stop before it; with a speed
    margin_m: NotRequired[float]  #: by how much, m; with a speed
    unlike: NotRequired[Literal[True]]  #: the ground is unlike the training: see ``ground``
    #: latitude, longitude: WGS 84, degrees, where the lane is tied to the Earth
    latitude: NotRequired[Annotated[float, Field(ge=-90, le=90)]]
    longitude: NotRequired[Annotated[float, Field(ge=-180, le=180)]]


class GroundEvent(TypedDict):
    """The ground begins to be unlike that of the model's training, or is like it again."""

    event: Literal["ground"]
    scan: ScanNumber  #: number of the newest scan
    unlike: bool  #: whether confidences do not hold from this scan on
    words: list[str]  #: the verdict in plain words, then what passes its limit and by how much


class AnewEvent(TypedDict):
    """Detection started anew where positions had moved to."""

    event: Literal["anew"]
    scan: ScanNumber  #: number of the newest scan
    held: list[ScanNumber]  #: scans that were held back and are used now
    pose: Pose  #: of the newest scan, m and rad
    forgotten: bool  #: whether all before was given up


class ProblemEvent(TypedDict):
    """What was wrong with a frame, a sender or the run."""

    event: Literal["problem"]
    name: str  #: of the file, or the socket
    words: str  #: what was wrong
    more: NotRequired[Annotated[int, Field(ge=1)]]  #: so many problems like this came since


class PositionEvent(ProblemEvent, StepEntries):
    """A pose or a time that is not plausible."""

    kind: Literal["pose", "clock"]


class HealthEvent(ProblemEvent):
    """Something is wrong with the radar or its positions; told once while it lasts."""

    kind: Literal["health"]
    scan: ScanNumber  #: with which it was found
    finding: str  #: its name, see ``health.findings.LIMITS``
    value: float  #: in ``unit``
    limit: float
    unit: str
    advice: str  #: what to do
    stop: bool  #: whether nothing ahead is seen, or nobody knows where: the vehicle is to stop
    done: NotRequired[str]  #: what was done about it
    pairs: NotRequired[list[Count]]  #: numbers of the pairs, from 0
    tones: NotRequired[list[Count]]  #: numbers of the tones, from 0
    polarizations: NotRequired[list[str]]


class CountsEvent(TypedDict):
    """How many scans had which fault; the members are those of ``live.intake.COUNTS``."""

    event: Literal["counts"]


class ResumeEvent(TypedDict):
    """Detection was started again; what came after ``scan`` comes again."""

    event: Literal["resume"]
    scan: ScanNumber | None  #: the newest scan of the snapshot; null: there was none
    counts: dict[str, Count]  #: see the event ``counts``


class Latencies(TypedDict):
    """Times from the arrival of a scan to its alarms, ms."""

    #: median, p95, largest: of these times, ms
    median: NotRequired[float]
    p95: NotRequired[float]
    largest: NotRequired[float]
    scans: Count  #: number of scans


class EndEvent(TypedDict):
    """The run has ended; the other members are the counts."""

    event: Literal["end"]
    alarms: Count  #: alarms that stand at the end
    latency: Latencies


class ReportEntries(TypedDict):
    """``live.json``: the outcome of a live run."""

    counts: dict[str, Count]  #: see the event ``counts``
    latency_ms: Latencies
    alarms: Count  #: alarms that stand at the end
    #: frames processed per second by the last process; null with fewer than two frames
    rate: float | None
    recipe: str  #: name of the recipe


EVENTS = (
    StartEvent,
    ScanEvent,
    ViewEvent,
    AlarmEvent,
    GroundEvent,
    AnewEvent,
    ProblemEvent,
    PositionEvent,
    HealthEvent,
    CountsEvent,
    ResumeEvent,
    EndEvent,
)
"""All kinds of events."""

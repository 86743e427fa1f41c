"""What is wrong with a run: every finding with its number, its limit and what to do.

The limits stand in one table. They are fixed on clean simulated drives of all packaged arrays,
errors of the sensors included (``evidence/health_limits.py``, whose highest clean values stand in
``docs/evidence/robustness.md``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple


class Limit(NamedTuple):
    """What a statistic may be, and what is said where it is more."""

    most: float  #: beyond which it is told
    unit: str
    words: str  #: what is found; ``{where}``, ``{value}`` and ``{most}`` are put in
    advice: str


QUESTIONS = {
    "paths": "sign of phase, order of tones",
    "receivers": "order of pairs",
    "heading": "heading and axes",
    "lag": "lag of poses",
    "height": "height",
    "units": "units",
}
"""How a run may be taken otherwise than it was recorded, by the names of the findings, in the order
in which it is told."""
BETTER_DB = 0.5
"""Gain from which on another way counts as better, dB."""
LIMITS: dict[str, Limit] = {
    "missing pairs": Limit(
        0.2,
        "share of the scans",
        "{where}: values that are not finite in {value:.0%} of the scans, at most {most:.0%}",
        "look at the channel's cable and switch",
    ),
    "missing tones": Limit(
        0.2,
        "share of the scans",
        "{where}: not finite in {value:.0%} of the scans, at most {most:.0%}",
        "look at what the receiver writes there",
    ),
    "dead pairs": Limit(
        25.0,
        "dB",
        "{where}: {value:.0f} dB under the median pair, at most {most:.0f} dB",
        "look at the channel's cable and switch",
    ),
    "hot pairs": Limit(
        20.0,
        "dB",
        "{where}: {value:.0f} dB over the median pair, at most {most:.0f} dB",
        "look at the channel's gain",
    ),
    "dead polarization": Limit(
        40.0,
        "dB",
        "{where}: {value:.0f} dB under the loudest polarization, at most {most:.0f} dB",
        "look at the antennas and switches of this polarization",
    ),
    "stuck pairs": Limit(
        0.5,
        "share of the tones",
        "{where}: {value:.0%} of the tones never change, at most {most:.0%}",
        "look at what the receiver writes there",
    ),
    "turned pairs": Limit(
        0.0,
        "correlation",
        "{where}: the sign is opposite to that of the neighbours",
        "turn the sign back in the recording, or leave these pairs out",
    ),
    "swapped pairs": Limit(
        0.4,
        "of the likeness of neighbours",
        "{where} are more like their neighbours in each other's place, by {value:.0%} of what "
        "neighbours are, at most {most:.0%}",
        "exchange them in the recording",
    ),
    "disturbed tones": Limit(
        15.0,
        "dB",
        "{where}: change from scan to scan by up to {value:.0f} dB more than the tones around, "
        "at most {most:.0f} dB",
        "something else transmits there",
    ),
    "noisy tones": Limit(
        0.05,
        "share of the tones",
        "{where}: {value:.0%} of the tones hold noise, at most {most:.0%}",
        "look at the receiver there, or leave these tones out",
    ),
    "noise": Limit(
        0.7,
        "1",
        "the data are noise: neighbouring tones differ by {value:.2f} of their power, "
        "at most {most:.2f}",
        "look at the transmitter",
    ),
    "jitter": Limit(
        60.0,
        "ps",
        "time zero jumps from scan to scan by {value:.0f} ps (standard deviation), "
        "at most {most:.0f} ps",
        "look at the clock of the radar",
    ),
    "time zero": Limit(
        300.0,
        "ps",
        "time zero drifts by {value:.0f} ps, at most {most:.0f} ps",
        "let the radar warm up; look at its clock and cables",
    ),
    "repeated scans": Limit(
        0.0,
        "scans",
        "{value:.0f} scans hold the very numbers of the scan before",
        "the recorder stands still: record anew",
    ),
    "frozen positions": Limit(
        0.1,
        "share of the scans",
        "positions stand still in {value:.0%} of the scans while the ground goes by, "
        "at most {most:.0%}",
        "look at the positioning: places of alarms are wrong",
    ),
    "no positions": Limit(
        1.0,
        "scans",
        "{value:.0f} scans in a row came without a position",
        "stop: nobody knows where the vehicle is",
    ),
    "restart": Limit(
        0.0,
        "scans",
        "scan numbers begin again at {where}: the radar was started again",
        "its scans are a new series",
    ),
    "course": Limit(
        1.0,
        "m",
        "the course lies {value:.1f} m beside the middle of the lane, at most {most:.1f} m",
        "compare the datum of the positions with that of the lane",
    ),
    **dict.fromkeys(
        QUESTIONS,
        Limit(BETTER_DB, "dB", "{where} ({value:+.1f} dB so taken, at most {most:+g})", ""),
    ),
}
"""What may be found, by name."""

STOPPING = ("no positions", "frozen positions", "repeated scans", "noise")
"""What makes a driver's screen say stop: nothing ahead is seen, or nobody knows where."""
SPOILING = ("noise", "repeated scans", "frozen positions")
"""With what no look says anything."""
DEVIATIONS = 4.0
"""Standard errors that such a gain must have, too."""
TURNED_LIKENESS = 0.25
"""Median correlation of neighbouring pairs that is needed to tell a turned sign."""
PLACED_LIKENESS = 0.45
"""Median correlation of neighbouring pairs that is needed to tell that two have changed places."""
NOISY_LIKENESS = 0.5
"""Share of the median likeness of neighbouring tones under which a tone holds noise."""
CLEAR = 0.5
"""Correlation of a scan with the mean of those before, once delayed, that is needed to tell
how time zero moves."""
CLEAR_OF_FEW = 0.8
"""The same of a run of a few channels."""
MOVING_DB = 6.0
"""Change from scan to scan under that of a driving vehicle, dB, from where on it may stand."""
MOST_PAIRS = 0.5
"""Share of the pairs that may be left out: of fewer nothing is made."""
MOST_TONES = 0.1
"""Share of the tones that may be left out."""
LEAST_SCANS = 6
"""Scans from which on a run is judged."""
LEAST_TONES = 32
"""Tones from which on tones are judged by those around."""


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with a run."""

    name: str  #: as in ``LIMITS``
    value: float  #: in ``unit``
    limit: float
    unit: str
    words: str  #: a sentence with the number and the limit
    advice: str  #: what to do
    pairs: tuple[int, ...] = ()  #: numbers of the pairs, from 0
    polarizations: tuple[str, ...] = ()
    tones: tuple[int, ...] = ()  #: numbers of the tones, from 0
    done: str = ""  #: what was done about it; "" for nothing
    run: str = ""  #: name of the run taken together with the one searched; "" for that one

    @property
    def sentence(self) -> str:
        """All of it in one line."""
        of_run = f"run {self.run}: " if self.run else ""
        return f"{of_run}{self.words}; {self.done or self.advice}"

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON values, without what does not apply."""
        entries = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
            if value not in ("", ())
        }
        return entries | {"sentence": self.sentence}

    def acted(self, done: str) -> Finding:
        """Return it with what was done."""
        return replace(self, done=done)

    def of_run(self, run: str) -> Finding:
        """Return it as one of a run with a name."""
        return replace(self, run=run)


def finding(
    name: str,
    value: float,
    where: str = "",
    pairs: Sequence[int] = (),
    polarizations: Sequence[str] = (),
    tones: Sequence[int] = (),
    advice: str = "",
) -> Finding:
    """Return a finding of ``LIMITS``.

    Parameters
    ----------
    name : str
        Its name.
    value : float
        The number, in the limit's unit.
    where : str
        What it concerns, for the sentence.
    pairs, tones : sequence of int
        Their numbers, from 0.
    polarizations : sequence of str
        Their names.
    advice : str
        What to do, where it is not that of the limit.
    """
    limit = LIMITS[name]
    words = limit.words.format(where=where, value=value, most=limit.most)
    return Finding(
        name,
        float(value),
        limit.most,
        limit.unit,
        words,
        advice or limit.advice,
        tuple(pairs),
        tuple(polarizations),
        tuple(tones),
    )


def listed(values: Sequence[Any], most: int = 8) -> str:
    """Return values separated by commas, the first few, and how many more there are."""
    more = f" and {len(values) - most} more" if len(values) > most else ""
    return ", ".join(map(str, values[:most])) + more

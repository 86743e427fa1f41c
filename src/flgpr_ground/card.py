"""The card of a submission: who enters what, made how, learnt from what, at which cost."""

from __future__ import annotations

import datetime
import itertools
import math
import unicodedata
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationError, field_validator

from flgpr.door import Folder
from flgpr.model.bounds import Largest, NotNegative
from flgpr.model.faults import describe_fault
from flgpr.model.printable import printable
from flgpr.stages import Table
from flgpr.store import sha256
from flgpr.toml_text import parse_toml

CARD = "submission.toml"
"""Name of the card in the folder of a submission."""
RECORD = "submission.json"
"""What was entered: digests of the card and of every split's alarms, and how alike lanes are."""
MOST_CARD_BYTES = 64 * 2**10
"""Largest card."""
MOST_PARAMETERS = 100
"""Most declared parameters."""
MOST_SECONDS = 1e9
"""Largest declared time, s: about 32 years of processors."""
MOST_MIB = 1e9
"""Largest declared memory, MiB: about a pebibyte."""
LARGEST_PARAMETER = 1e20
"""Largest magnitude of a declared parameter: a seed of 64 bits fits."""
_MOST_DESCRIBED = 1000  # faults that are looked at: each takes a look at all names of entries
_MOST_FAULTS = 50
_SHOWN_DIGITS = 12  # of a digest in a message
_LONGEST_FAULT = 300  # characters
_LONGEST_PARAMETER = 300  # characters
_NOT_PLAIN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories of characters that are not seen, or that change what is seen around them."""


def _plain_line(text: str) -> str:
    """Return a line of text; characters that are not seen are a ValueError."""
    for letter in text:
        if unicodedata.category(letter) in _NOT_PLAIN:
            raise ValueError(f"must be one line of plain text, got the character {letter!r}")
    if not text.strip():
        raise ValueError("must say something, got blanks")
    return text


CardLine = Annotated[str, Field(min_length=1, max_length=400), AfterValidator(_plain_line)]
"""A line of text."""
Word = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_plain_line)]
"""A short line of text."""


class Cost(Table):
    """What the submission took, as its authors declare it."""

    hardware: CardLine  #: processor, graphics card and memory
    #: seconds of processor (or of device, as ``hardware`` says) per kilometre of lane in detection
    seconds_per_km: Annotated[NotNegative, Largest(MOST_SECONDS)]
    #: seconds of all trainings
    training_seconds: Annotated[NotNegative | None, Largest(MOST_SECONDS)] = None
    peak_mib: Annotated[NotNegative | None, Largest(MOST_MIB)] = None  #: largest process, MiB

    def declared(self) -> dict[str, float]:
        """Return the columns of the table of costs; NaN for what is not declared."""
        seconds, peak_mib = self.training_seconds, self.peak_mib
        return {
            "seconds_per_km": self.seconds_per_km,
            "training_seconds": math.nan if seconds is None else seconds,
            "peak_bytes": math.nan if peak_mib is None else peak_mib * 2**20,
        }


class Card(Table):
    """The card of a submission, as its file ``submission.toml`` has it."""

    format: Literal["flgpr-submission-1"]
    ground: Word  #: title of the proving ground, such as proving-ground-2
    #: name in the tables: lower case letters, digits, hyphens, points, unique on the ground
    name: Annotated[str, Field(pattern=r"^[a-z0-9](?:[a-z0-9.-]{0,38}[a-z0-9])?$")]
    version: Word  #: version of the program and the model
    method: CardLine  #: the method in a sentence
    authors: Annotated[tuple[Word, ...], Field(min_length=1, max_length=50)]
    date: datetime.date  #: when the alarms were made
    licence: Word  #: of the alarm lists and the card, an identifier of SPDX such as CC-BY-4.0
    trained_on: CardLine  #: what was learnt from: lanes, and everything else
    #: whether anything but a frozen detector ever saw the signals of test lanes
    test_lanes_seen: bool
    #: whether anybody who worked on the submission knew targets of test lanes
    test_truth_seen: bool
    cost: Cost
    digest: Word = ""  #: digest or commit of the program or the model
    contact: Word = ""
    reference: CardLine = ""  #: paper or address that describes the method
    #: settings, each a number, a text or a boolean
    parameters: Annotated[dict[str, bool | int | float | str], Largest(LARGEST_PARAMETER)] = Field(
        default_factory=dict
    )

    @field_validator("parameters", mode="after")
    @classmethod
    def _check_parameters(
        cls, parameters: dict[str, bool | int | float | str]
    ) -> dict[str, bool | int | float | str]:
        """Refuse too many parameters, and text that is no plain line."""
        if len(parameters) > MOST_PARAMETERS:
            raise ValueError(f"must be at most {MOST_PARAMETERS}, got {len(parameters)}")
        for text in itertools.chain(*parameters.items()):
            if isinstance(text, str) and len(_plain_line(text)) > _LONGEST_PARAMETER:
                raise ValueError(
                    f"must have at most {_LONGEST_PARAMETER} characters each, got {len(text)}"
                )
        return parameters

    @property
    def why_not_ranked(self) -> str:
        """Why it has no rank; empty if it declares that test lanes and their truth were not seen."""
        if self.test_truth_seen:
            return "its card says that test truth was seen"
        return "its card says that test lanes were seen" if self.test_lanes_seen else ""


def parse_card(data: bytes) -> tuple[Card | None, list[str]]:
    """Read a card.

    Parameters
    ----------
    data : bytes
        Content of the file.

    Returns
    -------
    card : Card or None
        The card; None if it has faults.
    faults : list of str
        A line for every entry that breaks a rule, without the name of the file.
    """
    try:
        entries = parse_toml(data)
    except ValueError as error:
        return None, [f"must be valid TOML: {printable(str(error))[:_LONGEST_FAULT]}"]
    try:
        return Card.model_validate(entries), []
    except ValidationError as error:
        faults = error.errors()
    lines = []
    for fault in faults[:_MOST_DESCRIBED]:
        line = printable(describe_fault(fault, Card, ""))
        lines.append(f"{line[:_LONGEST_FAULT]} ..." if len(line) > _LONGEST_FAULT else line)
    lines = list(dict.fromkeys(lines))
    if len(lines) > _MOST_FAULTS:
        more = len(lines) - _MOST_FAULTS + max(len(faults) - _MOST_DESCRIBED, 0)
        lines = [*lines[:_MOST_FAULTS], f"and {more} more entries that break a rule"]
    return None, lines


def entered_card(files: Folder, name: str) -> bytes | None:
    """Return the card of an entry as it was when it was scored.

    Parameters
    ----------
    files : Folder
        The folder of a ground.
    name : str
        Name of the entry.

    Returns
    -------
    bytes or None
        The file; None for an entry without a card, which is no submission.

    Raises
    ------
    ValueError
        If the card is another one than that whose digest was recorded.
    """
    card_name = f"entries/{name}/{CARD}"
    if not files.has(card_name):
        return None
    card_text = files.read(card_name, MOST_CARD_BYTES)
    record_name = f"entries/{name}/{RECORD}"
    record = files.json(record_name) if files.has(record_name) else None
    recorded = record.get("card") if isinstance(record, dict) else None
    digest = sha256(card_text)
    if recorded != digest:
        shown = "none" if recorded is None else printable(str(recorded))[:_SHOWN_DIGITS]
        raise ValueError(
            f"{files.root / card_name}: it must be the card that was scored, of SHA-256 {shown} by "
            f"{RECORD}, got one of {digest[:_SHOWN_DIGITS]}: put the scored card back"
        )
    return card_text

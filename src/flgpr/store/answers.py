"""What drivers answer to alarms: ``answers.jsonl`` beside the events of a live run, a line each.

The viewer appends to it, for whoever may write there; detection alone writes the events.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from flgpr.append_log import AppendLog, read_log
from flgpr.door import refuse_links
from flgpr.json_text import compact_json
from flgpr.model.bounds import Entries
from flgpr.model.faults import first_fault_of

ANSWER_FILE = "answers.jsonl"
MOST_ANSWER_BYTES = 1000
"""Most bytes of an answer that a page sends."""
MOST_ANSWERS = 10_000
"""Most answers of a run."""
_PATIENCE = 1.0  # s for another page that is adding a line


class Answer(Entries):
    """What a driver found at an alarm."""

    alarm_id: Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[\w.-]+$")]
    answer: Literal["saw it", "nothing there"]
    #: x, y: place of the alarm in the lane frame then, m
    x: float
    y: float
    left_m: float  #: from the vehicle's front to it, m; negative once it is passed
    scan: Annotated[int, Field(ge=0)]  #: the newest scan


def add_answer(folder: Path, body: bytes) -> dict[str, Any]:
    """Append an answer to the log of a live run.

    Parameters
    ----------
    folder : Path
        Folder of the live run.
    body : bytes
        The answer, JSON.

    Returns
    -------
    dict
        The answer with ``time``, when it came, s since 1970.

    Raises
    ------
    ValueError
        If the answer breaks a rule, there is no such run, or it has :data:`MOST_ANSWERS`. Nothing is
        written then.
    """
    with first_fault_of(Answer, "answer"):
        answer = Answer.model_validate_json(body, strict=True)
    if not folder.is_dir():
        raise ValueError(f"answers go to a live run, got no folder {folder}")
    refuse_links(folder / ANSWER_FILE)
    entries = {"time": round(time.time(), 3), **answer.model_dump()}
    with AppendLog(folder / ANSWER_FILE, _PATIENCE) as log:
        if len(log.lines) >= MOST_ANSWERS:
            raise ValueError(f"answers of a run must be at most {MOST_ANSWERS}")
        log.append(compact_json(entries).encode())
    return entries


def drop_answers(folder: Path) -> int:
    """Remove the answers to a run that begins anew, and return how many there were."""
    path = folder / ANSWER_FILE
    count = len(read_log(path)[0])
    path.unlink(missing_ok=True)
    return count

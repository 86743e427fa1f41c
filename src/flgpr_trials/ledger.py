"""Registers that only grow: hashes of recipes, plans and alarm lists, in a chain.

Each line holds the hash of the line before, so that no line can be altered or removed unnoticed.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.append_log import AppendLog, read_log
from flgpr.door import MOST_CHECKED, read_named
from flgpr.json_text import parse_json
from flgpr.model.printable import text_bytes
from flgpr.types import Entries

OPENED = "truth opened"
"""Event of a register: a truth was looked at. What is registered after it is too late."""
TRIAL = "trial"
"""Event of the first line of a trial's register: what a detector has to show."""
WITNESS = "witness"
"""Event of a witness: the number of lines of a register, and the hash of the last."""
_LINE_BEGIN = b'{"'  # of every line: a JSON object with an entry
_PATIENCE = 30.0  # s to wait for another process that is adding a line


def content_hash(content: bytes | str | Path | Mapping[str, Any]) -> str:
    """Return the SHA-256 of a content.

    Parameters
    ----------
    content : bytes, str, Path or mapping
        Bytes or text, hashed as they are; a file; or a mapping, hashed as JSON with sorted keys.

    Returns
    -------
    str
        64 hexadecimal digits.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    if isinstance(content, Path):
        data = read_named(content, MOST_CHECKED)
    elif isinstance(content, bytes):
        data = content
    elif isinstance(content, str):
        data = text_bytes(content)
    else:
        data = json.dumps(content, sort_keys=True).encode()
    return hashlib.sha256(data).hexdigest()


def alarm_hash(alarms: pd.DataFrame) -> str:
    """Return the hash of what scoring sees of an alarm list.

    Parameters
    ----------
    alarms : DataFrame
        Alarm table; the order of its rows and further columns do not matter.

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    names = [name for name in ("lane", "x", "y", "confidence") if name in alarms.columns]
    lines = []
    for row in alarms[names].astype(object).itertuples(index=False):
        lines.append(",".join(map(repr, row)))
    lines.sort()
    return content_hash("\n".join([",".join(names), *lines]))


@dataclass(frozen=True)
class WitnessedRegister:
    """A register, and the witness that must know its lines and is told of new ones."""

    path: Path  #: file of the register
    witness: Path  #: file of the witness, see :func:`flgpr.trials.check_witness`

    def __fspath__(self) -> str:
        """Return the file of the register."""
        return str(self.path)


RegisterLike = str | Path | WitnessedRegister
"""A register, by its path or with its witness."""


def register(path: RegisterLike, /, **entry: Any) -> Entries:
    """Append a line to a register, with the time and the hash of the line before.

    Parameters
    ----------
    path : str, Path or WitnessedRegister
        The register, a file of one JSON object per line, made if missing.
    **entry
        JSON values, e.g. ``recipe=content_hash(Path("recipe.toml"))``.

    Returns
    -------
    dict
        The line.

    Raises
    ------
    ValueError
        If the register was altered, lacks a line that its witness saw, or is held by another
        process for 30 s.
    """
    return enter(path, lambda _: entry)[-1]


def enter(
    path: RegisterLike, make_entry: Callable[[list[Entries]], Mapping[str, Any]]
) -> list[Entries]:
    """Append a line that depends on those before it, while no other process can.

    Parameters
    ----------
    path : str, Path or WitnessedRegister
        The register, made if missing. A witness (:func:`check_witness`) is asked before, and told
        of the new line afterwards.
    make_entry : callable
        Returns the entry, from the lines so far; an error of it leaves the register as it is.

    Returns
    -------
    list of dict
        All lines, the new one last.

    Raises
    ------
    ValueError
        If the register was altered, lacks a line that the witness saw, or is held by another
        process for 30 s.
    """
    file = Path(path)
    witness = path.witness if isinstance(path, WitnessedRegister) else None
    with AppendLog(file, _PATIENCE) as log:
        lines = _parsed(file, log.lines)
        _finish_torn(file, log, lines)
        if witness is not None:
            check_witness(lines, witness, file)
        line = dict(make_entry(lines))
        line["time"] = datetime.now(UTC).isoformat(timespec="milliseconds")
        line["number"] = len(lines) + 1
        line["previous"] = lines[-1]["hash"] if lines else ""
        line["hash"] = content_hash(line)
        log.append(json.dumps(line, sort_keys=True).encode())
        lines.append(line)
    if witness is not None:
        register(witness, event=WITNESS, of=lines[0]["hash"], **head_of(lines))
    return lines


def read_register(path: str | Path) -> list[Entries]:
    """Read and check the lines of a register.

    Half a line at the end, as a full disk or a kill leaves it, is no line: its entry was never
    confirmed to anybody.

    Parameters
    ----------
    path : str or Path
        The register.

    Returns
    -------
    list of dict
        The lines; none if there is no file.

    Raises
    ------
    ValueError
        If a line was altered, removed or added; the error names the first. If it is another file.
    """
    file = Path(path)
    texts, unfinished = read_log(file, _PATIENCE)
    lines = _parsed(file, texts)
    if unfinished:
        last = _fitting(unfinished, lines)
        if last is not None:  # complete but for the end of its line
            lines.append(last)
        else:
            _require_begin(file, unfinished, lines)
    return lines


def head_of(lines: Sequence[Mapping[str, Any]]) -> Entries:
    """Return the head of a register, by which a later reader knows whether a line was lost.

    Parameters
    ----------
    lines : sequence of dict
        Lines of the register.

    Returns
    -------
    dict
        ``lines``, their number, and ``head``, the hash of the last.
    """
    return {"lines": len(lines), "head": lines[-1]["hash"] if lines else ""}


def check_witness(lines: Sequence[Mapping[str, Any]], witness: str | Path, path: str | Path) -> int:
    """Check that a register holds every line that a witness saw of it.

    A witness is a register of its own, kept by somebody else or elsewhere. It records how many
    lines a register had, and the hash of the last. A chain of hashes alone cannot show that its end
    was cut off, or that an older copy was put back.

    Parameters
    ----------
    lines : sequence of dict
        Lines of the register.
    witness : str or Path
        The witness.
    path : str or Path
        The register, for messages.

    Returns
    -------
    int
        Number of records that the witness has of this register.

    Raises
    ------
    ValueError
        If the witness does not know the register, a line is missing, or one differs.
    """
    known = [line for line in read_register(witness) if line.get("event") == WITNESS]
    records = [record for record in known if not lines or record["of"] == lines[0]["hash"]]
    if known and not records:
        raise ValueError(
            f"register {path} must be one that {witness} knows, got one that begins otherwise"
        )
    for record in records:
        _require_head(lines, record, path, f"{witness} saw", f" on {record['time']}")
    return len(records)


def check_head(
    lines: Sequence[Mapping[str, Any]], recorded: Mapping[str, Any], path: str | Path, source: str
) -> None:
    """Check that a register holds the lines that a report counted.

    Parameters
    ----------
    lines : sequence of dict
        Lines of the register.
    recorded : mapping
        What the report says of it, see :func:`head_of`.
    path, source : str or Path
        The register and the report, for messages.

    Raises
    ------
    ValueError
        If a line is missing or differs.
    """
    _require_head(lines, recorded, path, f"{source} tells")


def _require_head(
    lines: Sequence[Mapping[str, Any]],
    recorded: Mapping[str, Any],
    path: str | Path,
    who_tells: str,
    when: str = "",
) -> None:
    """Refuse a register that lacks the last line that somebody counted, or has another one."""
    count = recorded["lines"]
    if count > len(lines):
        raise ValueError(
            f"register {path} lacks line {len(lines) + 1}: it has {len(lines)}, "
            f"and {who_tells} {count}{when}"
        )
    if count and lines[count - 1]["hash"] != recorded["head"]:
        raise ValueError(f"register {path} has another line {count} than {who_tells}{when}")


def _parsed(file: Path, texts: Sequence[bytes]) -> list[Entries]:
    """Return the lines of a register, each of which must follow the one before."""
    lines: list[Entries] = []
    for number, text in enumerate(texts, start=1):
        line = _fitting(text, lines)
        if line is None:
            raise ValueError(
                f"register {file} must be unaltered, got a line {number} that does not fit"
            )
        lines.append(line)
    return lines


def _fitting(text: bytes, lines: Sequence[Mapping[str, Any]]) -> Entries | None:
    """Return a line if its hash is right and it follows the lines before; else None."""
    previous = lines[-1]["hash"] if lines else ""
    try:
        line = parse_json(text)
        content = {key: value for key, value in line.items() if key != "hash"}
        fits = line["hash"] == content_hash(content) and line["previous"] == previous
    except (ValueError, AttributeError, KeyError, TypeError):
        return None
    return dict(line) if fits else None


def _finish_torn(file: Path, log: AppendLog, lines: list[Entries]) -> None:
    """Add a last line that lacks nothing but its end, or warn that half a line is dropped.

    Text that is no beginning of a first line is that of another file, which is a ValueError.
    """
    if not log.torn:
        return
    last = _fitting(log.torn, lines)
    if last is not None:
        log.append(log.torn)
        lines.append(last)
        return
    _require_begin(file, log.torn, lines)
    warnings.warn(
        f"register {file}: {len(log.torn)} bytes of an unfinished line {len(lines) + 1} were "
        "dropped; nobody was told that it was entered",
        stacklevel=3,
    )


def _require_begin(file: Path, torn: bytes, lines: Sequence[Entries]) -> None:
    """Refuse a file that holds nothing but what is no beginning of a line of a register."""
    if not lines and not _LINE_BEGIN.startswith(torn[: len(_LINE_BEGIN)]):
        raise ValueError(f"register {file} must be a register, got another file")


def before_opening(lines: Sequence[Entries]) -> Sequence[Entries]:
    """Return the lines of a register that were entered before the first look at a truth."""
    for number, line in enumerate(lines):
        if line.get("event") == OPENED:
            return lines[:number]
    return lines


def require_unopened(lines: Sequence[Entries], too_late: str) -> None:
    """Raise a ValueError with a message if a truth was opened under a register of these lines."""
    if len(before_opening(lines)) < len(lines):
        raise ValueError(too_late)


def enter_unopened(path: RegisterLike, entry: Mapping[str, Any], too_late: str) -> Entries:
    """Append a line to a register unless a truth was opened under it, which is a ValueError."""

    def make_entry(lines: list[Entries]) -> Mapping[str, Any]:
        require_unopened(lines, too_late)
        return entry

    return enter(path, make_entry)[-1]


def enter_opening(path: RegisterLike, opening: Mapping[str, Any]) -> Entries:
    """Enter a look at a truth into a register; return the head of the register."""
    return head_of(enter(path, lambda _: {"event": OPENED, **opening}))


def read_checked_register(register: RegisterLike) -> list[Entries]:
    """Read a register, which must hold every line that its witness saw of it.

    Parameters
    ----------
    register : path or WitnessedRegister
        The register.

    Returns
    -------
    list of dict
        Its lines.

    Raises
    ------
    ValueError
        If a line was changed or taken out.
    """
    lines = read_register(Path(register))
    if isinstance(register, WitnessedRegister):
        check_witness(lines, register.witness, register.path)
    return lines


def require_registered(path: str | Path, recipe: str, model: str | None = None) -> Entries:
    """Check that a recipe was registered before any look at a truth.

    Parameters
    ----------
    path : str or Path
        The register.
    recipe : str
        :func:`content_hash` of the recipe.
    model : str, optional
        Hash of the model that it was run with, which must then stand in the same line.

    Returns
    -------
    dict
        The line of the recipe.

    Raises
    ------
    ValueError
        If no line before the first look holds them, or the register was altered.
    """
    lines = read_register(path)
    early = before_opening(lines)
    entries = []
    for line in lines:
        if line.get("recipe") == recipe and line.get("event") != OPENED:
            entries.append(line)
    for line in entries:
        if line in early and model in (None, line.get("model")):
            return line
    got = f"{recipe[:12]}..."
    if any(line in early for line in entries):
        raise ValueError(
            f"the detector must be registered with its model in {path}, "
            f"got the recipe {got} with the model {model}"
        )
    late = ""
    if entries:
        late = f" in line {entries[0]['number']}, after the look in line {len(early) + 1}"
    raise ValueError(
        f"what fixes the detector must be registered in {path} before the truth is opened, "
        f"got {got}{late}"
    )


def require_truth(
    path: str | Path,
    truth: str,
    lanes: Mapping[str, Mapping[str, float]],
    rules: Mapping[str, float],
    planned: bool = False,
) -> None:
    """Check that a truth is the one that a register holds, with its lanes and rules.

    A plan counts until it is surveyed, and then the last survey of it. What was entered after the
    first look at a truth never counts.

    Parameters
    ----------
    path : str or Path
        The register. One without a plan demands nothing, unless ``planned`` is true and it is not
        that of a trial, whose mines may lie there since long.
    truth : str
        :func:`content_hash` of the truth.
    lanes : mapping of str to mapping
        Borders of the lanes, m, which must be those of the plan.
    rules : mapping of str to float
        Scoring rules, of which those that the plan names must be as planned.
    planned : bool
        Whether the truth is known to be planned.

    Raises
    ------
    ValueError
        If the truth, a lane or a rule is another.
    """
    lines = read_register(path)
    entries = [line for line in before_opening(lines) if line.get("event") in ("plan", "survey")]
    is_of_trial = bool(lines) and lines[0].get("event") == TRIAL
    if not entries and (is_of_trial or not planned):
        return
    plan_of_truth = {line.get("truth", line["plan"]): line["plan"] for line in entries}
    plan = plan_of_truth.get(truth)
    if plan is None:
        raise ValueError(
            f"truth must be the plan or the survey of it that stands in {path}, "
            "got another or an altered one; `flgpr plan survey` enters what was emplaced"
        )
    last = [line for line in entries if line["plan"] == plan][-1]
    if last.get("truth", plan) != truth:
        raise ValueError(
            f"truth must be the survey in line {last['number']} of {path}, got what it replaced"
        )
    borders = list(last["lanes"].values())
    for lane in lanes.values():
        if dict(lane) not in borders:
            raise ValueError(f"lane must be as planned in {path}, {borders}, got {dict(lane)}")
    for name, value in rules.items():
        if last.get("rules", {}).get(name, value) != value:
            raise ValueError(
                f"{name} must be {last['rules'][name]:g} as planned in {path}, got {value:g}"
            )

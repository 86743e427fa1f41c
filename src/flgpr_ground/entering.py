"""Entering submissions: checked, scored on the sealed truth once, and listed beside all others.

What ``flgpr benchmark run`` made of a class of one's own is written as a submission, too.
"""

from __future__ import annotations

import datetime
import json
import math
import os
import platform
import shutil
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.door import Folder, refuse_links
from flgpr.store import sha256, write_table, write_whole
from flgpr.store.outputs import atomic_output, discard_partials, locked_folder
from flgpr.store.tables import read_table_in
from flgpr.toml_text import toml_value
from flgpr_ground.card import CARD, RECORD, entered_card, parse_card
from flgpr_ground.entries import Entry
from flgpr_ground.ground import Ground, in_tier
from flgpr_ground.leaderboard import refuse_other_page, write_leaderboard
from flgpr_ground.running import (
    ABOUT,
    ALARMS,
    PRINTS,
    begin_folder,
    entry_folder,
    measured_cost,
    read_ground,
    seal_tested,
    write_about,
)
from flgpr_ground.submission import Submission, check_submission
from flgpr_ground.table import write_score_tables
from flgpr_trials.ledger import alarm_hash

SUBMISSIONS = "submissions"
"""Folder of the submissions that a run wrote, in the folder of the ground."""
SHOWN = "shown.json"
"""Beside the sealed truth: says that somebody saw test lanes about their targets."""
LEADERBOARD = "leaderboard.html"
"""The page, in the folder of the ground."""
ENTRIES = "entries"
"""Folder of the entries, in the folder of the ground."""
_SHOWN_FAULTS = 3


def enter_submissions(
    submissions: Sequence[str | Path],
    output: str | Path,
    ground: str | Path | None = None,
) -> str:
    """Check submissions, score them on the sealed truth, and write the tables and the leaderboard.

    The lanes need not be there: truth is drawn from the description and sealed. Every list is
    scored once, which is logged; the same list again is not scored again. Another one under the
    same name is refused, and so is another card, as what it declares decides on a rank. While one
    process enters submissions in a folder, no other can.

    Parameters
    ----------
    submissions : sequence of str or path
        Folders of submissions (:mod:`flgpr_ground.submission`).
    output : str or path
        Folder of the ground, that of ``flgpr benchmark run`` or a new one.
    ground : str or path, optional
        TOML file of a ground of one's own.

    Returns
    -------
    str
        The table of the scores as text.

    Raises
    ------
    ValueError
        If a submission breaks a rule, is of another ground, or was entered with other alarms or
        another card, or if another process enters submissions there; then none is scored.
    FileExistsError
        If the folder has a ``leaderboard.html`` that is no leaderboard; then none is scored.
    NotADirectoryError
        If a submission is no folder.
    """
    checked = [check_submission(folder, ground) for folder in submissions]
    if not checked:
        raise ValueError("submissions must be one or more folders, got none")
    for submission in checked:
        _refuse_faults(submission)
    entered_ground = _common_ground(checked)
    names = [submission.name for submission in checked]
    if len(set(names)) < len(names):
        raise ValueError(f"submissions must have names of their own, got {', '.join(names)}")

    # All of them are checked before any looks at the truth.
    folder = Path(output)
    page = folder / LEADERBOARD
    refuse_other_page(page)
    folder.mkdir(parents=True, exist_ok=True)
    with locked_folder(folder):
        for submission in checked:
            _refuse_second(submission, entered_ground, folder)
        _refuse_changed_cards(folder)
        begin_folder(entered_ground, folder)
        seal_tested(entered_ground, folder / "lanes")
        discard_partials(folder / ENTRIES)
        for submission in checked:
            _write_entry(submission, entered_ground, folder)
        text = write_score_tables([folder], folder)
        write_leaderboard([folder], page)
    return text


def _common_ground(submissions: Sequence[Submission]) -> Ground:
    """Return the ground that all submissions enter; several are a ValueError."""
    grounds = [submission.ground for submission in submissions]
    first = grounds[0]
    if first is None or any(other != first for other in grounds):
        titles = ", ".join(other.title for other in grounds if other is not None)
        raise ValueError(f"submissions must all enter one ground, got {titles}")
    return first


def _refuse_faults(submission: Submission) -> None:
    """Refuse a submission that breaks a rule, with the first few."""
    faults = submission.faults
    if not faults:
        return
    shown = "; ".join(faults[:_SHOWN_FAULTS])
    if len(faults) > _SHOWN_FAULTS:
        shown += "; `flgpr benchmark validate` lists all"
    raise ValueError(
        f"submission {submission.folder} must break no rule, got {len(faults)}: {shown}"
    )


def _refuse_second(submission: Submission, ground: Ground, folder: Path) -> None:
    """Refuse a name that was entered with other alarms or another card, or that a recipe has."""
    own_folder = folder / ENTRIES / submission.name
    refuse_links(own_folder)
    if not own_folder.exists():
        return
    if read_ground(folder) == ground and not Folder(own_folder).has(RECORD):
        # What was run here and is entered as it is: its alarms were scored already.
        if _digests_of_run(submission.name, ground, folder) == dict(_digests(submission, ground)):
            return
    elif read_ground(folder) == ground:
        record = Folder(own_folder).json(RECORD)
        entered = record["alarms"]
        for key, digest in _digests(submission, ground):
            if entered.get(key, digest) != digest:
                raise ValueError(
                    f"submission {submission.name} must have the alarms that were scored, got "
                    f"others of {key}: sealed lanes are scored once; a changed detector enters "
                    "under another name"
                )
        if record["card"] != sha256(submission.card_text):
            raise ValueError(
                f"submission {submission.name} must have the card that was scored, got another "
                "one: what a card declares is not changed after scoring; to correct it, delete "
                f"{own_folder} and enter again, which scores the alarms again and is logged"
            )
        return
    raise ValueError(
        f"submission must have a name that no other entry of {folder} has, got {submission.name}"
    )


def _digests_of_run(name: str, ground: Ground, folder: Path) -> dict[str, str]:
    """Return the digests of the lists of an entry that ran here, as :func:`_digests` does."""
    digests = {}
    for tier in ground.chosen_tiers():
        for split in ground.table.splits:
            entry = entry_folder(folder, name, tier)
            if (entry / split / ALARMS).is_file():
                alarms = read_table_in(entry, f"{split}/{ALARMS}", "alarms")
                key = f"{tier.tier}/{split}" if tier.tier else split
                digests[key] = alarm_hash(alarms)
    return digests


def _refuse_changed_cards(folder: Path) -> None:
    """Refuse a folder in which the card of an earlier entry was changed."""
    files = Folder(folder)
    for path in sorted((folder / ENTRIES).glob("*")):
        entered_card(files, path.name)


def _by_tier(submission: Submission, ground: Ground) -> Iterator[tuple[Ground, str, pd.DataFrame]]:
    """Yield tier, split and alarms of every list that has lanes in the tier."""
    for tier in ground.chosen_tiers():
        for split, alarms in submission.alarms.items():
            tested = {lane.name for lane in tier.tested(split)}
            if tested & set(submission.lanes[split]):
                yield tier, split, in_tier(alarms, tier)


def _digests(submission: Submission, ground: Ground) -> Iterator[tuple[str, str]]:
    """Yield every list by ``TIER/SPLIT``, or ``SPLIT`` without tiers, and its digest."""
    for tier, split, alarms in _by_tier(submission, ground):
        key = f"{tier.tier}/{split}" if tier.tier else split
        yield key, alarm_hash(alarms)


def _write_entry(submission: Submission, ground: Ground, folder: Path) -> None:
    """Write the alarms of a submission as those of an entry, with its card.

    A new entry has its name when it is complete. To one that is there, splits may be added.
    """
    own_folder = folder / ENTRIES / submission.name
    own_folder.parent.mkdir(exist_ok=True)
    is_new = not own_folder.exists()
    with atomic_output(own_folder) if is_new else nullcontext(own_folder) as target:
        target.mkdir(exist_ok=True)
        _fill_entry(submission, ground, target)


def _fill_entry(submission: Submission, ground: Ground, target: Path) -> None:
    """Write the files of an entry into a folder, which may hold other splits of it."""
    files = Folder(target)
    digests: dict[str, str] = {}
    if files.has(RECORD):
        digests |= files.json(RECORD)["alarms"]
    digests |= dict(_digests(submission, ground))
    record = {
        "card": sha256(submission.card_text),
        "alarms": digests,
        "lanes": submission.likeness,
    }
    # Before the alarms, so that an interrupted submission is known as the one that goes on.
    write_whole(target / RECORD, json.dumps(record, indent=1, sort_keys=True) + "\n")
    write_whole(target / CARD, submission.card_text)
    method = "" if submission.card is None else submission.card.method
    entry = Entry(submission.name, method, alarms=submission.folder)
    for tier, split, alarms in _by_tier(submission, ground):
        of_tier = target / tier.tier if tier.tier else target
        if (of_tier / split / ALARMS).is_file():
            continue  # the same alarms, by their digests
        write_about(tier, entry, of_tier)
        (of_tier / split).mkdir(exist_ok=True)
        write_table(alarms, of_tier / split / ALARMS)


def write_submissions(folder: str | Path) -> list[Path]:
    """Write what was run of classes of one's own as submissions, which ``enter`` takes as they are.

    A card that is there stays, as long as it is of the same detector: it may have been edited.

    Parameters
    ----------
    folder : str or path
        Folder of ``flgpr benchmark run``.

    Returns
    -------
    list of Path
        The folder of each submission.
    """
    home = Path(folder)
    ground = read_ground(home)
    written = []
    for path in sorted((home / ENTRIES).glob("*")):
        tiers = []
        for tier in ground.chosen_tiers():
            files = Folder(entry_folder(home, path.name, tier))
            about = files.json(ABOUT) if files.has(ABOUT) else {}
            is_whole = all(files.has(f"{split}/{ALARMS}") for split in ground.table.splits)
            if "authors" in about and not about["fault"] and is_whole:
                tiers.append((tier, about))
        if tiers:
            written.append(_write_submission(home, path.name, tiers))
    return written


def _write_submission(
    home: Path, name: str, tiers: Sequence[tuple[Ground, dict[str, Any]]]
) -> Path:
    """Write an entry that ran on tiers as a submission."""
    target = home / SUBMISSIONS / name
    refuse_links(target)
    _, about = tiers[-1]
    if (target / CARD).is_file():
        card, _ = parse_card(Folder(target).read(CARD))
        if card is not None and card.digest != about["made_of"]:
            shutil.rmtree(target)
    target.mkdir(parents=True, exist_ok=True)
    if not (target / CARD).is_file():
        write_whole(target / CARD, _card_text(home, name, tiers))
    write_whole(target / PRINTS, Folder(home / "lanes").read(PRINTS))
    for tier, _ in tiers:
        entry = entry_folder(home, name, tier)
        for split in tier.table.splits:
            alarms = read_table_in(entry, f"{split}/{ALARMS}", "alarms")
            for lane in tier.tested(split):
                of_lane = alarms[alarms["lane"] == lane.name]
                (target / split / lane.name).mkdir(parents=True, exist_ok=True)
                write_table(of_lane, target / split / lane.name / ALARMS)
    return target


def _card_text(home: Path, name: str, tiers: Sequence[tuple[Ground, dict[str, Any]]]) -> str:
    """Return the card of an entry that ran on tiers: what is known is filled in."""
    ground, about = tiers[-1]
    costs = [measured_cost(tier, name, entry_folder(home, name, tier)) for tier, _ in tiers]
    entries: dict[str, Any] = {
        "format": "flgpr-submission-1",
        "ground": ground.title,
        "name": name,
        "version": about["made_of"][:12],
        "method": about["title"][:400],
        "authors": about["authors"] or ["not stated"],
        "licence": "CC-BY-4.0",
        "trained_on": "the training lanes of each fold, and nothing else",
        "test_lanes_seen": (home / "lanes" / SHOWN).is_file(),
        "test_truth_seen": False,
        "digest": about["made_of"],
    }
    cost: dict[str, Any] = {
        "hardware": f"{os.cpu_count()} processors, {platform.machine()}",
        "seconds_per_km": round(max(cost["seconds_per_km"] for cost in costs), 1),
        "training_seconds": round(max(cost["training_seconds"] for cost in costs), 1),
    }
    peak_bytes = max(cost["peak_bytes"] for cost in costs)
    if math.isfinite(peak_bytes):
        cost["peak_mib"] = round(peak_bytes / 2**20, 1)
    lines = [f"{key} = {toml_value(value)}" for key, value in entries.items()]
    lines += [
        f"date = {datetime.date.today()}",
        "",
        "[cost]",
        *(f"{key} = {toml_value(value)}" for key, value in cost.items()),
    ]
    return "\n".join(lines) + "\n"

"""Entering submissions: checked, scored on the sealed truth once, and listed beside all others.

What ``flgpr benchmark run`` made of a class of one's own is written as a submission, too.
"""

from __future__ import annotations

import datetime
import itertools
import json
import math
import os
import platform
import shutil
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path

import pandas as pd

from flgpr.door import Folder, refuse_links
from flgpr.store import sha256, write_table, write_whole
from flgpr.store.outputs import atomic_output, discard_partials, locked_folder
from flgpr.store.tables import read_table_in
from flgpr.toml_text import toml_value
from flgpr.types import Entries
from flgpr_ground.board import refuse_other_page, write_leaderboard
from flgpr_ground.card import CARD, RECORD, entered_card, parse_card
from flgpr_ground.entries import Entry
from flgpr_ground.ground import Ground, in_tier
from flgpr_ground.lanes import PRINTS, begin_folder, read_ground, seal_tested
from flgpr_ground.running import ABOUT, ALARMS, entry_folder, measured_cost, write_about
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
        faults = submission.faults
        if faults:
            more = "; `flgpr benchmark validate` lists all" if len(faults) > _SHOWN_FAULTS else ""
            raise ValueError(
                f"submission {submission.folder} must break no rule, got {len(faults)}: "
                f"{'; '.join(faults[:_SHOWN_FAULTS])}{more}"
            )
    grounds = [submission.ground for submission in checked if submission.ground is not None]
    entered_ground = grounds[0]
    if any(other != entered_ground for other in grounds):
        titles = ", ".join(other.title for other in grounds)
        raise ValueError(f"submissions must all enter one ground, got {titles}")
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
        for path in sorted((folder / ENTRIES).glob("*")):
            entered_card(Folder(folder), path.name)  # refuses one that was changed
        begin_folder(entered_ground, folder)
        seal_tested(entered_ground, folder / "lanes")
        discard_partials(folder / ENTRIES)
        for submission in checked:
            _write_entry(submission, entered_ground, folder)
        text = write_score_tables([folder], folder)
        write_leaderboard([folder], page)
    return text


def _refuse_second(submission: Submission, ground: Ground, folder: Path) -> None:
    """Refuse a name that was entered with other alarms or another card, or that a recipe has."""
    own_folder = folder / ENTRIES / submission.name
    refuse_links(own_folder)
    if not own_folder.exists():
        return
    files = Folder(own_folder)
    of_ground = read_ground(folder) == ground
    digests = _digests(_lists(submission, ground))
    if of_ground and files.has(RECORD):
        record = files.json(RECORD)
        for key, digest in digests.items():
            if record["alarms"].get(key, digest) != digest:
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
    # What was run here and is entered as it is: its alarms were scored already.
    ran: dict[str, tuple[Ground, pd.DataFrame]] = {}
    for tier, split in itertools.product(ground.chosen_tiers(), ground.table.splits):
        name = f"{_key(tier, split)}/{ALARMS}"
        if of_ground and files.has(name):
            ran[_key(tier, split)] = tier, read_table_in(own_folder, name, "alarms")
    if not of_ground or _digests(ran) != digests:
        raise ValueError(
            f"submission must have a name that no other entry of {folder} has, got {submission.name}"
        )


def _key(tier: Ground, split: str) -> str:
    """Return the folder of a list in that of its entry: ``TIER/SPLIT``, or ``SPLIT``."""
    return f"{tier.tier}/{split}" if tier.tier else split


def _lists(submission: Submission, ground: Ground) -> dict[str, tuple[Ground, pd.DataFrame]]:
    """Return tier and alarms of every list that has lanes in the tier, by its folder."""
    lists = {}
    for tier, split in itertools.product(ground.chosen_tiers(), submission.alarms):
        tested = {lane.name for lane in tier.tested(split)}
        if tested & set(submission.lanes[split]):
            lists[_key(tier, split)] = tier, in_tier(submission.alarms[split], tier)
    return lists


def _digests(lists: Mapping[str, tuple[Ground, pd.DataFrame]]) -> dict[str, str]:
    """Return the digests of the alarms of lists."""
    return {key: alarm_hash(alarms) for key, (_, alarms) in lists.items()}


def _write_entry(submission: Submission, ground: Ground, folder: Path) -> None:
    """Write the alarms of a submission as those of an entry, with its card.

    A new entry has its name when it is complete. To one that is there, splits may be added.
    """
    own_folder = folder / ENTRIES / submission.name
    own_folder.parent.mkdir(exist_ok=True)
    is_there = own_folder.exists()
    lists = _lists(submission, ground)
    with nullcontext(own_folder) if is_there else atomic_output(own_folder) as target:
        target.mkdir(exist_ok=True)
        earlier = Folder(target).json(RECORD)["alarms"] if Folder(target).has(RECORD) else {}
        record = {
            "card": sha256(submission.card_text),
            "alarms": earlier | _digests(lists),
            "lanes": submission.likeness,
        }
        # Before the alarms, so that an interrupted submission is known as the one that goes on.
        write_whole(target / RECORD, json.dumps(record, indent=1, sort_keys=True) + "\n")
        write_whole(target / CARD, submission.card_text)
        method = "" if submission.card is None else submission.card.method
        entry = Entry(submission.name, method, alarms=submission.folder)
        for key, (tier, alarms) in lists.items():
            file = target / key / ALARMS
            if not file.is_file():  # else the same alarms, by their digests
                write_about(tier, entry, file.parent.parent)
                file.parent.mkdir(exist_ok=True)
                write_table(alarms, file)


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


def _write_submission(home: Path, name: str, tiers: Sequence[tuple[Ground, Entries]]) -> Path:
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
                file = target / split / lane.name / ALARMS
                file.parent.mkdir(parents=True, exist_ok=True)
                write_table(alarms[alarms["lane"] == lane.name], file)
    return target


def _card_text(home: Path, name: str, tiers: Sequence[tuple[Ground, Entries]]) -> str:
    """Return the card of an entry that ran on tiers: what is known is filled in."""
    ground, about = tiers[-1]
    costs = pd.DataFrame(
        [measured_cost(tier, name, entry_folder(home, name, tier)) for tier, _ in tiers]
    ).max(numeric_only=True)
    entries: Entries = {
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
    cost: Entries = {
        "hardware": f"{os.cpu_count()} processors, {platform.machine()}",
        "seconds_per_km": round(costs["seconds_per_km"], 1),
        "training_seconds": round(costs["training_seconds"], 1),
    }
    if math.isfinite(costs["peak_bytes"]):
        cost["peak_mib"] = round(costs["peak_bytes"] / 2**20, 1)
    tables = []
    for table in (entries, cost):
        tables.append([f"{key} = {toml_value(value)}" for key, value in table.items()])
    lines = [*tables[0], f"date = {datetime.date.today()}", "", "[cost]", *tables[1]]
    return "\n".join(lines) + "\n"

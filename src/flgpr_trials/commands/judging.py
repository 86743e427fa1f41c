"""The verdict of a trial: its folder in, a page, a PDF and their JSON out."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import flgpr
from flgpr.commands.score_output import write_score_files
from flgpr.door import MOST_JSON, read_named, refuse_links
from flgpr.json_text import parse_json
from flgpr.results.score import score_json_text
from flgpr.scoring import Rules, as_lanes
from flgpr.store.files import existing
from flgpr.store.outputs import OVERWRITE, log_finished, output_exists_error
from flgpr.store.tables import parse_own_table
from flgpr_trials.blind import Registration, match_blind
from flgpr_trials.folder import USED_ROWS, SignedList, TrialFolder, open_trial, used_rows
from flgpr_trials.ledger import content_hash, read_register
from flgpr_trials.sealing import Phrase, require_seal
from flgpr_trials.verdict import Verdict, judge
from flgpr_trials.verdict_page import verdict_html, verdict_pdf

VERDICT_FORMAT = "flgpr-verdict"
VERDICT_FILES = ("verdict.html", "verdict.pdf", "verdict.json")


def give_verdict(home: Path, passphrase: Phrase, overwrite: bool = False) -> Verdict | None:
    """Open the sealed truth of a trial, and score all signed lists at the registered rate.

    Every list is a look at the truth, which is entered in its log and in the register.

    Parameters
    ----------
    home : Path
        Folder of the trial.
    passphrase : str or callable
        Passphrase of the sealed truth, or a function that asks for it after all other checks.
    overwrite : bool
        Whether a verdict that is there is given anew, which is another look.

    Returns
    -------
    Verdict or None
        The verdict; None where this very verdict is there already.

    Raises
    ------
    ValueError
        If there is no signed list, one is not signed or was changed, or the truth was sealed by other rules.
    FileNotFoundError
        If there is no trial or no sealed truth.
    FileExistsError
        If a folder or a symbolic link has the name of one of the files.
    """
    require_seal()
    trial = open_trial(home)
    lists = checked_lists(trial)
    sealed = content_hash(existing(trial.sealed, "sealed truth"))
    if not overwrite and _is_given(trial, lists, sealed):
        log_finished(trial.home / VERDICT_FILES[0], f"{OVERWRITE}, which is another look")
        return None
    # Before a look is entered that nobody could read.
    for name in VERDICT_FILES:
        refuse_links(trial.home / name)
        if (trial.home / name).is_dir():
            raise output_exists_error(trial.home / name)

    day = datetime.now(UTC).date().isoformat()
    phrase = cache(passphrase) if callable(passphrase) else passphrase
    matches = {}
    notes = {}
    for number, one in enumerate(lists):
        data = read_named(used_rows(one.path))
        table = parse_own_table(data, "alarms", used_rows(one.path))
        look = match_blind(
            table,
            trial.sealed,
            phrase,
            registered=Registration(trial.register, one.line["recipe"]),
        )
        if not number:
            rules = Rules(
                halo=look.rules["halo"],
                area=look.rules["area"],
                far=trial.entries.requirement.far,
                level=trial.entries.requirement.confidence,
            )
        matches[one.vendor] = look.matched
        notes[one.vendor] = {
            "vendor": one.vendor,
            "alarms_file": one.line["file"],
            "alarms_sha256": one.line["recipe"],
            "sealed_sha256": sealed,
            "scored_on": day,
            "rows": one.line["rows"],
            "signed": one.line["signed"],
            "signed_line": one.line["number"],
            "looks": len(look.looks),
            **look.outside,
            **look.heads,
        }
        if table["confidence"].nunique() == 1:
            notes[one.vendor]["ranking"] = "all confidences are equal"
    verdict = judge(matches, trial.entries.requirement, rules)
    lanes = as_lanes(look.matched.lanes)
    files: dict[str, bytes | str] = {
        VERDICT_FILES[0]: verdict_html(verdict, lanes, notes),
        VERDICT_FILES[1]: verdict_pdf(verdict, lanes, notes),
        VERDICT_FILES[2]: _verdict_json(verdict, notes),
    }
    write_score_files(trial.home, files)
    return verdict


def checked_lists(trial: TrialFolder) -> list[SignedList]:
    """Return the signed lists of a trial, each of which must be as it was signed.

    Raises
    ------
    ValueError
        If there is none, a list was changed, or one in the folder is not signed: once the truth is
        opened it could never be.
    """
    lists = trial.signed_lists(read_register(trial.register))
    signed = {one.path for one in lists}
    for path in sorted((trial.home / "lists").glob("*.csv")):
        if path not in signed and not path.name.endswith(USED_ROWS):
            raise ValueError(
                f"a list must be signed before the truth is opened, got {path} without a "
                "signature: take it in with `signed`, or move it away"
            )
    if not lists:
        raise ValueError(f"a verdict must have a signed list, got none in {trial.register}")
    for one in lists:
        for path, digest in (
            (one.path, one.line["recipe"]),
            (used_rows(one.path), one.line["used"]),
        ):
            if content_hash(existing(path, "list")) != digest:
                raise ValueError(
                    f"a list must be as it was signed on {one.line['time'][:10]}, "
                    f"got {path}, which was changed: take it in and sign it again"
                )
    return lists


def _is_given(trial: TrialFolder, lists: Sequence[SignedList], sealed: str) -> bool:
    """Return whether the folder has the verdict on just these lists and this truth."""
    if not all((trial.home / name).is_file() for name in VERDICT_FILES):
        return False
    try:
        report = parse_json(read_named(trial.home / VERDICT_FILES[2], MOST_JSON))
        stated = {
            vendor: (of_list["signed_line"], of_list["sealed_sha256"])
            for vendor, of_list in report["notes"].items()
        }
        same_version = report["flgpr"] == flgpr.__version__
    except (ValueError, KeyError, TypeError, AttributeError):
        return False
    return same_version and stated == {one.vendor: (one.line["number"], sealed) for one in lists}


def _verdict_json(verdict: Verdict, notes: dict[str, Any]) -> str:
    """Return ``verdict.json``: the sentence, the tables and the provenance of the lists."""
    rules = {
        **verdict.requirement.model_dump(),
        "halo_radius": verdict.rules.halo,
        "area_rule": verdict.rules.area,
    }
    groups = {name: table.to_dict("records") for name, table in verdict.groups.items()}
    entries = {
        "verdict": verdict.in_words(),
        "points": verdict.points.drop(columns="threshold").to_dict("records"),
        "pairs": verdict.pairs.to_dict("records"),
        "groups": groups,
    }
    return score_json_text(VERDICT_FORMAT, rules, notes, entries)

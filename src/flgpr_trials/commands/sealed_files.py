"""Sealing a truth with its register: files in, a file out."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.commands.score_request import Trial
from flgpr.commands.scoring import borders, read_lanes
from flgpr.door import read_named, refuse_links
from flgpr.scoring import Rules
from flgpr.scoring.matching import LaneLike
from flgpr.store.files import existing
from flgpr.store.outputs import atomic_output, log_finished, output_exists_error
from flgpr.store.tables import parse_table
from flgpr_trials.commands.registering import (
    default_register,
    read_existing_register,
    register_of,
)
from flgpr_trials.folder import require_trial_rules
from flgpr_trials.ledger import RegisterLike, content_hash, register, register_paths, require_truth
from flgpr_trials.passphrase import require_seal
from flgpr_trials.sealing import Phrase, seal_truth, seals

PathLike = str | Path
BoundRegister = dict[str, str]
"""Of the register that a sealed file demands: the ``truth``'s digest and the hash of a ``line``."""


@dataclass(frozen=True)
class SealOrder:
    """What is sealed, by which rules, and where."""

    truth: Path  #: targets (CSV)
    lane: PathLike  #: lane or lanes, see :func:`flgpr.commands.scoring.read_lanes`
    output: Path  #: the sealed file
    passphrase: Phrase
    rules: Mapping[str, Any]  #: ``halo`` (m) and ``show``, as for :func:`flgpr.trials.seal_truth`
    trial: Trial  #: register in place of the truth's own, with its witness


def seal_and_enter(order: SealOrder) -> Path:
    """Encrypt a truth with its lane or lanes and rules, and enter the file into its register.

    Returns
    -------
    pathlib.Path
        The sealed file; one that seals just this with the same passphrase is left as it is.

    Raises
    ------
    ValueError
        If an input is not valid, or the register does not hold the plan.
    FileExistsError
        If another file is at the output.
    """
    require_seal()
    data = read_named(existing(order.truth, "truth file"))
    table = parse_table(data, "truth", order.truth)
    lanes = read_lanes(order.lane)
    own_register = default_register(order.truth, table)
    book = register_of(order.trial) or own_register
    bound = None
    if book is not None:
        path, _ = register_paths(book)
        lines = read_existing_register(book)
        halo = {"halo": order.rules.get("halo", Rules.halo)}
        require_trial_rules(lines, halo, path)
        digest = content_hash(data)
        require_truth(path, digest, borders(lanes), halo, planned=own_register is not None)
        if not lines:
            raise ValueError(f"book must hold a plan or a recipe, got the empty {path}")
        bound = {"truth": digest, "line": lines[-1]["hash"]}

    refuse_links(order.output)
    if os.path.lexists(order.output):
        _require_same_seal(order, table, lanes, bound)
        log_finished(order.output)
    else:
        with atomic_output(order.output) as partial:
            seal_truth(table, lanes, partial, order.passphrase, **order.rules, register=bound)
    if book is not None and bound is not None:
        _enter_sealed(book, order.output, bound["truth"])
    return order.output


def _require_same_seal(
    order: SealOrder, truth: pd.DataFrame, lanes: LaneLike, bound: BoundRegister | None
) -> None:
    """Refuse a file that does not seal this truth with these rules, passphrase and register."""
    phrase = order.passphrase() if callable(order.passphrase) else order.passphrase
    is_same, sealed_register = seals(order.output, phrase, truth, lanes, **order.rules)
    # The register may have grown since: its last line may be another one.
    truths = [None if one is None else one["truth"] for one in (bound, sealed_register)]
    if not is_same or truths[0] != truths[1]:
        raise output_exists_error(
            order.output, "or was sealed with another passphrase: choose another output"
        )


def _enter_sealed(book: RegisterLike, path: Path, truth: str) -> None:
    """Enter a sealed file into a register that does not hold it yet."""
    digest = content_hash(path)
    if any(line.get("sealed") == digest for line in read_existing_register(book)):
        return
    register(book, event="sealed", truth=truth, sealed=digest)

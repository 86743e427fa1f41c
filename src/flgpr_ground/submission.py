"""Submissions: alarm lists that somebody else made, with a card, checked before they are scored.

A submission is a folder::

    submission.toml                     the card
    fingerprints.csv                    of the lanes that were seen, as `flgpr benchmark make` wrote
    SPLIT/LANE/alarms.csv               for every test lane of a split

The folder may come from anyone. Its files are opened by :mod:`flgpr.door`, with bounds on their
number and sizes, and nothing in them runs. All faults are found at once.
"""

from __future__ import annotations

import itertools
import os
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from flgpr.door import DoorError, Folder
from flgpr.model.printable import printable
from flgpr.store.tables import parse_columns
from flgpr_ground.card import CARD, MOST_CARD_BYTES, Card, parse_card
from flgpr_ground.entries import ORACLES, packaged_entries
from flgpr_ground.ground import GROUNDS, Ground, GroundLane, load_ground
from flgpr_ground.lanes import PRINTS, likeness_of
from flgpr_ground.running import ALARMS

MOST_PRINT_BYTES = 2**20
"""Largest table of fingerprints."""
MOST_ALARM_BYTES = 16 * 2**20
"""Largest alarm list of a lane."""
MOST_ALARMS = 50_000
"""Most alarms in a lane."""
MOST_ENTRIES = 2_000
"""Most files and folders in a folder of a submission."""
HALOS_OUTSIDE = 2.0
"""Radii of the halo that an alarm may lie outside its lane."""
_SHOWN = 3  # names in a line that counts more
_REQUIRED = ("x", "y", "confidence")


@dataclass(frozen=True)
class Submission:
    """A submission that was checked."""

    folder: Path  #: where it lies
    card: Card | None  #: its card; None if that has faults
    card_text: bytes  #: the file of the card
    ground: Ground | None  #: the ground that it enters, with all of its tiers
    #: alarms by split, with the column ``lane``; empty if there are faults
    alarms: dict[str, pd.DataFrame]
    lanes: dict[str, tuple[str, ...]]  #: lanes by split, those without alarms included
    likeness: dict[str, int]  #: numbers of lanes by how like the authors' they are
    faults: tuple[str, ...]  #: a line for every rule that is broken, naming the file
    notes: tuple[str, ...]  #: what was not read or lies outside its lane, with counts

    @property
    def name(self) -> str:
        """Name by its card, or that of its folder."""
        return self.folder.name if self.card is None else self.card.name


def check_submission(folder: str | Path, ground: str | Path | None = None) -> Submission:
    """Check the folder of a submission, and read what is in it.

    Parameters
    ----------
    folder : str or path
        The folder.
    ground : str or path, optional
        TOML file of a ground of one's own; by default the packaged one that the card names.

    Returns
    -------
    Submission
        The submission with all of its faults.

    Raises
    ------
    NotADirectoryError
        If there is no such folder.
    ValueError
        If the ground's own file is not valid.
    """
    root = Path(folder)
    if not root.is_dir():
        raise NotADirectoryError(f"a submission must be a folder, got {root}")
    return _Check(root, ground).run()


class _Check:
    """The check of one folder, which gathers faults and notes."""

    def __init__(self, root: Path, ground: str | Path | None) -> None:
        self.files = Folder(root)
        self.root = root
        self.ground_file = ground
        self.faults: list[str] = []
        self.notes: list[str] = []
        self.not_read: list[str] = []
        self.likeness: dict[str, int] = {}
        self.lanes: dict[str, tuple[str, ...]] = {}
        self.outside: dict[str, int] = {}  # alarms outside their lanes, by split

    def run(self) -> Submission:
        """Check everything; what does not depend on a fault is checked in spite of it."""
        card_text = self._read(CARD, MOST_CARD_BYTES, "the card must be there") or b""
        card, faults = parse_card(card_text) if card_text else (None, [])
        self.faults += [f"{CARD}: {line}" for line in faults]
        ground = None if card is None else self._ground(card.ground)
        alarms: dict[str, pd.DataFrame] = {}
        if ground is not None and card is not None:
            if card.name in packaged_entries(ground) or card.name in ORACLES:
                self.faults.append(
                    f"{CARD}: name must not be that of a packaged entry, got {card.name!r}"
                )
            alarms = self._alarm_lists(ground)
            self._check_lanes(ground)
        if self.not_read:
            count = len(self.not_read)
            noun = "file" if count == 1 else "files"
            self.notes.append(f"{count} other {noun} not read: {_some(self.not_read)}")
        return Submission(
            folder=self.root,
            card=card,
            card_text=card_text,
            ground=ground,
            alarms={} if self.faults else alarms,
            lanes=self.lanes,
            likeness=self.likeness,
            faults=tuple(printable(line) for line in self.faults),
            notes=tuple(printable(line) for line in self.notes),
        )

    def _read(self, name: str, most: int, rule: str) -> bytes | None:
        """Return a file; one that is missing or against a rule of the folder is a fault."""
        try:
            return self.files.read(name, most)
        except FileNotFoundError:
            self.faults.append(f"{name}: {rule}, got no such file")
        except (DoorError, OSError) as error:
            self.faults.append(str(error).removeprefix(f"{self.root}: "))
        return None

    def _ground(self, title: str) -> Ground | None:
        """Return the ground of a title that a card names, with all of its tiers."""
        hint = ""
        sources: list[str | Path] = [self.ground_file] if self.ground_file else list(GROUNDS)
        if self.ground_file is None:
            hint = "; a ground of one's own is given by its file"
        grounds = {}
        for source in sources:
            full = load_ground(False, source)
            grounds[full.title] = full
            with suppress(ValueError):  # it has no quick form
                quick = load_ground(True, source)
                grounds[quick.title] = quick
        if title not in grounds:
            titles = " or ".join(grounds)
            self.faults.append(f"{CARD}: ground must be {titles}, got {title!r}{hint}")
        return grounds.get(title)

    def _alarm_lists(self, ground: Ground) -> dict[str, pd.DataFrame]:
        """Return the alarms of every split that has a folder."""
        alarms = {}
        for name, is_folder in self._entries(""):
            if not is_folder:
                if name not in (CARD, PRINTS):
                    self.not_read.append(name)
            elif name in ground.table.splits:
                alarms[name] = self._alarms_of_split(ground, name)
            else:
                known = ", ".join(ground.table.splits)
                self.faults.append(f"{name}: folders must be named after splits, {known}")
        if not alarms and not self.faults:
            known = ", ".join(ground.table.splits)
            self.faults.append(f"alarms must be there for one split at least, of {known}, got none")
        return alarms

    def _alarms_of_split(self, ground: Ground, split: str) -> pd.DataFrame:
        """Return the alarms of a split; lanes that are missing or not of it are faults."""
        lanes = {lane.name: lane for lane in ground.tested(split)}
        tables = [pd.DataFrame({"x": [], "y": [], "confidence": [], "lane": []})]
        present = set()
        strange = []
        for name, is_folder in self._entries(split):
            if not is_folder:
                self.not_read.append(f"{split}/{name}")
            elif name in lanes:
                present.add(name)
                table = self._alarms_of_lane(ground, split, lanes[name])
                if table is not None:
                    tables.append(table)
            else:
                strange.append(name)
        if strange:
            self.faults.append(
                f"{split}: its folders must be named after test lanes of the split, got "
                f"{len(strange)} that are none: {_some(strange)}"
            )
        self._check_complete(ground, split, present)
        self.lanes[split] = tuple(sorted(present))
        alarms = pd.concat(tables[1:] or tables, ignore_index=True)
        outside = self.outside.get(split, 0)
        if outside and outside == len(alarms):
            self.faults.append(
                f"{split}: alarms must lie in their lanes, all {outside} lie outside: are x and y "
                "swapped, or the lanes others?"
            )
        elif outside:
            self.notes.append(
                f"{split}: {outside} of {len(alarms)} alarms lie outside their lanes: they find "
                "targets near a border, and are no false alarms"
            )
        return alarms

    def _check_complete(self, ground: Ground, split: str, present: set[str]) -> None:
        """Refuse a tier of which some lanes are there and others are not."""
        if not present:
            self.faults.append(f"{split}: it must hold folders of its test lanes, got none")
        for tier in ground.chosen_tiers():
            names = [lane.name for lane in tier.tested(split)]
            missing = [name for name in names if name not in present]
            if missing and len(missing) < len(names):
                self.faults.append(
                    f"{split}: all {len(names)} test lanes must be there, one without alarms with "
                    f"the header alone, got none of {_some(missing)} ({len(missing)} missing)"
                )

    def _alarms_of_lane(self, ground: Ground, split: str, lane: GroundLane) -> pd.DataFrame | None:
        """Return the alarms of a lane; None if they have faults."""
        name = f"{split}/{lane.name}/{ALARMS}"
        for other, _ in self._entries(f"{split}/{lane.name}"):
            if other != ALARMS:
                self.not_read.append(f"{split}/{lane.name}/{other}")
        data = self._read(name, MOST_ALARM_BYTES, "a lane's alarms must be there, or its header")
        if data is None:
            return None
        try:
            table = parse_columns(data, "alarm_id", "lane")
        except ValueError as error:
            self.faults.append(f"{name}: must be a table of alarms: {str(error)[:200]}")
            return None
        faults = list(_table_faults(table, lane, HALOS_OUTSIDE * ground.table.halo))
        self.faults += [f"{name}: {fault}" for fault in faults]
        if faults:
            return None
        numbers = table[list(_REQUIRED)].astype(np.float64)
        is_outside = ~lane.lane.contains(numbers["x"], numbers["y"])
        self.outside[split] = self.outside.get(split, 0) + int(is_outside.sum())
        return numbers.assign(lane=lane.name)

    def _check_lanes(self, ground: Ground) -> None:
        """Refuse lanes that are other ones than the authors', by their fingerprints."""
        rule = "the fingerprints of the lanes, which lie beside them, must be there"
        data = self._read(PRINTS, MOST_PRINT_BYTES, rule)
        if data is None:
            return
        try:
            likeness = likeness_of(ground, data)
        except ValueError as error:
            self.faults.append(f"{PRINTS}: {str(error)[:200]}")
            return
        needed = set(itertools.chain(*self.lanes.values()))
        absent = [name for name in sorted(needed) if likeness[name] == "not there"]
        if absent:
            self.faults.append(
                f"{PRINTS}: every test lane that was searched must be in it, got {len(absent)} "
                f"that are not: {_some(absent)}"
            )
        other = [name for name, word in likeness.items() if word == "other"]
        if other:
            self.faults.append(
                f"{PRINTS}: lanes must be those of {ground.title}, got {len(other)} with other "
                f"echoes: {_some(other)}"
            )
        self.likeness = dict(Counter(word for word in likeness.values() if word != "not there"))
        unknown = self.likeness.get("not known", 0)
        if unknown:
            self.notes.append(
                f"{PRINTS}: {unknown} lanes have no fingerprint of the authors to compare with"
            )

    def _entries(self, name: str) -> Iterator[tuple[str, bool]]:
        """Yield names in a folder, sorted, and whether each is a folder; links are faults."""
        try:
            path = self.files.path(name) if name else self.root
            entries: list[tuple[str, bool, bool]] = []
            with os.scandir(path) as listing:
                for entry in listing:
                    if len(entries) == MOST_ENTRIES:
                        raise DoorError(f"it must hold at most {MOST_ENTRIES} files, got more")
                    entries.append((entry.name, entry.is_symlink(), entry.is_dir()))
        except (DoorError, OSError) as error:
            self.faults.append(f"{name or '.'}: {str(error).removeprefix(f'{self.root}: ')}")
            return
        for entry_name, is_link, is_folder in sorted(entries):
            if is_link:
                shown = f"{name}/{entry_name}" if name else entry_name
                self.faults.append(f"{shown} must be a file or a folder, got a symbolic link")
            else:
                yield entry_name, is_folder


def _table_faults(table: pd.DataFrame, lane: GroundLane, margin: float) -> Iterator[str]:
    """Yield the rules that the alarms of a lane break, each with a count and the first row."""
    if not set(_REQUIRED) <= set(table.columns):
        names = ", ".join(str(name)[:40] for name in table.columns[:12])
        yield (
            f"it must have the columns x, y (m, in the lane frame) and confidence, got {names}; "
            "`flgpr import table` converts other names and units"
        )
        return
    if len(table) > MOST_ALARMS:
        yield f"a lane must have at most {MOST_ALARMS} alarms, got {len(table)}"
        return
    numbers = table[list(_REQUIRED)].apply(pd.to_numeric, errors="coerce").astype(np.float64)
    for name in _REQUIRED:
        bad = ~np.isfinite(numbers[name])
        yield from _rule(bad, f"{name} must be a finite number", "{!r:.60}", table[name].map(str))
    place = numbers["x"], numbers["y"]
    finite = np.isfinite(place[0]) & np.isfinite(place[1])
    far = lane.lane.distance(*(axis.where(finite, 0.0) for axis in place)) > margin
    limits = lane.lane
    rule = (
        f"alarms must lie in the lane (x {limits.x_min:g} to {limits.x_max:g} m, "
        f"y {limits.y_min:g} to {limits.y_max:g} m) or at most {margin:g} m outside"
    )
    yield from _rule(finite & far, rule, "x = {:.6g}, y = {:.6g}", *place)
    # An alarm that is repeated would hit a target, or count as false, twice.
    repeated = finite & numbers[["x", "y"]].duplicated()
    rule = "alarms must lie at places of their own"
    yield from _rule(repeated, rule, "x = {:.6g}, y = {:.6g} again", *place)
    if "alarm_id" in table.columns:
        ids = table["alarm_id"]
        repeated = ids.duplicated() & ids.notna()
        yield from _rule(repeated, "alarm_id must be unique", "{!r:.42} again", ids)
    if "lane" in table.columns:
        lanes = table["lane"].fillna("").astype(str)
        strange = ~lanes.isin(["", lane.name])
        yield from _rule(strange, f"lane must be {lane.name} or empty", "{!r:.62}", lanes)


def _rule(broken: pd.Series, rule: str, got: str, *values: pd.Series) -> Iterator[str]:
    """Yield a rule that rows break, if any does: what the first row holds, its line, and a count."""
    rows = np.flatnonzero(broken)
    if rows.size:
        noun = "row" if rows.size == 1 else "rows"
        shown = got.format(*(value.iloc[rows[0]] for value in values))
        yield f"{rule}, got {shown} in line {rows[0] + 2} ({rows.size} {noun})"  # line 1: header


def _some(names: list[str]) -> str:
    """Return the first few of some names."""
    shown = ", ".join(name[:80] for name in names[:_SHOWN])
    return f"{shown}, ..." if len(names) > _SHOWN else shown

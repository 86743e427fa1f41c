"""Scoring, open and blind, of one detector or of several side by side: files in, files out."""

from __future__ import annotations

import dataclasses
import html
import importlib.util
import itertools
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import pandas as pd

import flgpr
from flgpr.chain.progress import Track, silent
from flgpr.commands.doubts import tell_doubts
from flgpr.commands.registering import (
    Entrant,
    check_registered,
    find_entrant,
    open_truth,
    own_book,
    registration,
)
from flgpr.door import MOST_JSON, Folder, parse_json, parse_toml, read_named
from flgpr.execution.finished import results_at
from flgpr.model import Lane
from flgpr.report import blind_html, comparison_html, score_files
from flgpr.results.result import Result, add_files, are_settled, join_sections, read_result
from flgpr.results.score import (
    VIEW_SCORE,
    blind_roc_json,
    comparison_json,
    score_by_frames,
    score_detections,
    view_score,
)
from flgpr.results.sections import SECTIONS, read_sections
from flgpr.scoring import (
    Agreement,
    Rules,
    Score,
    SideBySide,
    agreement,
    as_lanes,
    score,
    side_by_side,
)
from flgpr.scoring.matching import LaneLike
from flgpr.store import VERDICTS, read_table, read_verdicts, verdict_key, write_whole
from flgpr.store.dialects import TableReading
from flgpr.store.files import existing, faults_of
from flgpr.store.outputs import OVERWRITE, held_folder, other_output, tell_finished, whole_output
from flgpr.store.tables import parse_table, read_columns
from flgpr.trials import BlindScore, content_hash, register, require_truth
from flgpr.trials.blind import FAR_GRID, Phrase, match_blind, score_blind, seal_truth, seals
from flgpr.trials.ledger import Book, parts_of, read_book

PathLike = str | Path


@dataclasses.dataclass(frozen=True)
class Scored:
    """The scores of a result or an alarm list, and where their report is."""

    folder: Path  #: with ``report.html`` and ``roc.json``
    scores: list[Score]  #: of each detection; of an alarm list the one
    result: Result | None = None  #: the result that was scored

    def __iter__(self) -> Iterator[Any]:
        return iter((self.result, self.scores))

    def outcomes(self) -> pd.DataFrame:
        """Return what became of each target, see :func:`outcome_table`."""
        return outcome_table(self.scores)

    def _repr_html_(self) -> str:
        summary = html.escape(f"{self.scores[0].name}: {self.scores[0].in_words()}")
        table = self.outcomes().to_html(index=False, float_format="{:.3g}".format, border=0)
        return f"<p>{summary}</p>{table}"


def read_lanes(path: PathLike) -> Lane | dict[str, Lane]:
    """Read one lane or several from TOML or CSV; several come by name.

    TOML holds ``x_min``, ``x_max``, ``y_min``, ``y_max`` (m), or a table of these per lane; CSV has these columns, one
    row per lane, named in the column ``lane``. A file that holds no lanes is a ValueError.
    """
    path = existing(path, "lane file")
    with faults_of(path):
        table = path.suffix.lower() == ".csv"
        lanes = as_lanes(read_columns(path) if table else parse_toml(read_named(path)))
    return lanes[""] if list(lanes) == [""] else lanes


def borders(lanes: LaneLike) -> dict[str, dict[str, float]]:
    """Give the borders of each lane, m, by name, as registers hold them."""
    return {name: dataclasses.asdict(one) for name, one in as_lanes(lanes).items()}


def score_result(
    folder: PathLike,
    truth: PathLike,
    objects: PathLike | None = None,
    output: PathLike | None = None,
    track: Track = silent,
    *,
    recipe: PathLike | None = None,
    book: Book | None = None,
    far: float = Rules.far,
    overwrite: bool = True,
    truth_reading: TableReading | None = None,
) -> tuple[Result, list[Score]]:
    """Score a result, or a lane that was taken in sections as one, by its recipe's rules, and write the report.

    ``truth`` is CSV of the targets, ``objects`` of what else stands there, for the pictures; ``output`` takes the
    files, by default :func:`score_home`. With ``score.area = "frames"`` in the recipe the score and its report are of
    the alarms of every frame, see :func:`flgpr.scoring.score_frames`; the viewer shows those of the lane. Targets count
    as found or missed at the operating point ``far``, per m²; ``recipe`` and ``book`` are as for :func:`score_alarms`.
    If an input is not valid or altered, or the recipe is not registered, nothing is written; nor is it without
    ``overwrite`` where another score is, a FileExistsError. ``truth_reading`` is as for :func:`score_alarms`.
    """
    home = Path(folder)
    homes = results_at(folder)
    whole = homes == [home]
    result = read_result(home) if whole else join_sections(home, homes)
    to = Path(output) if output is not None else score_home(home)
    others = read_table(objects, "objects") if objects is not None else None
    rules = {"halo": result.recipe.score.halo, "far": far}
    targets, (notes,) = open_truth(
        truth, [find_entrant(home, recipe)], borders(result.lane), rules, book, truth_reading
    )
    tell_doubts(targets, "truth", Path(truth).name, result.lane)
    scored = score_detections(result, targets, far)
    sections = {} if whole else {one.name: _page_of(one, to) for one in homes}
    by_frames = (
        [score_by_frames(result, targets, far)] if result.recipe.score.area == "frames" else []
    )
    files: dict[str, bytes | str] = {}
    for _ in track(["report.html"], "drawing the report", 1):
        if by_frames:
            files |= score_files(by_frames, notes, title=by_frames[0].title)
        else:
            files |= score_files(scored, notes, result=result, objects=others, sections=sections)
    if whole:
        files[VIEW_SCORE] = view_score(result, scored, others)
    to.mkdir(parents=True, exist_ok=True)
    if to.resolve() == home.resolve():
        if _is_to_write(
            to, _last(files, "roc.json"), overwrite, decides="roc.json"
        ) or not are_settled(to):
            add_files(to, _last(files, "roc.json"))
        return read_result(to), by_frames or scored
    _write(to, files, overwrite)
    return result, by_frames or scored


def score_home(folder: PathLike) -> Path:
    """Tell where the score of a result is written by default: in it, or in ``score`` in a folder of sections."""
    return Path(folder) / "score" if Folder(folder).has(SECTIONS) else Path(folder)


def score_alarms(
    alarms: PathLike,
    truth: PathLike,
    lane: PathLike,
    output: PathLike,
    *,
    recipe: PathLike | None = None,
    book: Book | None = None,
    title: str = "Detection report",
    overwrite: bool = True,
    reading: TableReading | None = None,
    truth_reading: TableReading | None = None,
    **rules: Any,
) -> list[Score]:
    """Score an alarm list of any detector (CSV) and write the report; the list has the one score.

    ``lane`` is as for :func:`read_lanes`. ``output`` takes ``report.html``, ``roc.json`` and the figures as PNG and
    PDF. ``book`` is the register that must hold the hash of the ``recipe`` before the truth is first opened, and where
    the opening is entered; a planned truth names its own. ``rules`` are those of :class:`flgpr.scoring.Rules`. Without
    ``overwrite`` another score there is a FileExistsError. ``reading`` and ``truth_reading`` say which columns of the
    list and of the truth are what, and where their places on the Earth are in the lane.
    """
    one = find_entrant(alarms, recipe, reading)
    where = read_lanes(lane)
    how = Rules(**rules)
    table = one.table()
    tell_doubts(table, "alarms", one.path.name, where)
    opened = {"halo": how.halo, "far": how.far}
    targets, (notes,) = open_truth(truth, [one], borders(where), opened, book, truth_reading)
    tell_doubts(targets, "truth", Path(truth).name, where)
    notes |= _reading_notes(table, targets)
    scored = [score(table, targets, where, how)]
    _write(Path(output), score_files(scored, notes, title=title), overwrite)
    return scored


def _reading_notes(alarms: pd.DataFrame, truth: pd.DataFrame) -> dict[str, Any]:
    """Tell what of the tables was read otherwise than it stands, for the report."""
    found = {
        "alarms_read": alarms.attrs.get("notes", []),
        "truth_read": truth.attrs.get("notes", []),
    }
    return {name: notes for name, notes in found.items() if notes}


def outcome_table(scored: Sequence[Score]) -> pd.DataFrame:
    """Gather what became of each target in every detection, a row per detection and target.

    Columns are detection, target_id, kind, depth, whether it is found at the operating point, whether any alarm detects
    it, and that alarm's far, rank, n_false and distance.
    """
    columns = [
        "target_id",
        "kind",
        "depth",
        "found",
        "detected",
        "far",
        "rank",
        "n_false",
        "distance",
    ]
    return pd.concat(
        [one.outcomes[columns].assign(detection=one.name) for one in scored], ignore_index=True
    )


def compare_alarms(
    alarms: Sequence[PathLike],
    truth: PathLike,
    output: PathLike,
    lane: PathLike | None = None,
    *,
    recipes: Sequence[PathLike] = (),
    book: Book | None = None,
    halo: float | None = None,
    far: float = Rules.far,
    overwrite: bool = True,
    reading: TableReading | None = None,
    truth_reading: TableReading | None = None,
) -> SideBySide:
    """Set two alarm lists (CSV) or result folders side by side, or more, and write a page and ``comparison.json``.

    ``lane`` is as for :func:`read_lanes`; without it, and without a ``halo``, m, those of the results count, which must
    be the same. ``far`` is an operating point beside the usual ones, per m². ``recipes`` are as many as ``alarms`` or
    none, and what they, ``book`` and the truth must agree in is as for :func:`score_alarms`, and so are
    ``overwrite`` and the readings, of which ``reading`` is of every list.
    """
    entrants = _entrants(alarms, recipes, reading)
    results = [_lane_and_halo(one.path.parent) for one in entrants if one.of_result]
    lanes = {one for one, _ in results}
    if lane is None and (len(lanes) != 1 or len(results) < len(entrants)):
        raise ValueError(
            f"alarm lists need --lane to be compared, and results one and the same; got {len(lanes)} lanes"
        )
    where = read_lanes(lane) if lane is not None else lanes.pop()
    halos = {own for _, own in results} if halo is None else {halo}
    if len(halos) > 1:
        raise ValueError(
            f"halo must be given to compare results whose recipes have several, got {sorted(halos)} m"
        )
    rules = Rules(halo=halos.pop() if halos else Rules.halo, far=far)
    names = _names(entrants)
    tables = [one.table() for one in entrants]
    targets, notes = open_truth(
        truth, entrants, borders(where), {"halo": rules.halo, "far": far}, book, truth_reading
    )
    for one, table in zip(entrants, tables, strict=True):
        tell_doubts(table, "alarms", one.path.name, where)
    tell_doubts(targets, "truth", Path(truth).name, where)
    for table, note in zip(tables, notes, strict=True):
        note |= _reading_notes(table, targets)
    scored = [score(table, targets, where, rules) for table in tables]
    fars = scored[0].operating_points()["far_allowed"].tolist()
    told = side_by_side(
        {name: one.matched for name, one in zip(names, scored, strict=True)}, fars, rules
    )
    curves = {name: one.curve for name, one in zip(names, scored, strict=True)}
    about = {**scored[0].told_rules(), "far_max": rules.far_max}
    _write_comparison(output, told, curves, about, dict(zip(names, notes, strict=True)), overwrite)
    return told


def compare_sealed(
    alarms: Sequence[PathLike],
    sealed: PathLike,
    passphrase: Phrase,
    output: PathLike,
    log: PathLike | None = None,
    *,
    recipes: Sequence[PathLike] = (),
    book: Book | None = None,
    witness: PathLike | None = None,
) -> SideBySide:
    """Set alarm lists side by side against a sealed truth, each a look; tells points and counts of all targets only.

    Parameters are those of :func:`score_sealed` and :func:`compare_alarms`, and the files those of the latter.
    """
    entrants = _entrants(alarms, recipes)
    check_registered(entrants, book)
    place = existing(sealed, "sealed truth")
    names = _names(entrants)
    tables = [one.table() for one in entrants]
    phrase = passphrase() if callable(passphrase) else passphrase
    matches = {}
    notes = {}
    for name, one, table in zip(names, entrants, tables, strict=True):
        asked = registration(one, book)
        look = match_blind(table, place, phrase, log, registered=asked, witness=witness)
        matches[name] = look.matched
        notes[name] = one.notes(look.line) | {"looks": len(look.looks), **look.heads}
        notes[name]["sealed_sha256"] = content_hash(place)
        rules = look.rules
    how = Rules(halo=rules["halo"], area=rules["area"])
    told = side_by_side(matches, FAR_GRID, how, means=False)
    told = dataclasses.replace(
        told, points=told.points.round({"chance": 2})
    )  # as a blind score tells it
    about = {
        "halo_radius": how.halo,
        "area_rule": how.area,
        "level": how.level,
        "far_max": how.far_max,
    }
    _write_comparison(output, told, {}, about, notes)
    return told


def analyst_agreement(
    files: Sequence[PathLike],
) -> dict[tuple[str, str], tuple[Agreement, int, int]]:
    """Compare the verdicts of analysts (JSON of ``flgpr view``), every two on the alarms that both of them judged.

    Each pair of files has its :class:`flgpr.scoring.Agreement` and how many alarms the first alone and the second alone
    judged. Fewer than two files, one that holds no verdicts, or two without a common alarm are a ValueError.
    """
    if len(files) < 2:
        raise ValueError(
            f"agreement needs the verdicts of two analysts or more, got {len(files)} file"
        )
    names = [Path(one).stem for one in files]
    names = names if len(set(names)) == len(names) else [str(one) for one in files]
    if len(set(names)) < len(names):
        raise ValueError(f"verdicts must be different files to be compared, got {', '.join(names)}")
    judged = {
        name: {verdict_key(note): note["verdict"] for note in read_verdicts(one) if note["verdict"]}
        for name, one in zip(names, files, strict=True)
    }
    told = {}
    for first, second in itertools.combinations(names, 2):
        a = judged[first]
        b = judged[second]
        both = [key for key in a if key in b]
        if not both:
            raise ValueError(
                f"verdicts must have alarms in common, got {len(a)} of {first} and {len(b)} of {second}: none"
            )
        pair = agreement([a[key] for key in both], [b[key] for key in both], VERDICTS)
        told[first, second] = pair, len(a) - len(both), len(b) - len(both)
    return told


def _entrants(
    alarms: Sequence[PathLike], recipes: Sequence[PathLike], reading: TableReading | None = None
) -> list[Entrant]:
    if recipes and len(recipes) != len(alarms):
        raise ValueError(
            f"recipe must be given once per alarm list, got {len(recipes)} for {len(alarms)} lists"
        )
    return [
        find_entrant(one, recipe, reading) for one, recipe in itertools.zip_longest(alarms, recipes)
    ]


def _lane_and_halo(folder: Path) -> tuple[Lane, float]:
    """Tell the lane of a result, or of one in sections, and its recipe's halo, m."""
    first = read_result(results_at(folder)[0])
    lane = read_sections(folder).lane() if Folder(folder).has(SECTIONS) else first.lane
    return lane, first.recipe.score.halo


def _names(entrants: Sequence[Entrant]) -> list[str]:
    """Name alarm lists by their file or result folder, or in full where that is not unique."""
    if len({one.path.resolve() for one in entrants}) < len(entrants):
        raise ValueError(
            f"alarms must be different lists to be compared, got {', '.join(str(e.path) for e in entrants)}"
        )
    short = [one.path.parent.resolve().name if one.of_result else one.path.stem for one in entrants]
    return short if len(set(short)) == len(short) else [str(one.path) for one in entrants]


def _write_comparison(
    output: PathLike,
    told: SideBySide,
    curves: Mapping[str, pd.DataFrame],
    rules: Mapping[str, Any],
    notes: Mapping[str, Any],
    overwrite: bool = True,
) -> None:
    page = comparison_html(told, curves, rules, notes)
    _write(
        Path(output),
        {"comparison.html": page, "comparison.json": comparison_json(told, rules, notes)},
        overwrite,
    )


def require_seal() -> None:
    """Refuse before anybody types a passphrase if a library that sealing needs is not installed."""
    for library in ("cryptography", "zxcvbn"):
        if importlib.util.find_spec(library) is None:
            raise ModuleNotFoundError(
                f"sealed truth needs the library {library}: pip install 'flgpr[seal]'"
            )


def seal(
    truth: PathLike,
    lane: PathLike,
    output: PathLike,
    passphrase: Phrase,
    *,
    halo: float = Rules.halo,
    area: Literal["union", "paper"] = "union",
    by: str | None = "kind",
    show: Literal["curve", "targets"] = "curve",
    book: Book | None = None,
) -> Path:
    """Encrypt a truth (CSV) with its lane or lanes and rules for blind scoring.

    A file that seals just this with the same passphrase stays, any other is a FileExistsError. The lane is as for
    :func:`read_lanes`, the rest as for :func:`flgpr.trials.seal_truth`. A planned truth is sealed with its register,
    or with the ``book`` that is given: scores then demand it, with the recipe in it.
    """
    data = read_named(existing(truth, "truth file"))
    table = parse_table(data, "truth", truth)
    where = read_lanes(lane)
    own = own_book(truth, table)
    held = own if book is None else book
    bound = None
    if held is not None:
        place = existing(parts_of(held)[0], "register")
        lines = read_book(held)
        digest = content_hash(data)
        require_truth(place, digest, borders(where), {"halo": halo}, planned=own is not None)
        if not lines:
            raise ValueError(f"book must hold a plan or a recipe, got the empty {place}")
        bound = {"truth": digest, "line": lines[-1]["hash"]}
    rules: dict[str, Any] = {"halo": halo, "area": area, "by": by, "show": show}
    path = Path(output)
    if os.path.lexists(path):
        phrase = passphrase() if callable(passphrase) else passphrase
        same, before = seals(path, phrase, table, where, **rules)
        if (
            not same
            or (before is None) != (bound is None)
            or (bound and before and before["truth"] != bound["truth"])
        ):
            raise other_output(path, "or was sealed with another passphrase: choose another output")
        tell_finished(path)
    else:
        with whole_output(path) as made:
            seal_truth(table, where, made, passphrase, **rules, book=bound)
    digest = content_hash(path)
    if held is not None and not any(line.get("sealed") == digest for line in read_book(held)):
        register(held, event="sealed", truth=bound and bound["truth"], sealed=digest)
    return path


def score_sealed(
    alarms: PathLike,
    sealed: PathLike,
    passphrase: Phrase,
    output: PathLike | None = None,
    log: PathLike | None = None,
    *,
    recipe: PathLike | None = None,
    book: Book | None = None,
    witness: PathLike | None = None,
) -> BlindScore:
    """Score an alarm list (CSV), or that of a result, against a sealed truth; tells nothing that shows a position.

    ``output`` is a folder for ``report.html`` and ``roc.json`` with what the score tells, ``log`` the log of all looks,
    beside the sealed file by default, and ``witness`` a file elsewhere that must know the log's
    lines. ``recipe`` and ``book`` are as for :func:`score_alarms`; a truth that was sealed with a
    register demands them. Errors are those of :func:`flgpr.trials.score_blind`.
    """
    one = find_entrant(alarms, recipe)
    check_registered([one], book)
    place = existing(sealed, "sealed truth")
    table = one.table()
    told = score_blind(table, place, passphrase, log, registration(one, book), witness)
    if output is not None:
        notes = one.notes(told.registered) | {"sealed_sha256": content_hash(place), **told.heads}
        _write(
            Path(output),
            {"report.html": blind_html(told, notes), "roc.json": blind_roc_json(told, notes)},
        )
    return told


def holds_sealed_score(
    alarms: Sequence[PathLike],
    sealed: PathLike,
    output: PathLike,
    recipes: Sequence[PathLike] = (),
    book: Book | None = None,
) -> bool:
    """Tell, before anybody looks, whether a folder has the score of these alarm lists against this sealed truth.

    A folder with another score, one of other recipes in the register, or one of another version, is a FileExistsError.
    """
    home = Path(output)
    file = home / ("comparison.json" if len(alarms) > 1 else "roc.json")
    if not os.path.lexists(file):
        return False
    entrants = _entrants(alarms, recipes)
    digest = content_hash(existing(sealed, "sealed truth"))
    wanted = sorted(
        (content_hash(one.path), digest, "" if book is None else str(one.recipe))
        for one in entrants
    )
    try:
        told = parse_json(Folder(home).read(file.name, MOST_JSON))
        notes = list(told["notes"].values()) if len(alarms) > 1 else [told["notes"]]
        there = sorted(
            (one["alarms_sha256"], one["sealed_sha256"], one.get("recipe_sha256", ""))
            for one in notes
        )
        same = there == wanted and told["flgpr"] == flgpr.__version__
    except (ValueError, KeyError, TypeError, AttributeError):
        same = False
    if not same:
        raise other_output(file, f"{OVERWRITE}, or choose another output")
    tell_finished(home, f"{OVERWRITE}, which is another look")
    return True


def _page_of(section: Path, to: Path) -> str:
    """Tell the address of a section's page as seen from another folder; "" if it has none."""
    page = section / "report.html"
    return Path(os.path.relpath(page, to)).as_posix() if page.is_file() else ""


def _last(files: Mapping[str, bytes | str], name: str) -> dict[str, bytes | str]:
    """Put a file behind the others: where it is, all of them are."""
    return {key: files[key] for key in sorted(files, key=lambda key: key == name)}


def _is_to_write(
    home: Path, files: Mapping[str, bytes | str], overwrite: bool, decides: str = ""
) -> bool:
    """Tell whether files are to be written, and not there already; other content there is a FileExistsError.

    Where the file is missing that ``decides``, the others are those of no score, or of one that was stopped.
    """
    if overwrite or (decides and not os.path.lexists(home / decides)):
        return True
    missing = False
    for name, data in files.items():
        if not os.path.lexists(home / name):
            missing = True
        elif read_named(home / name) != (data.encode() if isinstance(data, str) else data):
            raise other_output(home / name, f"{OVERWRITE}, or choose another output")
    if not missing:
        tell_finished(home, OVERWRITE)
    return missing


def _write(home: Path, files: Mapping[str, bytes | str], overwrite: bool = True) -> None:
    """Write files into a folder, one process after the other."""
    home.mkdir(parents=True, exist_ok=True)
    with held_folder(home, wait=True):
        if not _is_to_write(home, files, overwrite):
            return
        for name, data in files.items():
            (home / name).parent.mkdir(parents=True, exist_ok=True)
            write_whole(home / name, data)

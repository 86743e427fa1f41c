"""Scoring against an open truth, of one detector or of several side by side: files in, files out.

Lists are read, the truth is opened, they are scored, and the files are written. Registers and
sealed truths are kept by another package, see :mod:`flgpr.commands.trials`.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.commands.entrants import Entrant, entrant_names, find_entrants, ranking_notes
from flgpr.commands.reach import (
    refuse_elsewhere,
    targets_in_reach,
    tell_doubts,
    tell_ranking_doubts,
)
from flgpr.commands.score_output import must_write, with_last, write_score_files
from flgpr.commands.score_request import ScoreRequest, given, refuse
from flgpr.commands.trials import REGISTER_COLUMN, installed_trials, needed_trials
from flgpr.door import Folder, read_named, refuse_links
from flgpr.model import Lane
from flgpr.model.faults import faults_of
from flgpr.progress import Track, silent
from flgpr.report import comparison_html, score_files
from flgpr.results.notebook_html import curve_html, outcomes_html
from flgpr.results.result import Result, add_files, are_settled, join_sections, read_result
from flgpr.results.score import (
    comparison_json,
    score_by_frames,
    score_detections,
    view_score,
)
from flgpr.results.sections import SECTIONS, read_sections, results_at
from flgpr.scoring import Rules, Score, SideBySide, as_lanes, score, side_by_side
from flgpr.scoring.matching import LaneLike
from flgpr.store import read_table, sha256
from flgpr.store.files import existing
from flgpr.store.tables import parse_table, read_columns
from flgpr.store.view_format import VIEW_SCORE
from flgpr.toml_text import parse_toml
from flgpr.types import Entries, PathLike


@dataclass(frozen=True)
class Scored:
    """The scores of a result or an alarm list, and where their report is."""

    folder: Path  #: with ``report.html`` and ``roc.json``
    scores: list[Score]  #: of each detection; of an alarm list a single one
    result: Result | None = None  #: the result that was scored
    source: Any = field(default=None, repr=False)  #: what was given to be scored

    def __iter__(self) -> Iterator[Any]:
        return iter((self.result, self.scores))

    def outcomes(self) -> pd.DataFrame:
        """Return what became of each target, a row for each detection and target.

        Columns are detection, target_id, kind, depth (m), whether it is found at the operating
        point, whether any alarm detects it, and that alarm's far (per m²), rank, n_false and
        distance (m).
        """
        columns = ["target_id", "kind", "depth", "found", "detected"]
        columns += ["far", "rank", "n_false", "distance"]
        tables = [one.outcomes[columns].assign(detection=one.name) for one in self.scores]
        return pd.concat(tables, ignore_index=True)

    def _repr_html_(self) -> str:
        """Return the summary, the outcomes and a picture for a notebook."""
        main = self.scores[0]
        sentence = f"{main.name}: {main.in_words()}"
        outcomes = main.outcomes
        if self.result is None:
            return curve_html(sentence, outcomes, main.curve)
        return outcomes_html(sentence, outcomes, self.result.detections[0], self.result.lane)


def score_output(
    lists: Sequence[Path], lane: PathLike | None = None, output: PathLike | None = None
) -> Path:
    """Return the folder in which the score of lists is written: a result has its own."""
    if output is not None:
        return Path(output)
    folder = lists[0].parent if lists[0].name == "alarms.csv" else lists[0]
    is_result = any((folder / name).is_file() for name in ("manifest.json", SECTIONS))
    if not is_result or lane is not None or len(lists) > 1:
        return Path("score")
    return folder / "score" if Folder(folder).has(SECTIONS) else folder


def score_one(request: ScoreRequest, track: Track = silent) -> Scored:
    """Score a result by its recipe's rules, or an alarm list by the rules that are given.

    The list inside a result is scored with the result, unless a lane is given.
    """
    [path] = request.lists
    is_list = path.suffix == ".csv" and not (path.parent / "manifest.json").is_file()
    reading = request.reading
    if not is_list and reading is not None and (reading.columns or reading.unranked):
        name = "columns are" if reading.columns else "unranked is"
        raise ValueError(f"{name} of alarm lists: a result's list has its own; see truth_columns")
    if is_list or request.lane is not None:
        refuse(given({"objects": request.objects}), "an alarm list is scored without pictures")
        return score_list(request)

    refuse(request.rules.keys() & {"halo"}, "a result is scored by the halo of its recipe")
    folder = path.parent if path.name == "alarms.csv" else path
    return score_result(dataclasses.replace(request, lists=[folder]), track)


def score_list(request: ScoreRequest) -> Scored:
    """Score an alarm list of any detector and write the report.

    A list whose alarms rank equal has a single operating point, at its own false alarm rate:
    targets count as found there, unless the rules name ``far``.

    Parameters
    ----------
    request : ScoreRequest
        One list with its lane.

    Returns
    -------
    Scored
        A single score.

    Raises
    ------
    ValueError
        If an input is not valid, or the register does not hold the recipe.
    FileExistsError
        If another score is there and is not to be overwritten.
    """
    if request.lane is None:
        raise ValueError(
            "an alarm list needs `lane` (x_min, x_max, y_min, y_max), "
            f"got {request.lists[0]} without it"
        )
    refuse_links(request.output)
    entrants = find_entrants(request.lists, request.trial.recipes, request.reading)
    lanes = read_lanes(request.lane)
    rules = Rules(**request.rules)
    tables = _read_lists(entrants, lanes)
    targets, notes = open_truth(request, entrants, lanes, rules, tables)

    [table] = tables
    scored = score(table, targets, lanes, rules)
    only_far = _only_far(table, scored)
    if only_far and "far" not in request.rules:
        far_max = max(rules.far_max, only_far)  # the figures reach the only point
        rules = dataclasses.replace(rules, far=only_far, far_max=far_max)
        scored = score(table, targets, lanes, rules)
    reached = float(scored.curve["far"].max())
    name = request.lists[0].name
    tell_ranking_doubts(scored.matched, request.rules.get("far"), reached, name)

    files = score_files([scored], notes[0], title="Detection report")
    write_score_files(request.output, files, request.overwrite)
    return Scored(request.output, [scored])


def score_result(request: ScoreRequest, track: Track = silent) -> Scored:
    """Score a result by the rules of its recipe, and write the report.

    A lane in sections is scored as one. With ``score.area = "frames"`` in the recipe, score and
    report are of the alarms of every frame, see :func:`flgpr.scoring.score_frames`; the viewer
    shows those of the lane.

    Parameters
    ----------
    request : ScoreRequest
        The folder of a result, or of sections. Its recipe has the halo.
    track : Track
        Shows progress.

    Returns
    -------
    Scored
        The result, and a score for each of its detections.

    Raises
    ------
    ValueError
        If an input is not valid or altered, or the recipe is not registered; nothing is written.
    FileExistsError
        If another score is there and is not to be overwritten; nothing is written.
    """
    [folder] = request.lists
    homes = results_at(folder)
    is_whole = homes == [folder]
    result = read_result(folder) if is_whole else join_sections(folder, homes)
    refuse_links(request.output)
    objects = None if request.objects is None else read_table(request.objects, "objects")
    entrants = find_entrants(request.lists, request.trial.recipes)
    rules = Rules(**{**request.rules, "halo": result.recipe.score.halo})
    targets, [notes] = open_truth(request, entrants, result.lane, rules)

    of_lane = score_detections(result, targets, rules.far)
    scores = of_lane
    sections = {}
    if not is_whole:
        sections = {home.name: _page_address(home, request.output) for home in homes}
    page: Entries = {"result": result, "objects": objects, "sections": sections}
    if result.recipe.score.area == "frames":
        scores = [score_by_frames(result, targets, rules.far)]
        page = {"title": scores[0].title}

    files: dict[str, bytes | str] = {}
    # A single item: the bar shows that the report is being drawn.
    for _ in track(["report.html"], "drawing the report", 1):
        files |= score_files(scores, notes, **page)
    # The viewer shows a lane in one piece, and its alarms, whatever the report is of.
    if is_whole:
        files[VIEW_SCORE] = view_score(result, of_lane, objects)
    request.output.mkdir(parents=True, exist_ok=True)
    # A result states the digests of its files, those of a score inside it among them.
    if request.output.resolve() == folder.resolve():
        _add_to_result(folder, files, request.overwrite)
        return Scored(request.output, scores, read_result(folder))
    write_score_files(request.output, files, request.overwrite)
    return Scored(request.output, scores, result)


def compare_lists(request: ScoreRequest) -> SideBySide:
    """Compare two alarm lists or results, or more; write ``comparison.html`` and its JSON.

    Parameters
    ----------
    request : ScoreRequest
        The lists. By default the lane is that of the results, and the halo that of their recipes,
        of which there must be one.

    Returns
    -------
    SideBySide
        Points of each detector and differences of every two.

    Raises
    ------
    ValueError
        If lists cannot be compared, an input is not valid, or a register lacks a recipe.
    FileExistsError
        If another comparison is there and is not to be overwritten.
    """
    entrants = find_entrants(request.lists, request.trial.recipes, request.reading)
    lanes, rules = _common_lanes_and_rules(entrants, request)
    names = entrant_names(entrants)
    tables = _read_lists(entrants, lanes)
    targets, notes_of_lists = open_truth(request, entrants, lanes, rules, tables)

    scores = {}
    only_fars = set()
    for name, table in zip(names, tables, strict=True):
        scores[name] = score(table, targets, lanes, rules)
        only_fars.add(_only_far(table, scores[name]))
    first = scores[names[0]]
    common_fars = first.operating_points()["far_allowed"].tolist()
    # A list whose alarms rank equal has one operating point, which may lie between the usual ones.
    far_points = sorted({*common_fars, *only_fars} - {0.0})
    matches = {name: scored.matched for name, scored in scores.items()}
    comparison = side_by_side(matches, far_points, rules)

    stated_rules = {**first.rules_summary(), "far_max": rules.far_max}
    notes = dict(zip(names, notes_of_lists, strict=True))
    curves = {name: scored.curve for name, scored in scores.items()}
    page = comparison_html(comparison, curves, stated_rules, notes, as_lanes(lanes))
    files = {
        "comparison.html": page,
        "comparison.json": comparison_json(comparison, stated_rules, notes),
    }
    write_score_files(request.output, files, request.overwrite)
    return comparison


def _read_lists(entrants: Sequence[Entrant], lanes: LaneLike) -> list[pd.DataFrame]:
    """Read alarm lists, all of them before a truth is opened, and tell what is doubtful.

    The attribute ``outside`` of a table is for its report: how many alarms lie outside the lanes.
    """
    tables = [entrant.table() for entrant in entrants]
    for entrant, table in zip(entrants, tables, strict=True):
        table.attrs["outside"] = refuse_elsewhere(table, lanes, entrant.file)
        tell_doubts(table, "alarms", entrant.file, lanes)
    return tables


def open_truth(
    request: ScoreRequest,
    entrants: Sequence[Entrant],
    lanes: LaneLike,
    rules: Rules,
    tables: Sequence[pd.DataFrame] = (),
) -> tuple[pd.DataFrame, list[Entries]]:
    """Open a truth for alarm lists, by its register where it has one.

    Parameters
    ----------
    request : ScoreRequest
        The truth, the columns it has, and the register.
    entrants : sequence of Entrant
        The lists. All that may be wrong with them must be known: the opening is entered in the
        register.
    lanes : Lane or mapping of Lane by name
        Where alarms were searched.
    rules : Rules
        Halo and operating point.
    tables : sequence of pandas.DataFrame
        Alarms of lists that are of no result.

    Returns
    -------
    targets : pandas.DataFrame
        Those whose halos touch the lanes.
    notes : list of dict
        The notes of each list's report.

    Raises
    ------
    ValueError
        If the truth is not valid, or its register does not hold what it must.
    """
    package = installed_trials()
    if package is None:
        targets, notes = _open_without_register(request, entrants)
    else:
        entered = {"halo": rules.halo, "far": rules.far}
        targets, notes = package.open_truth(request, entrants, borders(lanes), entered)
    name = request.truth.name
    tell_doubts(targets, "truth", name, lanes)
    targets, outside = targets_in_reach(targets, lanes, rules.halo, name)
    for number, of_list in enumerate(notes):
        of_list |= outside
        if tables:
            alarms = tables[number].attrs
            read = {"alarms_read": alarms.get("notes"), "truth_read": targets.attrs.get("notes")}
            of_list |= {what: told for what, told in read.items() if told}
            of_list |= ranking_notes(tables[number]) | alarms["outside"]
        if request.card is not None:
            of_list |= request.card.notes(number, entrants[number])
    return targets, notes


def _open_without_register(
    request: ScoreRequest, entrants: Sequence[Entrant]
) -> tuple[pd.DataFrame, list[Entries]]:
    """Read a truth that has no register, and note the digests."""
    options = request.trial.options()
    if options:
        needed_trials(" and ".join(options))
    data = read_named(existing(request.truth, "truth file"))
    targets = parse_table(data, "truth", request.truth, request.truth_reading)
    if REGISTER_COLUMN in targets.columns:
        needed_trials(f"{request.truth}, which names a register")
    digest = {"truth_sha256": sha256(data)}
    return targets, [entrant.digests() | digest for entrant in entrants]


def _only_far(alarms: pd.DataFrame, scored: Score) -> float:
    """Return the false alarm rate of a list whose alarms rank equal, per m²; else 0."""
    if not alarms.attrs.get("unranked"):
        return 0.0
    return float(scored.curve["far"].iloc[-1])


def read_lanes(path: PathLike) -> Lane | dict[str, Lane]:
    """Read one lane or several from TOML or CSV; several come by name.

    TOML holds ``x_min``, ``x_max``, ``y_min``, ``y_max`` (m), or a table of these for each lane.
    CSV has these columns, a row for each lane, named in the column ``lane``. A file that holds no
    lanes is a ValueError.
    """
    path = existing(path, "lane file")
    with faults_of(path):
        if path.suffix.lower() == ".csv":
            lanes = as_lanes(read_columns(path, "lane"))
        else:
            lanes = as_lanes(parse_toml(read_named(path)))
    is_single = list(lanes) == [""]
    return lanes[""] if is_single else lanes


def borders(lanes: LaneLike) -> dict[str, dict[str, float]]:
    """Return the borders of each lane, m, by name, as registers hold them."""
    return {name: dataclasses.asdict(lane) for name, lane in as_lanes(lanes).items()}


def _add_to_result(folder: Path, files: Mapping[str, bytes | str], overwrite: bool) -> None:
    """Add the files of a score to the result itself, ``roc.json`` last."""
    ordered = with_last(files, "roc.json")
    has_other_files = must_write(folder, ordered, overwrite, last_file="roc.json")
    # Where adding them was interrupted before, files may be old although they look complete.
    if has_other_files or not are_settled(folder):
        add_files(folder, ordered)


def _page_address(section: Path, folder: Path) -> str:
    """Return the address of a section's page as seen from a folder; "" if it has none."""
    page = section / "report.html"
    if not page.is_file():
        return ""
    return Path(os.path.relpath(page, folder)).as_posix()


def _common_lanes_and_rules(
    entrants: Sequence[Entrant], request: ScoreRequest
) -> tuple[Lane | dict[str, Lane], Rules]:
    """Return the lanes and the rules by which lists are compared.

    Options count before what the results state; results that differ, or none, are a ValueError.
    """
    of_results = [_lane_and_halo(one.path.parent) for one in entrants if one.of_result]
    result_lanes = {lane for lane, _ in of_results}
    lanes: Lane | dict[str, Lane]
    if request.lane is not None:
        lanes = read_lanes(request.lane)
    elif len(result_lanes) == 1 and len(of_results) == len(entrants):
        [lanes] = result_lanes
    else:
        raise ValueError(
            "alarm lists need `lane` to be compared, and results one and the same; "
            f"got {len(result_lanes)} lanes"
        )

    halos = {request.rules["halo"]} if "halo" in request.rules else {halo for _, halo in of_results}
    if len(halos) > 1:
        raise ValueError(
            "halo must be given to compare results whose recipes have several, "
            f"got {sorted(halos)} m"
        )
    [halo] = halos or {Rules.halo}
    return lanes, Rules(**{**request.rules, "halo": halo})


def _lane_and_halo(folder: Path) -> tuple[Lane, float]:
    """Return the lane of a result, or of one in sections, and its recipe's halo, m."""
    first_result = read_result(results_at(folder)[0])
    lane = first_result.lane
    if Folder(folder).has(SECTIONS):
        lane = read_sections(folder).lane()
    return lane, first_result.recipe.score.halo

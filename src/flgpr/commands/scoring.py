"""Scoring against an open truth, of one detector or of several side by side: files in, files out.

A sealed truth is in :mod:`flgpr.commands.sealed_scoring`.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.commands.reach import targets_in_reach, tell_doubts
from flgpr.commands.registering import Entrant, find_entrant, open_registered_truth
from flgpr.commands.score_output import must_write, with_last, write_score_files
from flgpr.commands.trial_card import TrialCard, ranking_notes
from flgpr.door import Folder, read_named, refuse_links
from flgpr.model import Lane
from flgpr.model.faults import faults_of
from flgpr.progress import Track, silent
from flgpr.report import comparison_html, score_files
from flgpr.results.notebook_html import curve_html, outcomes_html
from flgpr.results.result import Result, add_files, are_settled, join_sections, read_result
from flgpr.results.score import (
    VIEW_SCORE,
    comparison_json,
    score_by_frames,
    score_detections,
    view_score,
)
from flgpr.results.sections import SECTIONS, read_sections, results_at
from flgpr.scoring import Rules, Score, SideBySide, as_lanes, side_by_side
from flgpr.scoring import score as score_list
from flgpr.scoring.matching import LaneLike
from flgpr.store import read_table
from flgpr.store.dialects import TableReading
from flgpr.store.files import existing
from flgpr.store.tables import read_columns
from flgpr.toml_text import parse_toml
from flgpr.trials.ledger import RegisterLike

PathLike = str | Path
_OUTCOME_COLUMNS = [
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


@dataclasses.dataclass(frozen=True)
class Scored:
    """The scores of a result or an alarm list, and where their report is."""

    folder: Path  #: with ``report.html`` and ``roc.json``
    scores: list[Score]  #: of each detection; of an alarm list a single one
    result: Result | None = None  #: the result that was scored
    source: Any = dataclasses.field(default=None, repr=False)  #: what was given to be scored

    def __iter__(self) -> Iterator[Any]:
        return iter((self.result, self.scores))

    def outcomes(self) -> pd.DataFrame:
        """Return what became of each target, see :func:`outcome_table`."""
        return outcome_table(self.scores)

    def _repr_html_(self) -> str:
        """Return the summary, the outcomes and a picture for a notebook."""
        main = self.scores[0]
        sentence = f"{main.name}: {main.in_words()}"
        outcomes = main.outcomes
        if self.result is None:
            return curve_html(sentence, outcomes, main.curve)
        return outcomes_html(sentence, outcomes, self.result.detections[0], self.result.lane)


def read_lanes(path: PathLike) -> Lane | dict[str, Lane]:
    """Read one lane or several from TOML or CSV; several come by name.

    TOML holds ``x_min``, ``x_max``, ``y_min``, ``y_max`` (m), or a table of these for each lane.
    CSV has these columns, a row for each lane, named in the column ``lane``. A file that holds no
    lanes is a ValueError.
    """
    path = existing(path, "lane file")
    with faults_of(path):
        if path.suffix.lower() == ".csv":
            lanes = as_lanes(read_columns(path))
        else:
            lanes = as_lanes(parse_toml(read_named(path)))
    is_single = list(lanes) == [""]
    return lanes[""] if is_single else lanes


def borders(lanes: LaneLike) -> dict[str, dict[str, float]]:
    """Return the borders of each lane, m, by name, as registers hold them."""
    return {name: dataclasses.asdict(lane) for name, lane in as_lanes(lanes).items()}


def score_result(
    folder: PathLike,
    truth: PathLike,
    objects: PathLike | None = None,
    output: PathLike | None = None,
    track: Track = silent,
    *,
    recipe: PathLike | None = None,
    register: RegisterLike | None = None,
    far: float = Rules.far,
    overwrite: bool = True,
    truth_reading: TableReading | None = None,
    card: TrialCard | None = None,
) -> tuple[Result, list[Score]]:
    """Score a result by the rules of its recipe, and write the report.

    A lane in sections is scored as one. With ``score.area = "frames"`` in the recipe, score and
    report are of the alarms of every frame, see :func:`flgpr.scoring.score_frames`; the viewer
    shows those of the lane.

    Parameters
    ----------
    folder : path
        Result folder, or folder of sections.
    truth : path
        Targets (CSV).
    objects : path, optional
        Other objects (CSV), for the pictures.
    output : path, optional
        Folder of the report, by default :func:`score_folder`.
    track : Track
        Shows progress.
    recipe, register : optional
        As for :func:`score_alarms`.
    far : float
        Operating point at which targets count as found or missed, per m².
    overwrite : bool
        Whether another score may be replaced.
    truth_reading : TableReading, optional
        Columns of the truth.
    card : TrialCard, optional
        What the report states of the trial.

    Returns
    -------
    result, scores
        The result, and a score for each of its detections.

    Raises
    ------
    ValueError
        If an input is not valid or altered, or the recipe is not registered; nothing is written.
    FileExistsError
        If another score is there and is not to be overwritten; nothing is written.
    """
    result_folder = Path(folder)
    lane_folders = results_at(result_folder)
    is_one_piece = lane_folders == [result_folder]
    result = _read_result(result_folder, lane_folders)

    target = score_folder(result_folder) if output is None else Path(output)
    refuse_links(target)
    other_objects = None if objects is None else read_table(objects, "objects")

    halo = result.recipe.score.halo
    rules = {"halo": halo, "far": far}
    entrant = find_entrant(result_folder, recipe)
    lane_borders = borders(result.lane)
    # After all that may be wrong: the opening is entered in the register.
    targets, [provenance] = open_registered_truth(
        truth, [entrant], lane_borders, rules, register, truth_reading
    )
    truth_name = Path(truth).name
    tell_doubts(targets, "truth", truth_name, result.lane)
    targets, outside = targets_in_reach(targets, result.lane, halo, truth_name)
    provenance |= outside
    if card is not None:
        provenance |= card.notes(0, entrant)

    of_lane = score_detections(result, targets, far)
    of_frames = []
    if result.recipe.score.area == "frames":
        of_frames.append(score_by_frames(result, targets, far))
    pages = {}
    if not is_one_piece:
        pages = {section.name: _page_address(section, target) for section in lane_folders}

    files: dict[str, bytes | str] = {}
    # A single item: the bar shows that the report is being drawn.
    for _ in track(["report.html"], "drawing the report", 1):
        if of_frames:
            files |= score_files(of_frames, provenance, title=of_frames[0].title)
        else:
            files |= score_files(
                of_lane,
                provenance,
                result=result,
                objects=other_objects,
                sections=pages,
            )
    # The viewer shows a lane in one piece, and its alarms, whatever the report is of.
    if is_one_piece:
        files[VIEW_SCORE] = view_score(result, of_lane, other_objects)

    scores = of_frames or of_lane
    target.mkdir(parents=True, exist_ok=True)
    # A result states the digests of its files, those of a score inside it among them.
    if target.resolve() == result_folder.resolve():
        _add_to_result(target, files, overwrite)
        return read_result(target), scores
    write_score_files(target, files, overwrite)
    return result, scores


def _read_result(folder: Path, lane_folders: Sequence[Path]) -> Result:
    """Read a result; the sections of a lane are joined."""
    if lane_folders == [folder]:
        return read_result(folder)
    return join_sections(folder, lane_folders)


def _add_to_result(folder: Path, files: Mapping[str, bytes | str], overwrite: bool) -> None:
    """Add the files of a score to the result itself, ``roc.json`` last."""
    ordered = with_last(files, "roc.json")
    has_other_files = must_write(folder, ordered, overwrite, last_file="roc.json")
    # Where adding them was interrupted before, files may be old although they look complete.
    if has_other_files or not are_settled(folder):
        add_files(folder, ordered)


def score_folder(folder: PathLike) -> Path:
    """Return where the score of a result is written by default.

    That is the result itself, or ``score`` in a folder of sections.
    """
    path = Path(folder)
    return path / "score" if Folder(path).has(SECTIONS) else path


def _page_address(section: Path, folder: Path) -> str:
    """Return the address of a section's page as seen from a folder; "" if it has none."""
    page = section / "report.html"
    if not page.is_file():
        return ""
    return Path(os.path.relpath(page, folder)).as_posix()


def score_alarms(
    alarms: PathLike,
    truth: PathLike,
    lane: PathLike,
    output: PathLike,
    *,
    recipe: PathLike | None = None,
    register: RegisterLike | None = None,
    title: str = "Detection report",
    overwrite: bool = True,
    reading: TableReading | None = None,
    truth_reading: TableReading | None = None,
    card: TrialCard | None = None,
    **rules: Any,
) -> list[Score]:
    """Score an alarm list of any detector and write the report.

    A list whose alarms rank equal has a single operating point, at its own false alarm rate:
    targets count as found there, unless ``far`` is given.

    Parameters
    ----------
    alarms, truth : path
        Alarm list and targets (CSV).
    lane : path
        Lane or lanes, see :func:`read_lanes`.
    output : path
        Folder of ``report.html``, ``roc.json`` and the figures as PNG and PDF.
    recipe : path, optional
        Recipe whose hash the register must hold before the truth is first opened.
    register : path or WitnessedRegister, optional
        Register of recipes and openings; the opening is entered there. A planned truth names its
        own.
    title : str
        Title of the report.
    overwrite : bool
        Whether another score may be replaced.
    reading, truth_reading : TableReading, optional
        Columns of the list and of the truth, and the anchor of their geographic positions.
    card : TrialCard, optional
        What the report states of the trial.
    **rules
        Fields of :class:`flgpr.scoring.Rules`.

    Returns
    -------
    list of Score
        A single score.

    Raises
    ------
    ValueError
        If an input is not valid, or the register does not hold the recipe.
    FileExistsError
        If another score is there and is not to be overwritten.
    """
    refuse_links(Path(output))
    entrant = find_entrant(alarms, recipe, reading)
    lanes = read_lanes(lane)
    score_rules = Rules(**rules)

    table = entrant.table()
    tell_doubts(table, "alarms", entrant.path.name, lanes)

    entered = {"halo": score_rules.halo, "far": score_rules.far}
    targets, [provenance] = open_registered_truth(
        truth, [entrant], borders(lanes), entered, register, truth_reading
    )
    truth_name = Path(truth).name
    tell_doubts(targets, "truth", truth_name, lanes)
    targets, outside = targets_in_reach(targets, lanes, score_rules.halo, truth_name)
    provenance |= outside

    provenance |= _reading_notes(table, targets)
    provenance |= ranking_notes(table)
    if card is not None:
        provenance |= card.notes(0, entrant)
    scored = score_list(table, targets, lanes, score_rules)
    only_far = _only_far(table, scored)
    if only_far and "far" not in rules:
        far_max = max(score_rules.far_max, only_far)  # the figures reach the only point
        rules_of_point = dataclasses.replace(score_rules, far=only_far, far_max=far_max)
        scored = score_list(table, targets, lanes, rules_of_point)
    scores = [scored]
    files = score_files(scores, provenance, title=title)
    write_score_files(Path(output), files, overwrite)
    return scores


def _only_far(alarms: pd.DataFrame, scored: Score) -> float:
    """Return the false alarm rate of a list whose alarms rank equal, per m²; else 0."""
    if not alarms.attrs.get("unranked"):
        return 0.0
    return float(scored.curve["far"].iloc[-1])


def _reading_notes(alarms: pd.DataFrame, truth: pd.DataFrame) -> dict[str, Any]:
    """Return what the reader of the tables assumed or converted, for the report."""
    notes_by_table = {}
    for name, table in (("alarms_read", alarms), ("truth_read", truth)):
        reading_notes = table.attrs.get("notes", [])
        if reading_notes:
            notes_by_table[name] = reading_notes
    return notes_by_table


def outcome_table(scored: Sequence[Score]) -> pd.DataFrame:
    """Return what became of each target, a row for each detection and target.

    Columns are detection, target_id, kind, depth (m), whether it is found at the operating point,
    whether any alarm detects it, and that alarm's far (per m²), rank, n_false and distance (m).
    """
    tables = []
    for score in scored:
        tables.append(score.outcomes[_OUTCOME_COLUMNS].assign(detection=score.name))
    return pd.concat(tables, ignore_index=True)


def compare_alarms(
    alarms: Sequence[PathLike],
    truth: PathLike,
    output: PathLike,
    lane: PathLike | None = None,
    *,
    recipes: Sequence[PathLike] = (),
    register: RegisterLike | None = None,
    halo: float | None = None,
    far: float = Rules.far,
    overwrite: bool = True,
    reading: TableReading | None = None,
    truth_reading: TableReading | None = None,
    card: TrialCard | None = None,
) -> SideBySide:
    """Compare two alarm lists or results, or more; write ``comparison.html`` and its JSON.

    Parameters
    ----------
    alarms : sequence of path
        Alarm lists (CSV) or result folders.
    truth : path
        Targets (CSV).
    output : path
        Folder of the page and ``comparison.json``.
    lane : path, optional
        Lane or lanes, see :func:`read_lanes`; by default that of the results, which must be one.
    recipes : sequence of path
        A recipe for each list, or none.
    register : path or WitnessedRegister, optional
        As for :func:`score_alarms`.
    halo : float, optional
        Halo radius, m; by default that of the results' recipes, which must be one.
    far : float
        Operating point beside the usual ones, per m².
    overwrite : bool
        Whether another comparison may be replaced.
    reading, truth_reading : TableReading, optional
        Columns of all lists, and of the truth.
    card : TrialCard, optional
        What the page states of the trial.

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
    entrants = find_entrants(alarms, recipes, reading)
    lanes, rules = _common_lanes_and_rules(entrants, lane, halo, far)
    names = entrant_names(entrants)
    # All lists are read before the truth is opened, which is entered in the register.
    tables = [entrant.table() for entrant in entrants]

    entered = {"halo": rules.halo, "far": far}
    targets, provenance = open_registered_truth(
        truth, entrants, borders(lanes), entered, register, truth_reading
    )

    for entrant, table in zip(entrants, tables, strict=True):
        tell_doubts(table, "alarms", entrant.path.name, lanes)
    tell_doubts(targets, "truth", Path(truth).name, lanes)
    targets, outside = targets_in_reach(targets, lanes, rules.halo, Path(truth).name)

    scores = {}
    provenance_by_name = {}
    only_fars = set()
    lists = zip(names, entrants, tables, provenance, strict=True)
    for number, (name, entrant, table, of_list) in enumerate(lists):
        scores[name] = score_list(table, targets, lanes, rules)
        only_fars.add(_only_far(table, scores[name]))
        notes = of_list | outside
        notes |= _reading_notes(table, targets)
        notes |= ranking_notes(table)
        if card is not None:
            notes |= card.notes(number, entrant)
        provenance_by_name[name] = notes

    first_score = scores[names[0]]
    common_fars = first_score.operating_points()["far_allowed"].tolist()
    # A list whose alarms rank equal has one operating point, which may lie between the usual ones.
    far_points = sorted({*common_fars, *only_fars} - {0.0})
    matches = {name: score.matched for name, score in scores.items()}
    comparison = side_by_side(matches, far_points, rules)

    curves = {name: score.curve for name, score in scores.items()}
    stated_rules = {**first_score.rules_summary(), "far_max": rules.far_max}
    write_comparison(
        output, comparison, curves, stated_rules, provenance_by_name, overwrite, as_lanes(lanes)
    )
    return comparison


def _common_lanes_and_rules(
    entrants: Sequence[Entrant], lane: PathLike | None, halo: float | None, far: float
) -> tuple[Lane | dict[str, Lane], Rules]:
    """Return the lanes and the rules by which lists are compared.

    Options count before what the results state; results that differ, or none, are a ValueError.
    """
    result_lanes = set()
    result_halos = set()
    count = 0
    for entrant in entrants:
        if entrant.of_result:
            result_lane, result_halo = _lane_and_halo(entrant.path.parent)
            result_lanes.add(result_lane)
            result_halos.add(result_halo)
            count += 1

    lanes: Lane | dict[str, Lane]
    if lane is not None:
        lanes = read_lanes(lane)
    elif len(result_lanes) == 1 and count == len(entrants):
        [lanes] = result_lanes
    else:
        raise ValueError(
            "alarm lists need --lane to be compared, and results one and the same; "
            f"got {len(result_lanes)} lanes"
        )

    halos = result_halos if halo is None else {halo}
    if len(halos) > 1:
        raise ValueError(
            "halo must be given to compare results whose recipes have several, "
            f"got {sorted(halos)} m"
        )
    [common_halo] = halos or {Rules.halo}
    return lanes, Rules(halo=common_halo, far=far)


def _lane_and_halo(folder: Path) -> tuple[Lane, float]:
    """Return the lane of a result, or of one in sections, and its recipe's halo, m."""
    first_folder = results_at(folder)[0]
    first_result = read_result(first_folder)
    lane = first_result.lane
    if Folder(folder).has(SECTIONS):
        lane = read_sections(folder).lane()
    return lane, first_result.recipe.score.halo


def find_entrants(
    alarms: Sequence[PathLike], recipes: Sequence[PathLike], reading: TableReading | None = None
) -> list[Entrant]:
    """Find the alarm lists that are compared.

    Parameters
    ----------
    alarms : sequence of path
        Alarm lists (CSV) or result folders.
    recipes : sequence of path
        A recipe for each list, or none.
    reading : TableReading, optional
        Columns of the lists.

    Returns
    -------
    list of Entrant
        List, recipe and model of each.

    Raises
    ------
    ValueError
        If there are recipes, but not one for each list, or one does not fit its list.
    """
    if recipes and len(recipes) != len(alarms):
        raise ValueError(
            f"recipe must be given once per alarm list, got {len(recipes)} for {len(alarms)} lists"
        )
    entrants = []
    for path, recipe in itertools.zip_longest(alarms, recipes):
        entrants.append(find_entrant(path, recipe, reading))
    return entrants


def entrant_names(entrants: Sequence[Entrant]) -> list[str]:
    """Name alarm lists by file or result folder, or by full paths where those are equal."""
    paths = [entrant.path for entrant in entrants]
    different_files = {path.resolve() for path in paths}
    if len(different_files) < len(paths):
        listed = ", ".join(map(str, paths))
        raise ValueError(f"alarms must be different lists to be compared, got {listed}")
    short_names = []
    for entrant in entrants:
        if entrant.of_result:
            short_names.append(entrant.path.parent.resolve().name)
        else:
            short_names.append(entrant.path.stem)
    if len(set(short_names)) == len(short_names):
        return short_names
    return [str(path) for path in paths]


def write_comparison(
    output: PathLike,
    comparison: SideBySide,
    curves: Mapping[str, pd.DataFrame],
    rules: Mapping[str, Any],
    provenance: Mapping[str, Any],
    overwrite: bool = True,
    lanes: Mapping[str, Lane] | None = None,
) -> None:
    """Write the page and the JSON of a comparison.

    Parameters
    ----------
    output : path
        The folder.
    comparison : SideBySide
        Points, pairs and means.
    curves : mapping of str to pandas.DataFrame
        ROC curves by list; empty where they are secret.
    rules : mapping
        Rules of the scores.
    provenance : mapping
        Provenance of every list.
    overwrite : bool
        Whether another comparison may be replaced.
    lanes : mapping of str to Lane, optional
        The lanes; none where they are secret.

    Raises
    ------
    FileExistsError
        If another comparison is there and is not to be replaced.
    """
    files = {
        "comparison.html": comparison_html(comparison, curves, rules, provenance, lanes),
        "comparison.json": comparison_json(comparison, rules, provenance),
    }
    write_score_files(Path(output), files, overwrite)

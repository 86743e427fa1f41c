"""The page of the reproduction: findings, tables and figures of the paper, and ours."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.detect import SearchStep
from flgpr.features import FEATURES
from flgpr.model import Sensor
from flgpr.progress import Track
from flgpr.recipe.schema import Recipe
from flgpr_papers.kit.cache import read_arrays
from flgpr_papers.kit.findings import SHARE, Finding, by_chance, spread
from flgpr_papers.kit.page import HEADER, Twin, draw, point_rows, study_html
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.kit.study_worlds import OtherWorld, StudyWorld
from flgpr_papers.wang2007.analysis import (
    AREA,
    BURIED_METAL,
    BURIED_PLASTIC,
    METHODS,
    MINES,
    SIMULANTS,
    SUBBANDS,
    LaneResult,
    Pool,
    all_forty,
    prescreened,
    table_one,
)
from flgpr_papers.wang2007.comparisons import retrainings
from flgpr_papers.wang2007.findings import SETS, Tables, all_findings
from flgpr_papers.wang2007.twins import Shown, drawings

Row = tuple[Any, ...]

PAPER: dict[str, dict[str, Any]] = tomllib.loads(packaged_text("wang2007", "paper"))


def page_html(
    folder: Path,
    calibration: Sequence[LaneResult],
    blind: Sequence[LaneResult],
    recipe: Recipe,
    radar: Sensor,
    quick: bool,
    track: Track,
    costs: pd.DataFrame,
    study_world: StudyWorld,
    other: OtherWorld,
) -> tuple[str, list[Finding]]:
    """Judge the findings and write the page, which needs no other file.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    calibration, blind : sequence of LaneResult
        Results of the lanes.
    recipe : Recipe
        Recipe of the study.
    radar : Sensor
        The array.
    quick : bool
        Whether the study is a quick run.
    track : Track
        Shows progress.
    costs : DataFrame
        As :func:`~flgpr_papers.wang2007.costs.cost_table` returns it.
    study_world : StudyWorld
        World of the lanes.
    other : OtherWorld
        Findings of the same study on roads as found.

    Returns
    -------
    html : str
        The page.
    findings : list of Finding
        The findings, in its order.
    """
    draws = 100 if quick else 1000
    findings, tables = all_findings(calibration, blind, recipe, draws)
    pool = tables.pool
    examples = read_arrays(folder / "results" / "examples.bundle")
    shown = Shown(recipe, radar, calibration, pool, examples, tables.blind)
    html = study_html(
        "wang2007.html",
        quick=quick,
        study_world=study_world,
        other=other,
        radar=radar,
        lanes=[_lane_row(result) for result in (*calibration, *blind)],
        found=findings,
        chance=by_chance(findings),
        header=HEADER,
        points=_point_rows(calibration, recipe, tables),
        retrained=_retrained_rows(pool, draws),
        features=list(FEATURES),
        numbered=[f"#{i + 1} {name}" for i, name in enumerate(FEATURES)],
        costs=_cost_rows(costs),
        singles=_single_rows(tables.by_band["F1"]),
        variants=_variant_rows(pool),
        bands=[(band, *_two_digits(table.loc["A"])) for band, table in tables.by_band.items()],
        searches=_search_rows(tables.searches),
        nested=_nested_search(pool, draws),
        sets=_set_rows(tables.sets),
        all_forty=[
            ("paper", *_steps(*PAPER["forty"]["steps"])),
            ("here", *_found_steps(tables.sets["all"])),
        ],
        twins=_twins(shown, quick, track),
    )
    return html, findings


def _point_rows(
    calibration: Sequence[LaneResult], recipe: Recipe, tables: Tables
) -> list[tuple[str, ...]]:
    """Tabulate Pd at the operating points, of prescreener and classifiers on all lanes."""
    pool = tables.pool
    matches = {"prescreener, HH F1": prescreened(calibration, "HH", "F1", recipe)}
    for name, columns in SETS.items():
        matches[f"{name}, calibration"] = pool.match_of(pool.confidence(list(columns), "C"))
    blind_matches = {f"{name}, blind": match for name, match in tables.blind.items()}
    subsets = {"buried metal": BURIED_METAL, "buried plastic": BURIED_PLASTIC, "mines": MINES}
    rows = point_rows(matches, subsets | {"simulants": SIMULANTS}, area=AREA)
    return rows + point_rows(blind_matches, subsets, area=AREA)


def _nested_search(pool: Pool, draws: int) -> dict[str, Any]:
    """Return PD_mean of nested searches in F1 with its interval, and the features chosen."""
    score, confidence, chosen = pool.nested(all_forty()[:10], 5)
    low, high = pool.interval(confidence, draws)
    sets = [", ".join(names) for names in chosen]
    return {"score": score, "low": low, "high": high, "chosen": "; ".join(sets)}


def _twins(shown: Shown, quick: bool, track: Track) -> list[Twin]:
    """Draw the figures of the paper from our lanes."""
    twins = []
    for drawing in track(drawings(shown), "drawing the page", 14):
        picture = draw(drawing.figure, quick, 100)
        twins.append(Twin(drawing.number, drawing.title, picture, drawing.caption, drawing.numbers))
    return twins


def _cost_rows(costs: pd.DataFrame) -> list[Row]:
    """Tabulate what each difference costs.

    There is a row per difference and kind of lanes, and a column per detector.
    """
    rows: list[Row] = []
    for (difference, lanes), of_difference in costs.groupby(["difference", "lanes"], sort=False):
        first = of_difference.iloc[0]
        change = f"{first['printed']} to {first['changed']}"
        cells = []
        for _, row in of_difference.iterrows():
            cells.append(f"{row['cost']:+z.3f} ({row['low']:+z.3f} to {row['high']:+z.3f})")
        alarms = f"{first['alarms']} and {first['alarms_changed']}"
        rows.append((difference, change, lanes, *cells, alarms))
    return rows


def _retrained_rows(pool: Pool, draws: int) -> list[Row]:
    """Tabulate PD_mean of both classifiers with two intervals.

    The first is over lanes and targets alone, the second with training in every draw.
    """
    rows = []
    for name, columns in SETS.items():
        for method in "AC":
            confidence = pool.confidence(list(columns), method)
            value = pool.scorer(confidence)
            low, high = pool.interval(confidence, draws)
            drawn = pool.retrained(list(columns), method, retrainings(draws))
            _, retrained_low, retrained_high = spread(value, drawn, bounds=SHARE)
            rows.append(
                (
                    name,
                    METHODS[method],
                    f"{value:.2f}",
                    f"{low:.2f} to {high:.2f}",
                    f"{retrained_low:.2f} to {retrained_high:.2f}",
                )
            )
    return rows


def _lane_row(result: LaneResult) -> Row:
    """Return the row of a lane: its length, mines and alarms."""
    length = result.lane.y_max - result.lane.y_min
    kinds = result.truth["kind"].value_counts()
    counts = [int(kinds.get(kind, 0)) for kind in ("metal", "plastic", "simulant")]
    surface = (result.truth["depth"] < 0).sum()
    alarms = len(result.alarms)
    # Alarms are raised on the run-view, which is 6 m wide.
    density = alarms / 6 / length
    return result.name, f"{length:.0f} m", *counts, surface, alarms, f"{density:.2f}"


def _two_digits(values: Any) -> list[str]:
    """Return values with two decimals."""
    return [f"{value:.2f}" for value in values]


def _steps(order: Iterable[int], score: Iterable[float]) -> list[str]:
    """Write the steps of a search as Table II does: the feature's number and the score with it."""
    return [f"({feature}) {value:.2f}" for feature, value in zip(order, score, strict=True)]


def _found_steps(search: Sequence[SearchStep]) -> list[str]:
    """Return the steps of a search of ours as Table II writes them."""
    return _steps([step.feature + 1 for step in search], [step.score for step in search])


def _single_rows(table: pd.DataFrame) -> list[Row]:
    """Tabulate single features by method, the paper's and ours (Table I)."""
    rows: list[Row] = []
    for method, meaning in METHODS.items():
        rows.append((f"({method}) {meaning}", "paper", *_two_digits(PAPER["singles"][method])))
        rows.append(("", "here", *_two_digits(table.loc[method])))
    return rows


def _search_rows(searches: Mapping[str, Sequence[SearchStep]]) -> list[Row]:
    """Tabulate searches by method, the paper's and ours (Table II)."""
    rows: list[Row] = []
    for method in METHODS:
        rows.append((f"({method})", "paper", *_steps(*PAPER["searches"][method])))
        rows.append(("", "here", *_found_steps(searches[method])))
    return rows


def _set_rows(sets: Mapping[str, Sequence[SearchStep]]) -> list[Row]:
    """Tabulate the best sets by sub-band, the paper's and ours."""
    rows = []
    for band in SUBBANDS:
        paper, score = PAPER["sets"][band]
        ours = ", ".join(str(step.feature + 1) for step in sets[band])
        rows.append((band, paper, f"{score:.2f}", ours, f"{sets[band][-1].score:.2f}"))
    return rows


def _variant_rows(pool: Pool) -> list[Row]:
    """Tabulate single features by other readings of the paper: regions and gain."""
    shared = pool.singles([f"shared.{name}_F1" for name in FEATURES[6:]], "A")
    return [
        ("as printed", *_two_digits(table_one(pool, "F1").loc["A"])),
        ("regions exchanged", *_two_digits(table_one(pool, "F1", "swapped.").loc["A"])),
        ("one gain for all polarizations, circular mean of psi", *[""] * 6, *_two_digits(shared)),
    ]

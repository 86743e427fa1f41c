"""The page of the reproduction: findings, tables and figures of the paper beside ours."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.chain.progress import Track
from flgpr.chain.recipe import Recipe
from flgpr.detect import SearchStep
from flgpr.features import FEATURES
from flgpr.model import Sensor
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
from flgpr_papers.wang2007.findings import SETS, all_findings
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
    """Judge the findings and write the page, which needs nothing beside it."""
    draws = 100 if quick else 1000
    findings, (pool, by_band, searches, sets, blind_matches) = all_findings(
        calibration, blind, recipe, draws
    )
    score, confidence, chosen = pool.nested(all_forty()[:10], 5)
    lists = {"prescreener, HH F1": prescreened(calibration, "HH", "F1", recipe)}
    lists |= {
        f"{name}, calibration": pool.match_of(pool.confidence(list(columns), "C"))
        for name, columns in SETS.items()
    }
    subsets = {"buried metal": BURIED_METAL, "buried plastic": BURIED_PLASTIC, "mines": MINES}
    points = point_rows(lists, subsets | {"simulants": SIMULANTS}, area=AREA)
    points += point_rows(
        {f"{name}, blind": entry for name, entry in blind_matches.items()}, subsets, area=AREA
    )
    low, high = pool.interval(confidence, draws)
    examples = read_arrays(folder / "results" / "examples.bundle")
    shown = Shown(recipe, radar, calibration, pool, examples, blind_matches)
    twins = [
        Twin(
            entry.number, entry.title, draw(entry.figure, quick, 100), entry.caption, entry.numbers
        )
        for entry in track(drawings(shown), "drawing the page", 14)
    ]
    html = study_html(
        "wang2007.html",
        quick=quick,
        study_world=study_world,
        other=other,
        radar=radar,
        lanes=[_lane_row(entry) for entry in (*calibration, *blind)],
        found=findings,
        chance=by_chance(findings),
        header=HEADER,
        points=points,
        retrained=_retrained_rows(pool, draws),
        features=list(FEATURES),
        numbered=[f"#{i + 1} {name}" for i, name in enumerate(FEATURES)],
        costs=_cost_rows(costs),
        singles=_single_rows(by_band["F1"]),
        variants=_variant_rows(pool),
        bands=[(band, *_two_digits(table.loc["A"])) for band, table in by_band.items()],
        searches=_search_rows(searches),
        nested={
            "score": score,
            "low": low,
            "high": high,
            "chosen": "; ".join(map(", ".join, chosen)),
        },
        sets=_set_rows(sets),
        all_forty=[
            ("paper", *_steps(*PAPER["forty"]["steps"])),
            ("here", *_found_steps(sets["all"])),
        ],
        twins=twins,
    )
    return html, findings


def _cost_rows(costs: pd.DataFrame) -> list[Row]:
    """Tabulate what each difference costs.

    A row per difference and kind of lanes, a column per detector.
    """
    rows: list[Row] = []
    for (entry, where), rows_of_entry in costs.groupby(["difference", "lanes"], sort=False):
        first_row = rows_of_entry.iloc[0]
        cells = [
            f"{row['cost']:+z.3f} ({row['low']:+z.3f} to {row['high']:+z.3f})"
            for _, row in rows_of_entry.iterrows()
        ]
        alarms = f"{first_row['alarms']} and {first_row['alarms_changed']}"
        rows.append(
            (entry, f"{first_row['printed']} to {first_row['changed']}", where, *cells, alarms)
        )
    return rows


def _retrained_rows(pool: Pool, draws: int) -> list[Row]:
    """Return PD_mean of both classifiers with its intervals.

    They are of lanes and targets alone, and with training in every draw.
    """
    rows = []
    for name, columns in SETS.items():
        for method in "AC":
            confidence = pool.confidence(list(columns), method)
            value = pool.scorer(confidence)
            narrow = pool.interval(confidence, draws)
            _, low, high = spread(
                value, pool.retrained(list(columns), method, retrainings(draws)), bounds=SHARE
            )
            cells = (f"{a:.2f} to {b:.2f}" for a, b in (narrow, (low, high)))
            rows.append((name, METHODS[method], f"{value:.2f}", *cells))
    return rows


def _lane_row(result: LaneResult) -> Row:
    """Return the row of a lane: its length, mines and alarms."""
    length = result.lane.y_max - result.lane.y_min
    count = ((result.truth["kind"] == kind).sum() for kind in ("metal", "plastic", "simulant"))
    surface = (result.truth["depth"] < 0).sum()
    alarms = len(result.alarms)
    return result.name, f"{length:.0f} m", *count, surface, alarms, f"{alarms / 6 / length:.2f}"


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

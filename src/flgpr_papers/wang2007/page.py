"""What the page says beside findings and figures: facts and tables."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.design.point_spread import PointSpread
from flgpr.detect import SearchStep
from flgpr.features import FEATURES
from flgpr.method.classifier import count_mines, make_training_set
from flgpr.model import Sensor
from flgpr.recipe.schema import Recipe
from flgpr.scoring import Match, pd_mean, roc_of
from flgpr_papers.kit.cache import Arrays
from flgpr_papers.kit.intervals import SHARE, spread
from flgpr_papers.kit.page import HEADER, detections_at, point_rows
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.wang2007.analysis import (
    AREA,
    BANDS,
    BURIED_METAL,
    BURIED_PLASTIC,
    METHODS,
    MINES,
    POLARIZATIONS,
    SIMULANTS,
    SUBBANDS,
    LaneResult,
    Pool,
    all_forty,
    clutter_levels,
)
from flgpr_papers.wang2007.comparisons import retrainings
from flgpr_papers.wang2007.findings import SETS, Tables

Row = tuple[Any, ...]
PAPER: dict[str, dict[str, Any]] = tomllib.loads(packaged_text("wang2007", "paper"))


@dataclass(frozen=True)
class Measured:
    """What the study has measured, for its figures and its page."""

    recipe: Recipe  #: recipe of the study
    radar: Sensor  #: the array
    calibration: Sequence[LaneResult]  #: results of the calibration lanes
    blind: Sequence[LaneResult]  #: results of the blind lanes
    tables: Tables  #: what the statements are judged by
    examples: Arrays  #: scan images and patches of Figs. 2-5, 8 and 10
    costs: pd.DataFrame  #: as :func:`~flgpr_papers.wang2007.costs.cost_table` returns it
    draws: int  #: number of bootstrap draws


def page_facts(measured: Measured) -> dict[str, Any]:
    """Return what the captions and their numbers take."""
    recipe = measured.recipe
    radar = measured.radar
    calibration = measured.calibration
    examples = measured.examples
    image = recipe.image
    tones = radar.tones.axis()
    middle = float(np.mean(image.y))
    resolution = {}
    for name in BANDS:
        response = PointSpread(radar, image.subbands[name], image.window)
        resolution[name] = 100 * response.widths((0.0, middle, 0.0))[0]
    steps = np.abs(np.diff(examples["series_place"][:, 1]))
    median, mean, step = recipe.smoothing
    known = make_training_set([result.training for result in calibration], columns=["M_HH_F1"])
    false_alarms = int((measured.tables.pool.labels["label"] == "false").sum())
    mines = count_mines(result.truth for result in calibration)
    return {
        "recipe": recipe,
        "radar": radar,
        "image": image,
        "tones": tones,
        "transmitters": len(radar.tx),
        "receivers": len(radar.rx),
        "tilt": np.degrees(radar.tilt),
        "first": tones[0] / 1e6,
        "last": tones[-1] / 1e9,
        "width": np.ptp(image.x),
        "example": dict(zip(examples["names"], examples["titles"], strict=True)),
        "middle": middle,
        "resolution": resolution,
        "shortest": steps.min(),
        "longest": steps.max(),
        "likeness": likeness(examples["series"]),
        "median": median,
        "mean": mean,
        "every": "" if step == 1 else f", at every {step}th both ways",
        "view_width": np.ptp(recipe.run_view.x),
        "pixel": 100 * recipe.run_view.spacing,
        "patch_pixel": 100 * recipe.contrast.spacing,
        "false_per_mine": false_alarms / max(mines, 1),
        "training": known.weight.size,
        "duplicated": known.weight.sum(),
        **_alarm_facts(measured),
    }


def _alarm_facts(measured: Measured) -> dict[str, Any]:
    """Return what the captions say of clutter, alarms and Pd."""
    recipe = measured.recipe
    calibration = measured.calibration
    tables = measured.tables
    area = sum(np.ptp(recipe.run_view.x) * result.length for result in calibration)
    alarms = sum(len(result.alarms) for result in calibration)
    levels = clutter_levels(calibration)
    clutter = {}
    pd_means = {}
    for name in POLARIZATIONS:
        clutter[name] = ", ".join(f"{band} {levels[f'{name} {band}'].mean():.1f}" for band in BANDS)
        texts = []
        for band in BANDS:
            curve = roc_of(tables.channels[name, band], MINES, area=AREA)
            texts.append(f"{band} {pd_mean(curve):.2f}")
        pd_means[name] = ", ".join(texts)
    contrast = tables.pool.match_of(tables.pool.confidence(SETS["A"], "A"))
    pds = {}
    for far in (0.02, 0.07):
        pds[f"plastic {far}"] = _pd(contrast, BURIED_PLASTIC, far)
        pds[f"simulants {far}"] = _pd(contrast, SIMULANTS, far)
    for name, match in tables.blind.items():
        pds[f"{name} metal"] = _pd(match, BURIED_METAL, 0.01)
        pds[f"{name} plastic"] = _pd(match, BURIED_PLASTIC, 0.05)
    return {
        "density": alarms * np.pi * recipe.prescreen.radius**2 / area,
        "clutter": clutter,
        "pd_mean": pd_means,
        "prescreened": _pd(tables.channels["HH", "F1"], MINES, 0.15),
        "pd": pds,
    }


def likeness(series: NDArray[Any]) -> float:
    """Return the mean correlation of neighbouring images of a series, of their levels in dB.

    Parameters
    ----------
    series : (image, y, x) ndarray
        Magnitudes.
    """
    levels = np.log(np.maximum(series.reshape(len(series), -1).astype(np.float64), 1e-30))
    return float(np.mean([np.corrcoef(first, second)[0, 1] for first, second in pairwise(levels)]))


def _pd(matched: Match, subset: Any, far: float) -> str:
    """Write a Pd as counts, with the chance level."""
    n_found, targets, by_chance = detections_at(matched, subset, far, area=AREA)
    return f"{n_found} of {targets}, chance {by_chance:.0%}"


def page_tables(measured: Measured) -> dict[str, Any]:
    """Return what the template of the page takes."""
    tables = measured.tables
    draws = measured.draws
    pool = tables.pool
    score, confidence, chosen = pool.nested(all_forty()[:10], 5)
    low, high = pool.interval(confidence, draws)
    singles: list[Row] = []
    searches: list[Row] = []
    for method, meaning in METHODS.items():
        ours = tables.by_band["F1"].loc[method]
        singles.append((f"({method}) {meaning}", "paper", *_digits(PAPER["singles"][method])))
        singles.append(("", "here", *_digits(ours)))
        searches.append((f"({method})", "paper", *_steps(*PAPER["searches"][method])))
        searches.append(("", "here", *_found_steps(tables.searches[method])))
    sets = []
    for band in SUBBANDS:
        paper, paper_score = PAPER["sets"][band]
        found = tables.sets[band]
        features = ", ".join(str(step.feature + 1) for step in found)
        sets.append((band, paper, f"{paper_score:.2f}", features, f"{found[-1].score:.2f}"))
    shared = pool.singles([f"shared.{name}_F1" for name in FEATURES[6:]], "A")
    swapped = pool.singles([f"swapped.{name}_F1" for name in FEATURES], "A")
    return {
        "radar": measured.radar,
        "lanes": [_lane_row(one) for one in (*measured.calibration, *measured.blind)],
        "header": HEADER,
        "points": _point_rows(tables),
        "retrained": _retrained_rows(pool, draws),
        "features": list(FEATURES),
        "numbered": [f"#{i + 1} {name}" for i, name in enumerate(FEATURES)],
        "costs": _cost_rows(measured.costs),
        "singles": singles,
        "variants": [
            ("as printed", *_digits(tables.by_band["F1"].loc["A"])),
            ("regions exchanged", *_digits(swapped)),
            (
                "one gain for all polarizations, circular mean of psi",
                *[""] * 6,
                *_digits(shared),
            ),
        ],
        "bands": [(band, *_digits(table.loc["A"])) for band, table in tables.by_band.items()],
        "searches": searches,
        "nested": {
            "score": score,
            "low": low,
            "high": high,
            "chosen": "; ".join(", ".join(names) for names in chosen),
        },
        "sets": sets,
        "all_forty": [
            ("paper", *_steps(*PAPER["forty"]["steps"])),
            ("here", *_found_steps(tables.sets["all"])),
        ],
    }


def _point_rows(tables: Tables) -> list[tuple[str, ...]]:
    """Tabulate Pd at the operating points, of prescreener and classifiers on all lanes."""
    pool = tables.pool
    matches = {"prescreener, HH F1": tables.channels["HH", "F1"]}
    for name, columns in SETS.items():
        matches[f"{name}, calibration"] = pool.match_of(pool.confidence(columns, "C"))
    blind_matches = {f"{name}, blind": match for name, match in tables.blind.items()}
    subsets: Mapping[str, Any]
    subsets = {"buried metal": BURIED_METAL, "buried plastic": BURIED_PLASTIC, "mines": MINES}
    rows = point_rows(matches, {**subsets, "simulants": SIMULANTS}, area=AREA)
    return rows + point_rows(blind_matches, subsets, area=AREA)


def _cost_rows(costs: pd.DataFrame) -> list[Row]:
    """Tabulate what each difference costs.

    There is a row per difference and kind of lanes, and a column per detector.
    """
    rows: list[Row] = []
    for (difference, lanes), of_difference in costs.groupby(["difference", "lanes"], sort=False):
        first = of_difference.iloc[0]
        cells = []
        for row in of_difference.itertuples():
            cells.append(f"{row.cost:+z.3f} ({row.low:+z.3f} to {row.high:+z.3f})")
        change = f"{first['printed']} to {first['changed']}"
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
            confidence = pool.confidence(columns, method)
            value = pool.scorer(confidence)
            drawn = pool.retrained(columns, method, retrainings(draws))
            intervals = [pool.interval(confidence, draws), spread(value, drawn, bounds=SHARE)[1:]]
            texts = [f"{low:.2f} to {high:.2f}" for low, high in intervals]
            rows.append((name, METHODS[method], f"{value:.2f}", *texts))
    return rows


def _lane_row(result: LaneResult) -> Row:
    """Return the row of a lane: its length, mines and alarms."""
    kinds = result.truth["kind"].value_counts()
    counts = [int(kinds.get(kind, 0)) for kind in ("metal", "plastic", "simulant")]
    surface = (result.truth["depth"] < 0).sum()
    alarms = len(result.alarms)
    # Alarms are raised on the run-view, which is 6 m wide.
    density = f"{alarms / 6 / result.length:.2f}"
    return result.name, f"{result.length:.0f} m", *counts, surface, alarms, density


def _digits(values: Any) -> list[str]:
    """Return values with two decimals."""
    return [f"{value:.2f}" for value in values]


def _steps(order: Iterable[int], score: Iterable[float]) -> list[str]:
    """Write the steps of a search as Table II does: the feature's number and the score with it."""
    return [f"({feature}) {value:.2f}" for feature, value in zip(order, score, strict=True)]


def _found_steps(search: Sequence[SearchStep]) -> list[str]:
    """Return the steps of a search of ours as Table II writes them."""
    return _steps([step.feature + 1 for step in search], [step.score for step in search])

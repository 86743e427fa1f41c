"""What the page says beside findings and figures: facts and tables."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.design.point_spread import PointSpread
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
    LaneResult,
    Pool,
    all_forty,
    clutter_levels,
)
from flgpr_papers.wang2007.comparisons import retrainings
from flgpr_papers.wang2007.findings import SETS, Tables


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
    pool = tables.pool
    score, confidence, chosen = pool.nested(all_forty()[:10], 5)
    low, high = pool.interval(confidence, measured.draws)
    costs = measured.costs.groupby(["difference", "lanes"], sort=False)
    return {
        "radar": measured.radar,
        "lanes": [*measured.calibration, *measured.blind],
        "header": HEADER,
        "points": _point_rows(tables),
        "retrained": _retrained(pool, measured.draws),
        "methods": METHODS,
        "features": list(FEATURES),
        "numbered": [f"#{number} {name}" for number, name in enumerate(FEATURES, start=1)],
        "printed": tomllib.loads(packaged_text("wang2007", "paper")),
        "tables": tables,
        "swapped": pool.singles([f"swapped.{name}_F1" for name in FEATURES], "A"),
        "shared": pool.singles([f"shared.{name}_F1" for name in FEATURES[6:]], "A"),
        "costs": [of_difference.to_dict("records") for _, of_difference in costs],
        "nested": {
            "score": score,
            "low": low,
            "high": high,
            "chosen": "; ".join(", ".join(names) for names in chosen),
        },
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


def _retrained(pool: Pool, draws: int) -> list[tuple[Any, ...]]:
    """Return PD_mean of both classifiers by methods A and C, with two intervals.

    The first is over lanes and targets alone, the second with training in every draw.
    """
    rows = []
    for (name, columns), method in product(SETS.items(), "AC"):
        confidence = pool.confidence(columns, method)
        value = pool.scorer(confidence)
        drawn = pool.retrained(columns, method, retrainings(draws))
        anew = spread(value, drawn, bounds=SHARE)[1:]
        rows.append((name, METHODS[method], value, pool.interval(confidence, draws), anew))
    return rows

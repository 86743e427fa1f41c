"""Which worlds give which Pd: the designed fraction, a lane each, and the effects of its axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize
from scipy.special import expit

from worlds.design import marginal_row, model_matrix, term_columns
from worlds.effects import Fit, fit_means, fit_shares
from worlds.lanes import FAR, KINDS, LaneJob, declared_lane, lane_table
from worlds.space import AXES, DECLARED, design_worlds

FloatArray = NDArray[np.float64]
CROSSED: tuple[str, str] = tuple(DECLARED["design"]["crossed"])
"""The two axes whose interaction is in the model."""


def jobs() -> list[LaneJob]:
    """List the lanes of the designed fraction."""
    lane_jobs = []
    for world in design_worlds():
        about = {"number": world.number, **{axis: getattr(world, axis) for axis in AXES}}
        about |= {"replicate": world.replicate}
        job = declared_lane(
            "detection", world.name, about, world.tables(), world.number, world.mines
        )
        lane_jobs.append(job)
    return lane_jobs


def tables(targets: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return every target and world, what the axes do, and what is missing, by file name.

    Missing are decibels of plastic mines, for the Pd of the paper.
    """
    lanes = lane_table(targets, ["number", *AXES, "replicate", "lane"])
    return {
        "detection-mines": targets.drop(columns=["nearest", "farthest"]),
        "detection": lanes,
        "detection-effects": effects(lanes),
        "detection-missing": missing_decibels(targets),
    }


def missing_decibels(targets: pd.DataFrame) -> pd.DataFrame:
    """Return by how many decibels plastic mines miss what the paper finds, cell by cell.

    One curve gives the chance that a plastic mine is found by its signal to clutter x, fitted to
    all targets of all worlds: ``P(x) = c + (1 - c)·σ(a + b·x)`` with the chance level c of the
    target's lane and the logistic function σ. In a cell the signal to clutter of all its plastic
    mines is raised until the mean of P is the paper's Pd.

    Parameters
    ----------
    targets : DataFrame
        ``detection-mines.csv``: a row per target.

    Returns
    -------
    DataFrame
        A row per false alarm rate and cell of the two crossed axes: ``far``, per m²; the two axes;
        ``targets``, their number; ``is_found``, the share found; ``paper``, the paper's Pd;
        ``missing_db``, dB, below zero where more is found than in the paper. Empty while mines are
        not found the better, the higher their signal to clutter.
    """
    plastic = targets[(targets["kind"] == "plastic") & np.isfinite(targets["ratio_db"])]
    rows = []
    for far, paper in zip(FAR, DECLARED["paper"]["plastic"], strict=True):
        is_found = (plastic["far"] <= far).to_numpy()
        if is_found.all() or not is_found.any():
            return pd.DataFrame()
        chance = plastic[f"chance_{far:g}"].to_numpy()
        curve = fit_found_curve(plastic["ratio_db"].to_numpy(), is_found, chance)
        if curve.slope <= 0:
            return pd.DataFrame()
        for cell_key, cell in plastic.groupby(list(CROSSED)):
            missing = curve.raise_to(
                cell["ratio_db"].to_numpy(), cell[f"chance_{far:g}"].to_numpy(), paper
            )
            row = {"far": far, **dict(zip(CROSSED, cell_key, strict=True)), "targets": len(cell)}
            row |= {
                "found": float((cell["far"] <= far).mean()),
                "paper": paper,
                "missing_db": missing,
            }
            rows.append(row)
    return pd.DataFrame(rows)


@dataclass(frozen=True)
class FoundCurve:
    """Chance that a mine is found over its signal to clutter, above what is found by chance."""

    start: float  #: logit at 0 dB
    slope: float  #: of the logit, per dB

    def shares(self, ratio_db: FloatArray, chance: FloatArray) -> FloatArray:
        """Compute the probability to be found by signal to clutter (dB) and by chance."""
        by_signal = expit(self.start + self.slope * ratio_db)
        return np.asarray(chance + (1 - chance) * by_signal)

    def raise_to(self, ratio_db: FloatArray, chance: FloatArray, share: float) -> float:
        """Compute by how many dB all targets must rise for a wanted mean chance to be found."""

        def excess(rise: float) -> float:
            return float(self.shares(ratio_db + rise, chance).mean()) - share

        widest = float(np.abs(ratio_db).max()) + (abs(self.start) + 20) / self.slope
        return float(brentq(excess, -widest, widest))


def fit_found_curve(
    ratio_db: FloatArray, is_found: NDArray[np.bool_], chance: FloatArray
) -> FoundCurve:
    """Fit the curve by maximum likelihood.

    Parameters
    ----------
    ratio_db : (target,) ndarray
        Signal to clutter, dB.
    is_found : (target,) ndarray of bool
        Whether each target is found.
    chance : (target,) ndarray
        Probability that each would be found without its echo.
    """

    def misfit(parameters: FloatArray) -> float:
        shares = FoundCurve(*parameters).shares(ratio_db, chance)
        shares = np.clip(shares, 1e-12, 1 - 1e-12)
        return -float(np.where(is_found, np.log(shares), np.log(1 - shares)).sum())

    start, slope = minimize(misfit, np.array([-1.0, 0.3]), method="Nelder-Mead").x
    return FoundCurve(float(start), float(slope))


def effects(table: pd.DataFrame) -> pd.DataFrame:
    """Estimate what every level of every axis gives, the other axes in their middle.

    Parameters
    ----------
    table : DataFrame
        ``detection.csv``: a row per world.

    Returns
    -------
    DataFrame
        ``response``: "metal 0.02", Pd of a kind at so many false alarms per m², or "metal
        ratio_db", its mean signal to clutter, dB. ``axis`` and ``level``; for the two crossed axes
        also rows with both, "roughness x permittivity" and "2.0 x 4.5". ``value``, ``low``,
        ``high``: the response with its 95 % interval, a Pd as the inverse logit of a mean of
        logits. ``difference`` from the first level, with ``difference_low`` and ``difference_high``
        (empty for cells). ``p`` of all levels of the axis being alike. ``worlds`` that have the
        level. ``dispersion``, see :class:`~worlds.effects.Fit`. Empty if the worlds
        are too few to tell the effects apart.
    """
    rows = []
    for kind in KINDS:
        # Only plastic mines depend on the mix that stands for them.
        axes = {
            axis: levels for axis, levels in AXES.items() if axis != "mines" or kind == "plastic"
        }
        matrix = model_matrix(table, axes, [CROSSED])
        try:
            fits = {}
            for far in FAR:
                fits[f"{kind} {far:g}"] = fit_shares(
                    matrix, table[f"{kind}_{far:g}"], table[f"{kind}_targets"]
                )
            fits[f"{kind} ratio_db"] = fit_means(matrix, table[f"{kind}_ratio_db"])
        except ValueError:
            return pd.DataFrame()
        for response, fit in fits.items():
            rows += _level_rows(response, fit, axes, table) + _cell_rows(response, fit, axes, table)
    return pd.DataFrame(rows)


def _level_rows(
    response: str, fit: Fit, axes: dict[str, list[object]], table: pd.DataFrame
) -> list[dict[str, object]]:
    """Tabulate every level of every axis, and its difference from the axis's first."""
    rows = []
    places = term_columns(axes, [CROSSED])
    for axis, levels in axes.items():
        p = fit.p_value(places[axis,])
        first = marginal_row({axis: levels[0]}, axes, [CROSSED])
        for level in levels:
            row = marginal_row({axis: level}, axes, [CROSSED])
            value, low, high = fit.value(row)
            gap, gap_low, gap_high = fit.difference(row, first)
            rows.append(
                {
                    "response": response,
                    "axis": axis,
                    "level": level,
                    "value": value,
                    "low": low,
                    "high": high,
                    "difference": gap,
                    "difference_low": gap_low,
                    "difference_high": gap_high,
                    "p": p,
                    "worlds": int((table[axis] == level).sum()),
                    "dispersion": fit.dispersion,
                }
            )
    return rows


def _cell_rows(
    response: str, fit: Fit, axes: dict[str, list[object]], table: pd.DataFrame
) -> list[dict[str, object]]:
    """Tabulate every cell of the two crossed axes."""
    rows = []
    first, second = CROSSED
    p = fit.p_value(term_columns(axes, [CROSSED])[CROSSED])
    for level in axes[first]:
        for other in axes[second]:
            row = marginal_row({first: level, second: other}, axes, [CROSSED])
            value, low, high = fit.value(row)
            inside = (table[first] == level) & (table[second] == other)
            rows.append(
                {
                    "response": response,
                    "axis": f"{first} x {second}",
                    "level": f"{level} x {other}",
                    "value": value,
                    "low": low,
                    "high": high,
                    "p": p,
                    "worlds": int(inside.sum()),
                    "dispersion": fit.dispersion,
                }
            )
    return rows

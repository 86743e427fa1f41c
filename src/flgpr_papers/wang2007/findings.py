"""What Wang et al. 2007 found, and whether simulated lanes show it too.

A claim that something is larger agrees if the 95 % interval of the difference lies above zero, disagrees if it lies
below, and is undecided otherwise. A figure of the paper agrees if it lies in the 95 % interval of ours. The rules were
fixed before the lanes were run, and nothing is adjusted by the outcome.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import mannwhitneyu

from flgpr.chain.recipe import Recipe
from flgpr.detect import SearchStep
from flgpr.features import FEATURES
from flgpr.scoring import Match, clopper_pearson, compare, operating_row, roc_of
from flgpr_papers.kit.findings import AGREES, DISAGREES, UNDECIDED, Finding, larger, within
from flgpr_papers.wang2007.analysis import (
    BURIED_PLASTIC,
    MINES,
    SIMULANTS,
    SUBBANDS,
    LaneResult,
    Pool,
    prescreened,
)

FloatArray = NDArray[np.float64]


def all_of(verdicts: Sequence[str]) -> str:
    """Judge a claim that holds only if all its parts do.

    Disagrees if one part does, agrees if all do.
    """
    if DISAGREES in verdicts:
        return DISAGREES
    return AGREES if all(one == AGREES for one in verdicts) else UNDECIDED


def detections_at(matched: Match, subset: Any, far: float) -> tuple[int, int, float, float]:
    """Count the targets found at an allowed FAR (per m²), and all; with the exact 95 % interval of Pd."""
    row = roc_of(matched, subset).iloc[int(operating_row(roc_of(matched, subset), far))]
    found, targets = int(row["n_detected"]), int(row["n_targets"])
    low, high = clopper_pearson(found, targets)
    return found, targets, float(low), float(high)


def prescreener_findings(results: Sequence[LaneResult], recipe: Recipe, draws: int) -> list[Finding]:
    """Judge the findings about sub-bands at the prescreener stage (the paper's Sec. II-C and Fig. 9)."""
    of = {(p, b): prescreened(results, p, b, recipe) for p in ("HH", "VV", "HV") for b in ("F0", *SUBBANDS)}
    best = [_compare(of["HH", "F1"], of["HH", b], draws) for b in SUBBANDS[1:]]
    found = [
        Finding(
            "The lowest sub-band F1 is best for the prescreener (HH)", "F1 > F2, F3, F4 (Fig. 9)",
            _differences(best, [f"F1 - {b}" for b in SUBBANDS[1:]]), all_of([larger(c.low, c.high) for c in best]),
            "PD_mean of actual mines; simulants and alarms outside the lane are left out.",
        )
    ]  # fmt: skip
    for p in ("HH", "VV", "HV"):
        steps = [_compare(of[p, a], of[p, b], draws) for a, b in pairwise(SUBBANDS)]
        names = [f"{a} - {b}" for a, b in pairwise(SUBBANDS)]
        verdict = all_of([larger(c.low, c.high) for c in steps])
        found.append(
            Finding(f"Pd falls from F1 to F4 in {p}", "each lower (Fig. 9)", _differences(steps, names), verdict)
        )
    n, of_all, low, high = detections_at(of["HH", "F1"], MINES, 0.15)
    found.append(
        Finding(
            "HH F1 reaches 100 % at FAR <= 0.15 per m²", "100 %", _share(n, of_all, low, high), within(1.0, low, high)
        )
    )
    thesis = _compare(of["HH", "F1"], of["HH", "F0"], draws)
    found.append(
        Finding(
            "The narrow F1 beats the wide F0 at the prescreener (the paper's thesis)", "F1 chosen over F0",
            _differences([thesis], ["F1 - F0"]), larger(thesis.low, thesis.high),
        )
    )  # fmt: skip
    wide = _compare(of["HH", "F1"], prescreened(results, "HH", "wide", recipe), draws)
    found.append(
        Finding(
            "Y_max = 16 m beats the full range", "better detection with Y_max = 16 m",
            _differences([wide], ["16 m - 26 m"]), larger(wide.low, wide.high),
        )
    )  # fmt: skip
    return found


def feature_findings(
    pool: Pool, singles: pd.DataFrame, searches: dict[str, list[SearchStep]], draws: int
) -> list[Finding]:
    """Judge the findings about single features and their combinations (the paper's Tables I and II)."""
    a, c = ({name: float(singles[name][m]) for name in FEATURES} for m in "AC")
    b = {name: float(singles[name]["B"]) for name in FEATURES}
    best = max(a, key=lambda name: a[name])
    low, high = pool.interval(pool.confidence(["C_HH_F1"], "A"), draws)
    contrast = pool.match_of(pool.confidence(["C_HH_F1"], "A"))
    energy = _compare(contrast, pool.match_of(pool.magnitude()), draws)
    rivals = []
    for name in FEATURES:
        if name != "C_HH":
            rivals.append(_compare(contrast, pool.match_of(pool.confidence([f"{name}_F1"], "A")), draws))
    others = [name for name in FEATURES if name != "C_HH"]
    closest = int(np.argmin([c.difference for c in rivals]))
    found = [
        Finding(
            "C_HH is the best single feature", "PD_mean 0.93",
            f"best is {best}; C_HH {a['C_HH']:.2f} ({low:.2f} to {high:.2f})",
            all_of([larger(c.low, c.high) for c in rivals]),
            f"Closest rival {others[closest]}: {_differences([rivals[closest]], ['C_HH less it'])}.",
        ),
        Finding(
            "C_HH improves much on the prescreener's magnitude", "very significant (Fig. 13)",
            _differences([energy], ["C_HH - magnitude"]), larger(energy.low, energy.high),
        ),
        Finding(
            "PD_mean of C_HH is 0.93", "0.93 (resubstitution and cross-validation)",
            f"{a['C_HH']:.2f} ({low:.2f} to {high:.2f}), cross-validation {c['C_HH']:.2f}",
            within(0.93, low, high),
            "An absolute level depends on soil, mines and clutter, which the paper does not describe.",
        ),
    ]  # fmt: skip
    gain = _compare(pool.match_of(searches["A"][_best(searches["A"])].confidence), contrast, draws)
    found.append(
        Finding(
            "More features hardly help (less than 0.03 over C_HH by resubstitution)", "0.93 to 0.94",
            _differences([gain], ["best set - C_HH"]), larger(0.03 - gain.high, 0.03 - gain.low),
        )
    )  # fmt: skip
    gaps = {name: abs(a[name] - c[name]) for name in FEATURES if name != "P_psi"}
    widest = max(gaps, key=lambda name: gaps[name])
    found.append(
        Finding(
            "Cross-validation is close to resubstitution with duplication (within 0.02, but for P_psi)", "equal",
            f"largest difference {gaps[widest]:.3f} ({widest})", AGREES if gaps[widest] <= 0.02 else DISAGREES,
            "A difference of pooled scores; no interval.",
        )
    )  # fmt: skip
    part = np.array([a.score - c.score for a, c in zip(searches["A"], searches["C"], strict=True)])
    slope = float(np.polyfit(np.arange(part.size), part, 1)[0])
    found.append(
        Finding(
            "Resubstitution and cross-validation part as features grow", "0.00 at 1, up to 0.06 at 9 features",
            f"{part[0]:.2f} at 1, {part[-1]:.2f} at {part.size}, slope {slope:+.4f} per feature",
            AGREES if slope > 0 else DISAGREES, "The sign of a straight line through the differences; no interval.",
        )
    )  # fmt: skip
    weak = sorted(sorted(a, key=lambda name: a[name])[:2])
    shown = ", ".join(f"{name} {a[name]:.2f}" for name in ("P_alpha", "P_psi"))
    found.append(
        Finding(
            "P_alpha and P_psi are the weak ones", "0.19 and 0.30, all others at least 0.66",
            f"{shown}; weakest two: {', '.join(weak)}", AGREES if weak == ["P_alpha", "P_psi"] else DISAGREES,
        )
    )  # fmt: skip
    same = max(abs(a[name] - b[name]) for name in FEATURES)
    found.append(
        Finding(
            "Duplication changes single features little by resubstitution", "by up to 0.19 (P_psi: 0.30 and 0.11)",
            f"by up to {same:.3f}", AGREES if same <= 0.05 else DISAGREES,
            "A discriminant of one feature is monotone in it, so that only its sign can change; the paper's larger "
            "differences are not explained by its text.",
        )
    )  # fmt: skip
    return [*found, *_distribution_findings(pool)]


def _distribution_findings(pool: Pool) -> list[Finding]:
    hit = ((pool.labels["label"] == "hit") & (pool.labels["beta"] == 1)).to_numpy()
    false = (pool.labels["label"] == "false").to_numpy()
    found = []
    note = (
        "The text says a higher P_tau for mines and calls it more symmetric, but by its Eq. 15 tau is 0 for a "
        "symmetric scatterer: the claim of symmetry is lower tau."
    )
    for name, claim, remark in (
        ("P_H", "Mines have a lower P_H (less random)", ""),
        ("P_tau", "Mines are more symmetric scatterers (lower tau by Eq. 15)", note),
    ):
        values = pool.features[f"{name}_F1"].to_numpy()
        mines, clutter = values[hit & np.isfinite(values)], values[false & np.isfinite(values)]
        share = float(mannwhitneyu(mines, clutter).statistic / (len(mines) * len(clutter)))
        # Variance of the statistic by DeLong's placements: both samples' own spread.
        spread = _placement_error(mines, clutter)
        low, high = share - 1.96 * spread, share + 1.96 * spread
        text = f"P(mine > false alarm) = {share:.2f} ({low:.2f} to {high:.2f}) of {len(mines)} hits"
        found.append(Finding(claim, "stated, no figure", text, larger(0.5 - high, 0.5 - low), remark))
    return found


def _placement_error(mines: FloatArray, clutter: FloatArray) -> float:
    wins = (np.sign(mines[:, None] - clutter[None]) + 1) / 2
    return float(np.sqrt(wins.mean(axis=1).var() / len(mines) + wins.mean(axis=0).var() / len(clutter)))


def band_findings(
    pool: Pool, by_band: dict[str, pd.DataFrame], sets: dict[str, list[SearchStep]], draws: int
) -> list[Finding]:
    """Judge the findings about features of other sub-bands (the paper's Tables III and IV)."""
    first = pool.match_of(sets["F1"][2].confidence)
    gaps = [_compare(first, pool.match_of(sets[b][2].confidence), draws) for b in SUBBANDS[1:]]
    found = [
        Finding(
            "Three features of F1 beat three of any other sub-band", "0.94 against 0.72, 0.74, 0.64",
            _differences(gaps, [f"F1 - {b}" for b in SUBBANDS[1:]]), all_of([larger(c.low, c.high) for c in gaps]),
        )
    ]  # fmt: skip
    more = _compare(pool.match_of(sets["all"][4].confidence), pool.match_of(sets["all"][0].confidence), draws)
    found.append(
        Finding(
            "Features of other sub-bands add little (less than 0.03 for the best five of 40)", "0.93 to 0.94",
            _differences([more], ["five - one"]), larger(0.03 - more.high, 0.03 - more.low),
        )
    )  # fmt: skip
    for pol in ("HH", "VV"):
        name = f"R_{pol}_HV"
        score = {b: float(by_band[b][name]["A"]) for b in SUBBANDS}
        best = max(score, key=lambda b: score[b])
        gap = _compare(
            pool.match_of(pool.confidence([f"{name}_F1"], "A")),
            pool.match_of(pool.confidence([f"{name}_F4"], "A")),
            draws,
        )
        found.append(
            Finding(
                f"The co/cross ratio {name} works best at low sub-bands", "more valid at lower bands (Fig. 10)",
                ", ".join(f"{b} {v:.2f}" for b, v in score.items()) + f"; {_differences([gap], ['F1 - F4'])}",
                larger(gap.low, gap.high), f"Best is {best}.",
            )
        )  # fmt: skip
    thesis = _compare(
        pool.match_of(pool.confidence(["C_HH_F1"], "A")), pool.match_of(pool.confidence(["C_HH_F0"], "A")), draws
    )
    found.append(
        Finding(
            "C_HH of F1 beats C_HH of the wide band F0 at the same alarms (the paper's thesis)", "not tabulated",
            _differences([thesis], ["F1 - F0"]), larger(thesis.low, thesis.high),
        )
    )  # fmt: skip
    return found


def curve_findings(calibration: Match, blind: dict[str, Match] | None) -> list[Finding]:
    """Judge the findings about points of the final curves (the paper's Sec. III and Fig. 14)."""
    found = []
    points = (
        ("buried plastic mines", BURIED_PLASTIC, ((0.02, 0.65), (0.07, 0.90))),
        ("simulants", SIMULANTS, ((0.02, 7 / 16), (0.07, 9 / 16))),
    )
    for what, subset, wanted in points:
        for far, figure in wanted:
            n, targets, low, high = detections_at(calibration, subset, far)
            claim = f"Of the {what} C_HH finds {figure:.0%} at {far:g} per m² (calibration)"
            found.append(Finding(claim, f"{figure:.0%}", _share(n, targets, low, high), within(figure, low, high)))
    n, targets, low, high = detections_at(calibration, SIMULANTS, 0.07)
    m, mines, *_ = detections_at(calibration, BURIED_PLASTIC, 0.07)
    gap, error = m / mines - n / targets, np.sqrt(m * (mines - m) / mines**3 + n * (targets - n) / targets**3)
    text = f"{gap:+.2f} ({gap - 1.96 * error:+.2f} to {gap + 1.96 * error:+.2f}) at 0.07 per m²"
    verdict = larger(gap - 1.96 * error, gap + 1.96 * error)
    found.append(Finding("Simulants are found much worse than plastic mines", "9 of 16 against 90 %", text, verdict))
    if blind is None:
        return found
    for name, one in blind.items():
        n, targets, low, high = detections_at(one, {"kind": "metal"}, 0.01)
        claim = f"Metal mines: 100 % below 0.01 per m² on the blind lanes, classifier {name}"
        remark = "" if n == targets else "A single miss rules out 100 % by the exact interval."
        found.append(Finding(claim, "100 %", _share(n, targets, low, high), within(1.0, low, high), remark))
    return found


def _best(steps: list[SearchStep]) -> int:
    return int(np.argmax([step.score for step in steps]))


def _compare(first: Match, second: Match, draws: int) -> Any:
    return compare(first, second, MINES, draws=draws)


def _differences(comparisons: Sequence[Any], names: Sequence[str]) -> str:
    parts = [
        f"{n} = {c.difference:+.2f} ({c.low:+.2f} to {c.high:+.2f})" for c, n in zip(comparisons, names, strict=True)
    ]
    return "; ".join(parts)


def _share(found: int, targets: int, low: float, high: float) -> str:
    return f"{found} of {targets} = {found / max(targets, 1):.0%} ({low:.0%} to {high:.0%})"

"""Experiments of flsar2004 without prescreener (Sec. 4): machines, depths, sites and templates.

They are Fig. 6 to 10, and a comparison of templates that the paper does not have.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flgpr_papers.flsar2004.examples import (
    MAIN,
    VARIANTS,
    Site,
    make_templates,
    open_examples,
)
from flgpr_papers.flsar2004.findings import (
    Measure,
    auc,
    difference,
    pd_count,
    ratio_interval,
    spread_of_folds,
)
from flgpr_papers.flsar2004.machines import (
    NOVELTY_RIVALS,
    Classifier,
    Examples,
    HeldOut,
    across,
    evidence_rvm,
    held_out,
    leave_one_out,
    one_class,
    retrained,
    rvm,
    rvm_by_evidence,
    sum_of_correlations,
    svm,
)
from flgpr_papers.flsar2004.material import (
    SHALLOW,
    SURFACE,
    Material,
    Results,
    pick_examples,
    thin_examples,
)
from flgpr_papers.kit.intervals import SHARE, Interval, difference_of_shares, spread

KINDS = ("metal", "plastic")
_OWN_MACHINE = "RVM, ARD, width by evidence"
_SUM = "sum of the correlations"
_RVM_RIVALS = [name for name in NOVELTY_RIVALS if "rvm" in name]
"""The one-class machines of the paper, by every formulation that its text allows."""


def sparsity(material: Material) -> Results:
    """Run Fig. 6: metal mines down to 5 cm, VV, temperate site, no prescreener.

    Relevance vectors are compared with support vectors, and RBF with polynomial kernels.
    """
    options = material.settings.classify
    results = Results()
    chosen = pick_examples(material.examples[1], ("metal",), (-1.0, SHALLOW), "VV")
    measure = material.measure(chosen)
    machines: dict[str, Classifier] = {
        "RVM": rvm(options),
        "SVM": svm(options),
        "RVM polynomial": rvm(options, "poly"),
        "SVM polynomial": svm(options, "poly"),
        "RVM, prior by the evidence": rvm_by_evidence(options),
        _OWN_MACHINE: evidence_rvm(options),
        _SUM: sum_of_correlations,
    }
    scores: dict[str, HeldOut] = {}
    for label, machine in machines.items():
        scores[label] = leave_one_out(*chosen, machine, options.folds)
        results.add_areas(f"fig6 {label}", scores[label], measure, material.draws)
    for label in ("RVM", "SVM", _SUM):
        results.add_curve("fig6", label, scores[label], measure.area)
    for label in machines:
        results.add_curve("machines", label, scores[label], measure.area)
    few = thin_examples(chosen, options.examples, material.settings.seed)
    vectors = {}
    for label in ("RVM", "SVM", "RVM, prior by the evidence", _OWN_MACHINE):
        few_scores = leave_one_out(*few, machines[label], options.folds)
        vectors[label] = few_scores.vector_share
        if label in ("RVM", "SVM"):
            area = material.measure(few).area
            results.add_curve("fig6 as many examples", label, few_scores, area)
    results.notes["vectors, leave-one-out"] = {
        "examples": len(few[0]),
        "mines": int((few[0]["kind"] != "clutter").sum()),
        **{label: float(share.mean()) for label, share in vectors.items()},
    }
    results.notes["vectors by fold"] = {label: share.tolist() for label, share in vectors.items()}

    def gap(first: str, second: str) -> Interval:
        return difference(scores[first], scores[second], measure, material.draws)

    results.judge("machines", gap("RVM", "SVM"))
    results.judge("relevance-share", spread_of_folds(vectors["RVM"]))
    results.judge("support-share", spread_of_folds(vectors["SVM"]))
    results.judge("sparser", ratio_interval(vectors["RVM"], vectors["SVM"]))
    results.judge("own", gap(_OWN_MACHINE, "RVM"))
    results.judge("own-sparser", ratio_interval(vectors[_OWN_MACHINE], vectors["RVM"]))
    results.judge("kernel", gap("RVM", "RVM polynomial"))
    return results


def paper_size(material: Material, seed: int) -> Results:
    """Run the leave-one-out of Fig. 6 with as many examples as the paper has, drawn by a seed.

    They are of the temperate site, the last one.
    """
    options = material.settings.classify
    results = Results()
    chosen = pick_examples(material.examples[-1], ("metal",), (-1.0, SHALLOW), "VV")
    few = thin_examples(chosen, options.examples, seed)
    measure = material.measure(few)
    machines = {"RVM": rvm(options), "SVM": svm(options), "polynomial": rvm(options, "poly")}
    scores = {name: leave_one_out(*few, one, options.folds) for name, one in machines.items()}
    shares = scores["RVM"].vector_share, scores["SVM"].vector_share
    for name, rival in (("machines", "SVM"), ("kernel", "polynomial")):
        gap = difference(scores["RVM"], scores[rival], measure, material.draws)
        results.judge(name, gap)
    results.judge("relevance-share", spread_of_folds(shares[0]))
    results.judge("support-share", spread_of_folds(shares[1]))
    results.judge("sparser", ratio_interval(*shares))
    return results


def unscreened(material: Material) -> Results:
    """Run Fig. 7 to 9: metal and plastic mines without prescreener, at the temperate site.

    They are scored by depth and by novelty detectors, too, with both polarizations.
    """
    examples = material.examples[1]
    measure = material.measure(examples)
    results = Results(curves={"fig7": {}, "fig9": {}})
    metal, plastic = [
        _score_kind(material, kind, pick_examples(examples, (kind,)), measure, results)
        for kind in KINDS
    ]
    results.judge("plastic", measure.interval(plastic, material.draws))
    results.judge("comparable", difference(metal, plastic, measure, material.draws))
    _depths(pick_examples(examples, ("plastic",)), plastic, measure.area, results)
    return results


def _score_kind(
    material: Material, kind: str, chosen: Examples, measure: Measure, results: Results
) -> HeldOut:
    """Score the mines of a kind by every machine of Fig. 7 and 9; returns those of Fig. 7."""
    options = material.settings.classify
    draws = material.draws
    binary = leave_one_out(*chosen, rvm(options), options.folds)
    baseline = leave_one_out(*chosen, sum_of_correlations, options.folds)
    novel = {}
    for name in NOVELTY_RIVALS:
        machine = one_class(options, name)
        novel[name] = leave_one_out(*chosen, machine, options.folds, novelty=True)
    by_mine = held_out(*chosen, rvm(options), options.folds)
    results.add_curve("fig7", kind, binary, measure.area)
    results.add_curve("fig7", f"{kind}, {_SUM}", baseline, measure.area)
    results.add_curve("fig9", kind, novel[NOVELTY_RIVALS[0]], measure.area)
    results.add_areas(f"fig7 {kind}", binary, measure, draws)
    results.add_areas(f"fig7 {kind}, {_SUM}", baseline, measure, draws)
    results.add_areas(
        f"fig7 {kind}, both looks at a mine held out together", by_mine, measure, draws
    )
    drawn = retrained(*chosen, rvm(options), options.folds, max(draws // 80, 4))
    retrained_name = f"fig7 {kind}, both looks held out, trained anew in every draw"
    results.areas[retrained_name] = spread(auc(by_mine), drawn, bounds=SHARE)
    for name, scores in novel.items():
        results.add_areas(f"fig9 {kind}, one-class {name}", scores, measure, draws)
    gaps = {name: difference(binary, novel[name], measure, draws) for name in _RVM_RIVALS}
    results.judge_all("novelty", gaps, kind=kind)
    results.judge("plain-sum", difference(binary, baseline, measure, draws), kind=kind)
    return binary


def _depths(chosen: Examples, scores: HeldOut, area: float, results: Results) -> None:
    """Run Fig. 8: plastic mines on the surface, flush and 5 cm deep, against all depths."""
    table, _ = chosen
    depth = table.loc[table["kind"] != "clutter", "depth"].to_numpy()
    subsets = {
        "surface": depth <= SURFACE,
        "flush": (depth > SURFACE) & (depth <= 0.025),
        "5 cm": (depth > 0.025) & (depth <= SHALLOW),
        "all depths": np.ones(depth.size, np.bool_),
    }
    for label, rows in subsets.items():
        if rows.any():
            results.add_curve("fig8", label, scores.of_mines(rows), area)
    is_shallow = depth <= SHALLOW
    for far in (0.04, 0.07):
        shallow, deep = [pd_count(scores, area, far, rows) for rows in (is_shallow, ~is_shallow)]
        results.judge("depth", difference_of_shares(shallow, deep), far=far)


def between_sites(material: Material) -> Results:
    """Run Fig. 10: trained at one site, with its templates, and tested at the other; buried mines.

    The paper trains at the arid site. The other direction is run for comparison.
    """
    results = Results()
    _across_sites(material, 0, 1, results)
    _across_sites(material, 1, 0, results)
    return results


def _across_sites(material: Material, first: int, second: int, results: Results) -> None:
    """Train at a site and test at another."""
    options = material.settings.classify
    draws = material.draws
    test_site = material.sites[second]
    direction = f"{material.sites[first].name} to {test_site.name}"
    # The paper trains at the arid site and speaks of no other direction.
    is_the_papers = first == 0
    test_examples = open_examples(material.settings, test_site, material.templates[first])
    measure = material.measure(test_examples)
    novel: dict[str, dict[str, HeldOut]] = {}
    for kind in KINDS:
        train = pick_examples(material.examples[first], (kind,), (SURFACE, 1.0))
        test = pick_examples(test_examples, (kind,), (SURFACE, 1.0))
        novel[kind] = {}
        for name in NOVELTY_RIVALS:
            novel[kind][name] = across(train, test, one_class(options, name))
        scores = {f"one-class {name}": one for name, one in novel[kind].items()}
        scores["binary"] = across(train, test, rvm(options))
        scores[_SUM] = across(train, test, sum_of_correlations)
        papers = novel[kind][NOVELTY_RIVALS[0]]
        results.add_curve(f"fig10 {direction}", f"{kind}, one-class", papers, measure.area)
        results.add_curve(f"fig10 {direction}", f"{kind}, binary", scores["binary"], measure.area)
        for name, one in scores.items():
            results.add_areas(f"fig10 {direction}, {kind}, {name}", one, measure, draws)
        if is_the_papers:
            gaps = {}
            for name in _RVM_RIVALS:
                gaps[name] = difference(scores["binary"], novel[kind][name], measure, draws)
            results.judge_all("carries-binary", gaps, kind=kind)
    for kind in KINDS:
        intervals = {name: measure.interval(novel[kind][name], draws) for name in _RVM_RIVALS}
        if is_the_papers:
            results.judge_all("carries", intervals, kind=kind, way=direction)
        else:
            results.judge("carries-back", intervals[_RVM_RIVALS[0]], kind=kind, way=direction)
    if is_the_papers:
        gaps = {}
        for name in _RVM_RIVALS:
            gaps[name] = difference(novel["metal"][name], novel["plastic"][name], measure, draws)
        results.judge_all("carries-metal", gaps, way=direction)


def variants(material: Material) -> Results:
    """Compare other templates and complex correlation with the main templates.

    There is no prescreener; both polarizations, the binary RVM, and mines of all depths.
    """
    summary: dict[str, Any] = {}
    for site in material.sites:
        for kind in KINDS:
            summary[f"{site.name}, {kind}"] = _variant_summary(material, site, kind)
    return Results(notes={"templates": summary})


def _variant_summary(material: Material, site: Site, kind: str) -> dict[str, Any]:
    """Return the number of every kind of template, and that less the main one's."""
    options = material.settings.classify
    scores: dict[str, HeldOut] = {}
    for name, variant in VARIANTS.items():
        templates = make_templates(material.settings, site, variant)
        examples = open_examples(material.settings, site, templates, variant.magnitude)
        chosen = pick_examples(examples, (kind,))
        scores[name] = held_out(*chosen, rvm(options), options.folds)
        measure = material.measure(chosen)
    (main,) = [name for name, variant in VARIANTS.items() if variant == MAIN]
    summary = {}
    for name, variant_scores in scores.items():
        gap = difference(variant_scores, scores[main], measure, material.draws)
        area = measure.interval(variant_scores, material.draws)
        summary[name] = {"area": area, "less the main one": gap}
    return summary

"""Experiments of flsar2004 without prescreener (Sec. 4): machines, depths, sites and templates.

They are Fig. 6 to 10, and a comparison of templates that the paper does not have.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr_papers.flsar2004.examples import MAIN, VARIANTS, Site, make_templates, open_examples
from flgpr_papers.flsar2004.findings import (
    Measure,
    auc,
    difference,
    pd_count,
    ratio_interval,
    roc,
    spread_of_folds,
)
from flgpr_papers.flsar2004.lanes import Classify
from flgpr_papers.flsar2004.machines import (
    NOVELTY_RIVALS,
    Classifier,
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
    Examples,
    Material,
    Results,
    open_area,
    pick_examples,
    thin_examples,
)
from flgpr_papers.kit.findings import SHARE, difference_of_shares, spread

FloatArray = NDArray[np.float64]
_KINDS = ("metal", "plastic")
_OWN_MACHINE = "RVM, ARD, width by evidence"
_RVM_RIVALS = [name for name in NOVELTY_RIVALS if "rvm" in name]
"""The one-class machines of the paper, by every formulation that its text allows."""


def sparsity(material: Material) -> Results:
    """Run Fig. 6: metal mines down to 5 cm, VV, temperate site, no prescreener.

    Relevance vectors are compared with support vectors, and RBF with polynomial kernels.

    Parameters
    ----------
    material : Material
        Both sites.
    """
    settings = material.settings
    options = settings.classify
    draws = options.bootstrap
    results = Results()
    chosen = pick_examples(material.examples[1], ("metal",), (-1.0, SHALLOW), "VV")
    searched = open_area(chosen, settings)
    machines = _machines(options)
    scores: dict[str, HeldOut] = {}
    curves = {}
    for label, machine in machines.items():
        scores[label] = leave_one_out(*chosen, machine, options.folds)
        curves[label] = roc(scores[label], searched)
        results.add_areas(f"fig6 {label}", scores[label], searched, draws)
    of_the_paper = ("RVM", "SVM", "sum of the correlations")
    results.curves["fig6"] = {label: curves[label] for label in of_the_paper}
    results.curves["machines"] = curves
    few = thin_examples(chosen, options.examples, settings.seed)
    few_scores: dict[str, HeldOut] = {}
    for label, machine in machines.items():
        if "polynomial" not in label and label != "sum of the correlations":
            few_scores[label] = leave_one_out(*few, machine, options.folds)
    few_area = open_area(few, settings)
    results.curves["fig6 as many examples"] = {
        "RVM": roc(few_scores["RVM"], few_area),
        "SVM": roc(few_scores["SVM"], few_area),
    }
    _record_vectors(few, few_scores, results)
    measure = Measure(searched)
    relevance = few_scores["RVM"].vector_share
    support = few_scores["SVM"].vector_share
    own = few_scores[_OWN_MACHINE].vector_share
    results.judge("machines", difference(scores["RVM"], scores["SVM"], measure, draws))
    results.judge("relevance-share", spread_of_folds(relevance))
    results.judge("support-share", spread_of_folds(support))
    results.judge("sparser", ratio_interval(relevance, support))
    results.judge("own", difference(scores[_OWN_MACHINE], scores["RVM"], measure, draws))
    results.judge("own-sparser", ratio_interval(own, relevance))
    results.judge("kernel", difference(scores["RVM"], scores["RVM polynomial"], measure, draws))
    return results


def _machines(options: Classify) -> dict[str, Classifier]:
    """Return the machines of Fig. 6 and those that are tried beside them."""
    return {
        "RVM": rvm(options),
        "SVM": svm(options),
        "RVM polynomial": rvm(options, "poly"),
        "SVM polynomial": svm(options, "poly"),
        "RVM, prior by the evidence": rvm_by_evidence(options),
        _OWN_MACHINE: evidence_rvm(options),
        "sum of the correlations": sum_of_correlations,
    }


def _record_vectors(few: Examples, scores: dict[str, HeldOut], results: Results) -> None:
    """Record the share of the training examples that are vectors, by machine and by fold."""
    table, _ = few
    leave_one_out_summary: dict[str, Any] = {
        "examples": len(table),
        "mines": int((table["kind"] != "clutter").sum()),
    }
    by_fold = {}
    for label, machine_scores in scores.items():
        leave_one_out_summary[label] = float(machine_scores.vector_share.mean())
        by_fold[label] = machine_scores.vector_share.tolist()
    results.details["vectors, leave-one-out"] = leave_one_out_summary
    results.details["vectors by fold"] = by_fold


def unscreened(material: Material) -> Results:
    """Run Fig. 7 to 9: metal and plastic mines without prescreener, at the temperate site.

    They are scored by depth and by novelty detectors, too, with both polarizations.

    Parameters
    ----------
    material : Material
        Both sites.
    """
    settings = material.settings
    draws = settings.classify.bootstrap
    examples = material.examples[1]
    searched = open_area(examples, settings)
    measure = Measure(searched)
    results = Results()
    results.curves["fig7"] = {}
    results.curves["fig9"] = {}
    binary: dict[str, HeldOut] = {}
    for kind in _KINDS:
        chosen = pick_examples(examples, (kind,))
        binary[kind] = _score_kind(settings.classify, kind, chosen, searched, results)
    results.judge("plastic", measure.interval(binary["plastic"], draws))
    results.judge("comparable", difference(binary["metal"], binary["plastic"], measure, draws))
    _depths(searched, pick_examples(examples, ("plastic",)), binary["plastic"], results)
    return results


def _score_kind(
    options: Classify, kind: str, chosen: Examples, searched: float, results: Results
) -> HeldOut:
    """Score the mines of a kind by every machine of Fig. 7 and 9; returns those of Fig. 7."""
    draws = options.bootstrap
    measure = Measure(searched)
    binary = leave_one_out(*chosen, rvm(options), options.folds)
    baseline = leave_one_out(*chosen, sum_of_correlations, options.folds)
    novel = {}
    for name in NOVELTY_RIVALS:
        machine = one_class(options, name)
        novel[name] = leave_one_out(*chosen, machine, options.folds, novelty=True)
    baseline_name = f"{kind}, sum of the correlations"
    results.curves["fig7"][kind] = roc(binary, searched)
    results.curves["fig7"][baseline_name] = roc(baseline, searched)
    results.curves["fig9"][kind] = roc(novel[NOVELTY_RIVALS[0]], searched)
    results.add_areas(f"fig7 {kind}", binary, searched, draws)
    results.add_areas(f"fig7 {baseline_name}", baseline, searched, draws)
    by_mine = held_out(*chosen, rvm(options), options.folds)
    results.add_areas(
        f"fig7 {kind}, both looks at a mine held out together", by_mine, searched, draws
    )
    drawn = retrained(*chosen, rvm(options), options.folds, max(draws // 80, 4))
    retrained_name = f"fig7 {kind}, both looks held out, trained anew in every draw"
    results.areas[retrained_name] = spread(auc(by_mine), drawn, bounds=SHARE)
    for name, scores in novel.items():
        results.add_areas(f"fig9 {kind}, one-class {name}", scores, searched, draws)
    gaps = {name: difference(binary, novel[name], measure, draws) for name in _RVM_RIVALS}
    results.judge_all("novelty", gaps, kind=kind)
    results.judge("plain-sum", difference(binary, baseline, measure, draws), kind=kind)
    return binary


def _depths(searched: float, chosen: Examples, scores: HeldOut, results: Results) -> None:
    """Run Fig. 8: plastic mines on the surface, flush and 5 cm deep, against all depths."""
    table, _ = chosen
    is_mine = (table["kind"] != "clutter").to_numpy()
    depth = table["depth"].to_numpy()[is_mine]
    subsets = {
        "surface": depth <= SURFACE,
        "flush": (depth > SURFACE) & (depth <= 0.025),
        "5 cm": (depth > 0.025) & (depth <= SHALLOW),
        "all depths": np.ones(depth.size, np.bool_),
    }
    for label, rows in subsets.items():
        if rows.any():
            curve = roc(scores.of_mines(rows), searched)
            results.curves.setdefault("fig8", {})[label] = curve
    is_shallow = depth <= SHALLOW
    for far in (0.04, 0.07):
        shallow = pd_count(scores, searched, far, is_shallow)
        deep = pd_count(scores, searched, far, ~is_shallow)
        results.judge("depth", difference_of_shares(shallow, deep), far=far)


def between_sites(material: Material) -> Results:
    """Run Fig. 10: trained at one site, with its templates, and tested at the other; buried mines.

    The paper trains at the arid site. The other direction is run for comparison.

    Parameters
    ----------
    material : Material
        Both sites.
    """
    results = Results()
    _across_sites(material, 0, 1, results)
    _across_sites(material, 1, 0, results)
    return results


def _across_sites(material: Material, first: int, second: int, results: Results) -> None:
    """Train at a site and test at another."""
    settings = material.settings
    options = settings.classify
    draws = options.bootstrap
    test_site = material.sites[second]
    direction = f"{material.sites[first].name} to {test_site.name}"
    # The paper trains at the arid site and speaks of no other direction.
    is_the_papers = first == 0
    test_examples = open_examples(settings, test_site, material.templates[first])
    searched = open_area(test_examples, settings)
    measure = Measure(searched)
    results.curves[f"fig10 {direction}"] = {}
    novel: dict[str, dict[str, HeldOut]] = {}
    for kind in _KINDS:
        train = pick_examples(material.examples[first], (kind,), (SURFACE, 1.0))
        test = pick_examples(test_examples, (kind,), (SURFACE, 1.0))
        novel[kind] = {}
        for name in NOVELTY_RIVALS:
            novel[kind][name] = across(train, test, one_class(options, name))
        binary = across(train, test, rvm(options))
        baseline = across(train, test, sum_of_correlations)
        curves = results.curves[f"fig10 {direction}"]
        curves[f"{kind}, one-class"] = roc(novel[kind][NOVELTY_RIVALS[0]], searched)
        curves[f"{kind}, binary"] = roc(binary, searched)
        scores_by_name = {f"one-class {name}": scores for name, scores in novel[kind].items()}
        scores_by_name["binary"] = binary
        scores_by_name["sum of the correlations"] = baseline
        for name, scores in scores_by_name.items():
            results.add_areas(f"fig10 {direction}, {kind}, {name}", scores, searched, draws)
        if is_the_papers:
            gaps = {}
            for name in _RVM_RIVALS:
                gaps[name] = difference(binary, novel[kind][name], measure, draws)
            results.judge_all("carries-binary", gaps, kind=kind)
    for kind in _KINDS:
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

    Parameters
    ----------
    material : Material
        Both sites.
    """
    results = Results()
    summary: dict[str, Any] = {}
    for site in material.sites:
        for kind in _KINDS:
            summary[f"{site.name}, {kind}"] = _variant_summary(material, site, kind)
    results.details["templates"] = summary
    return results


def _variant_summary(material: Material, site: Site, kind: str) -> dict[str, Any]:
    """Return the number of every kind of template, and that less the main one's."""
    settings = material.settings
    options = settings.classify
    scores: dict[str, HeldOut] = {}
    main = ""
    for name, variant in VARIANTS.items():
        templates = make_templates(settings, site, variant)
        examples = open_examples(settings, site, templates, variant.magnitude)
        chosen = pick_examples(examples, (kind,))
        scores[name] = held_out(*chosen, rvm(options), options.folds)
        searched = open_area(chosen, settings)
        if variant == MAIN:
            main = name
    measure = Measure(searched)
    summary = {}
    for name, variant_scores in scores.items():
        gap = difference(variant_scores, scores[main], measure, options.bootstrap)
        area = measure.interval(variant_scores, options.bootstrap)
        summary[name] = {"area": area, "less the main one": gap}
    return summary

"""The parts of the experiment of flsar2004, Sec. 3 and 4, in order.

First those about machines, depths, sites and templates without prescreener (Fig. 6 to 10), then
those about signatures, templates and prescreeners, and the table of all parts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from flgpr.features import principal_templates
from flgpr.stages.clusters import ClusterScreen
from flgpr.types import Entries, floats
from flgpr_papers.flsar2004.examples import (
    MAIN,
    POLARIZATIONS,
    VARIANTS,
    Site,
    clutter_past_prescreeners,
    learn_screen,
    make_templates,
    open_examples,
    screened_examples,
    screened_regions,
    signatures,
)
from flgpr_papers.flsar2004.findings import (
    SHALLOW,
    SURFACE,
    Material,
    Measure,
    Results,
    auc,
    component_interval,
    likeness_interval,
    pd_count,
    pick_examples,
    ratio_interval,
    spread_of_folds,
    stronger_interval,
    thin_examples,
)
from flgpr_papers.flsar2004.lanes import RadiusIs
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
    with_lost,
)
from flgpr_papers.kit.intervals import SHARE, Interval, difference_of_shares, proportion, spread

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
        scores[label] = leave_one_out(chosen, machine, options.folds)
        results.add_areas(f"fig6 {label}", scores[label], measure)
    for label in ("RVM", "SVM", _SUM):
        results.add_curve("fig6", label, scores[label], measure.area)
    for label in machines:
        results.add_curve("machines", label, scores[label], measure.area)
    few = thin_examples(chosen, options.examples, material.settings.seed)
    vectors = {}
    for label in ("RVM", "SVM", "RVM, prior by the evidence", _OWN_MACHINE):
        few_scores = leave_one_out(few, machines[label], options.folds)
        vectors[label] = few_scores.vector_share
        if label in ("RVM", "SVM"):
            area = material.measure(few).area
            results.add_curve("fig6 as many examples", label, few_scores, area)
    results.notes["vectors, leave-one-out"] = {
        "examples": len(few.table),
        "mines": int(few.is_mine.sum()),
        **{label: float(share.mean()) for label, share in vectors.items()},
    }
    results.notes["vectors by fold"] = {label: share.tolist() for label, share in vectors.items()}

    def gap(first: str, second: str) -> Interval:
        return measure.difference(scores[first], scores[second])

    results.judge("machines", gap("RVM", "SVM"))
    results.judge("relevance-share", spread_of_folds(vectors["RVM"]))
    results.judge("support-share", spread_of_folds(vectors["SVM"]))
    results.judge("sparser", ratio_interval(vectors["RVM"], vectors["SVM"]))
    results.judge("own", gap(_OWN_MACHINE, "RVM"))
    results.judge("own-sparser", ratio_interval(vectors[_OWN_MACHINE], vectors["RVM"]))
    results.judge("kernel", gap("RVM", "RVM polynomial"))
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
    results.judge("plastic", measure.interval(plastic))
    results.judge("comparable", measure.difference(metal, plastic))
    _depths(pick_examples(examples, ("plastic",)), plastic, measure.area, results)
    return results


def _score_kind(
    material: Material, kind: str, chosen: Examples, measure: Measure, results: Results
) -> HeldOut:
    """Score the mines of a kind by every machine of Fig. 7 and 9; returns those of Fig. 7."""
    options = material.settings.classify
    binary = leave_one_out(chosen, rvm(options), options.folds)
    baseline = leave_one_out(chosen, sum_of_correlations, options.folds)
    novel = {}
    for name in NOVELTY_RIVALS:
        machine = one_class(options, name)
        novel[name] = leave_one_out(chosen, machine, options.folds, novelty=True)
    by_mine = held_out(chosen, rvm(options), options.folds)
    results.add_curve("fig7", kind, binary, measure.area)
    results.add_curve("fig7", f"{kind}, {_SUM}", baseline, measure.area)
    results.add_curve("fig9", kind, novel[NOVELTY_RIVALS[0]], measure.area)
    results.add_areas(f"fig7 {kind}", binary, measure)
    results.add_areas(f"fig7 {kind}, {_SUM}", baseline, measure)
    results.add_areas(f"fig7 {kind}, both looks at a mine held out together", by_mine, measure)
    drawn = retrained(chosen, rvm(options), options.folds, max(measure.draws // 80, 4))
    retrained_name = f"fig7 {kind}, both looks held out, trained anew in every draw"
    results.areas[retrained_name] = spread(auc(by_mine), drawn, bounds=SHARE)
    for name, scores in novel.items():
        results.add_areas(f"fig9 {kind}, one-class {name}", scores, measure)
    gaps = {name: measure.difference(binary, novel[name]) for name in _RVM_RIVALS}
    results.judge_all("novelty", gaps, kind=kind)
    results.judge("plain-sum", measure.difference(binary, baseline), kind=kind)
    return binary


def _depths(chosen: Examples, scores: HeldOut, area: float, results: Results) -> None:
    """Run Fig. 8: plastic mines on the surface, flush and 5 cm deep, against all depths."""
    depth = chosen.table.loc[chosen.is_mine, "depth"].to_numpy()
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
            results.add_areas(f"fig10 {direction}, {kind}, {name}", one, measure)
        if is_the_papers:
            gaps = {
                name: measure.difference(scores["binary"], novel[kind][name])
                for name in _RVM_RIVALS
            }
            results.judge_all("carries-binary", gaps, kind=kind)
    for kind in KINDS:
        intervals = {name: measure.interval(novel[kind][name]) for name in _RVM_RIVALS}
        if is_the_papers:
            results.judge_all("carries", intervals, kind=kind, way=direction)
        else:
            results.judge("carries-back", intervals[_RVM_RIVALS[0]], kind=kind, way=direction)
    if is_the_papers:
        gaps = {
            name: measure.difference(novel["metal"][name], novel["plastic"][name])
            for name in _RVM_RIVALS
        }
        results.judge_all("carries-metal", gaps, way=direction)


def variants(material: Material) -> Results:
    """Compare other templates and complex correlation with the main templates.

    There is no prescreener; both polarizations, the binary RVM, and mines of all depths.
    """
    summary: Entries = {}
    for site in material.sites:
        for kind in KINDS:
            summary[f"{site.name}, {kind}"] = _variant_summary(material, site, kind)
    return Results(notes={"templates": summary})


def _variant_summary(material: Material, site: Site, kind: str) -> Entries:
    """Return the number of every kind of template, and that less the main one's."""
    options = material.settings.classify
    scores: dict[str, HeldOut] = {}
    for name, variant in VARIANTS.items():
        templates = make_templates(material.settings, site, variant)
        examples = open_examples(material.settings, site, templates, variant.magnitude)
        chosen = pick_examples(examples, (kind,))
        scores[name] = held_out(chosen, rvm(options), options.folds)
        measure = material.measure(chosen)
    (main,) = [name for name, variant in VARIANTS.items() if variant == MAIN]
    summary = {}
    for name, variant_scores in scores.items():
        gap = measure.difference(variant_scores, scores[main])
        area = measure.interval(variant_scores)
        summary[name] = {"area": area, "less the main one": gap}
    return summary


FEWEST_EXAMPLES = 6
"""Looks at mines, and clutter regions, that a classifier of Fig. 5 needs past the prescreeners."""
RADII: dict[RadiusIs, str] = {
    "forming": "20 cm as what forms clusters",
    "size": "20 cm as their least size",
}
"""Readings of "the radius used to define the cluster threshold is 20 cm" (par. 15)."""
FIG5_FAR = 0.04
"""False alarms per m² at which the curves of Fig. 5 are compared.

It is the lower end of what the paper names (par. 50).
"""


def sizes(material: Material) -> Results:
    """Count the examples, and record how well the fiducials register the images."""
    results = Results()
    counts = {}
    registration: Entries = {}
    for site, examples in zip(material.sites, material.examples, strict=True):
        kinds = examples.table["kind"].value_counts()
        counts[site.name] = {kind: int(count) for kind, count in kinds.items()}
        registration[site.name] = {}
        for name, registered in site.registration.items():
            registration[site.name][name] = {
                "shift": list(registered.shift),
                "residual": registered.residual,
                "fiducials": registered.used,
            }
    results.notes["examples"] = counts
    results.notes["registration"] = registration
    return results


def templates(material: Material) -> Results:
    """Judge the principal components, and how alike the sites are (par. 19 and 24)."""
    results = Results()
    arid, temperate = [signatures(material.settings, site, False)[0] for site in material.sites]
    share, cosine = component_interval(arid, material.draws)
    results.judge("component", share)
    results.judge("component-mean", cosine)
    results.judge("templates", likeness_interval(arid, temperate, material.draws))
    energy = {}
    for site in material.sites:
        for values, magnitude in (("magnitudes", True), ("complex", False)):
            chips, _ = signatures(material.settings, site, False, magnitude)
            shares = [
                principal_templates(chips[:, polarization, distance], 1)[1][0]
                for polarization, distance in np.ndindex(*chips.shape[1:3])
            ]
            energy[f"{site.name}, {values}"] = float(np.mean(shares))
    results.notes["energy of the first component"] = energy
    return results


def signature_strength(material: Material) -> Results:
    """Judge that plastic signatures are not always stronger at the temperate site (par. 41)."""
    results = Results()
    arid, temperate = [_plastic_peaks(material, site) for site in material.sites]
    interval = stronger_interval(temperate, arid, material.draws)
    results.judge("plastic-not-always-stronger", interval)
    return results


def _plastic_peaks(material: Material, site: Site) -> pd.DataFrame:
    """Return the peak of every plastic mine over the clutter, with its depth and target."""
    chips, mines = signatures(material.settings, site, False)
    clutter = np.median(site.image, axis=(2, 3))[None]
    peak = (chips.max(axis=(3, 4)) / clutter).mean(axis=(1, 2))
    # Mines scatter about their depth: they are compared by steps of 5 cm.
    depth = np.round(floats(mines["depth"]) / 0.05) * 0.05
    table = pd.DataFrame({"peak": peak, "depth": depth, "target": mines["target"]})
    return table[(mines["kind"] == "plastic").to_numpy()]


def screened(material: Material) -> Results:
    """Run Fig. 5: metal mines flush and at 5 cm, with prescreeners.

    What the second prescreener adds, and what becomes of plastic mines, is measured, too. Statements
    are judged by what the settings take the paper's 20 cm for; of the other reading (par. 15) the
    curves are drawn and the second prescreener is judged.
    """
    chosen = material.settings.prescreen.radius_is
    results = _screened(material, chosen, "")
    other: RadiusIs = "size" if chosen == "forming" else "forming"
    beside = _screened(material, other, f", {RADII[other]}")
    results.curves |= beside.curves
    results.notes |= beside.notes
    results.findings += [one for one in beside.findings if one.claim.endswith(RADII[other])]
    return results


def _screened(material: Material, radius_is: RadiusIs, reading: str) -> Results:
    """Run Fig. 5 by a reading of par. 15, which stands behind the names of the sites."""
    settings = material.settings
    results = Results()
    passed_shares = []
    tables = []
    for site, template in zip(material.sites, material.templates, strict=True):
        screen = learn_screen(settings, site, radius_is=radius_is)
        mines = _offered(site)
        is_asked = (mines["kind"] == "metal") & mines["depth"].between(SURFACE, SHALLOW)
        offered = mines[is_asked].reset_index(drop=True)
        scores: dict[str, HeldOut] = {}
        results.curves[f"fig5 {site.name}{reading}"] = {}
        for label, polarizations in (("HH", ("HH",)), ("VV", ("VV",)), ("both", POLARIZATIONS)):
            regions = screened_regions(site, screen, polarizations)
            examples = screened_examples(settings, site, template, regions)
            chosen = pick_examples(examples, ("metal",), (SURFACE, SHALLOW), label)
            passed = _classify_passed(
                material, site, f"{site.name}{reading}", label, chosen, offered, results
            )
            if passed is not None:
                scores[label] = passed
        tables.append(examples.table)
        if "both" in scores:
            passed_shares.append((int((chosen.table["kind"] == "metal").sum()), len(offered)))
        if len(scores) == len(POLARIZATIONS) + 1:
            _judge_polarizations(material, site, scores, results)
        _count_clutter(material, site, f"{site.name}{reading}", screen, results)
    if len(passed_shares) == 2:
        results.judge("peak", difference_of_shares(*passed_shares))
    offered_kinds = _offered(material.sites[0])["kind"]
    metal, plastic = [
        (int((tables[0]["kind"] == kind).sum()), int((offered_kinds == kind).sum()))
        for kind in KINDS
    ]
    results.judge("screened-plastic", proportion(*plastic))
    results.judge("screened-metal", difference_of_shares(metal, plastic))
    return results


def _classify_passed(
    material: Material,
    site: Site,
    case: str,
    label: str,
    chosen: Examples,
    offered: pd.DataFrame,
    results: Results,
) -> HeldOut | None:
    """Score what passes the prescreeners, lost mines included; None if it is too little.

    The curve is added to those of Fig. 5.
    """
    table = chosen.table
    is_metal = table["kind"] == "metal"
    mines = int(is_metal.sum())
    clutter = int((~is_metal).sum())
    if min(mines, clutter) < FEWEST_EXAMPLES:
        results.notes[f"fig5 {case} {label}"] = (
            f"{mines} of {len(offered)} looks at mines and {clutter} clutter regions pass;"
            f" a classifier needs {FEWEST_EXAMPLES} of each"
        )
        return None
    options = material.settings.classify
    scores = leave_one_out(chosen, rvm(options), options.folds)
    results.add_curve(f"fig5 {case}", label, scores, site.area, len(offered))
    return with_lost(scores, table[is_metal], offered)


def _judge_polarizations(
    material: Material, site: Site, scores: dict[str, HeldOut], results: Results
) -> None:
    """Judge the fusion of polarizations, and VV against HH, at a site."""
    measure = Measure(site.area, FIG5_FAR, True, material.draws)
    for label in POLARIZATIONS:
        gap = measure.difference(scores["both"], scores[label])
        results.judge("fusion", gap, site=site.name, label=label)
    gap = measure.difference(scores["VV"], scores["HH"])
    results.judge("polarizations", gap, site=site.name)


def _count_clutter(
    material: Material, site: Site, case: str, screen: ClusterScreen, results: Results
) -> None:
    """Count the clutter past each prescreener of a site, and judge what the second one removes."""
    halo = material.settings.prescreen.halo
    first, second, third = clutter_past_prescreeners(site, screen, halo)
    results.notes[f"prescreeners one after the other, {case}"] = {
        "clutter clusters past amplitude and size": first,
        "past standard deviation too": second,
        "past the ellipse too": third,
    }
    if first:
        results.judge("second-prescreener", proportion(first - second, first), site=case)


def _offered(site: Site) -> pd.DataFrame:
    """Return the mines outside the subset, a row per drive."""
    return site.mines[~site.mines["subset"]]


def other_screens(material: Material) -> Results:
    """Count what other prescreening would pass at the arid site.

    The thresholds are learnt on plastic mines, too, or the images are joined by "and" over all six.
    """
    settings = material.settings
    site = material.sites[0]
    results = Results()
    screen = learn_screen(settings, site)
    screen_of_both = learn_screen(settings, site, KINDS)
    tried = {
        "prescreened": screened_regions(site, screen, POLARIZATIONS),
        "prescreened, and over all six images": screened_regions(
            site, screen, POLARIZATIONS, "and"
        ),
        "prescreened, thresholds learnt on metal and plastic": screened_regions(
            site, screen_of_both, POLARIZATIONS
        ),
        f"prescreened, {RADII['size']}": screened_regions(
            site, learn_screen(settings, site, radius_is="size"), POLARIZATIONS
        ),
    }
    offered = _offered(site)["kind"].value_counts()
    for name, regions in tried.items():
        examples = screened_examples(settings, site, material.templates[0], regions)
        counts = examples.table["kind"].value_counts()
        passed: Entries = {
            kind: f"{int(counts.get(kind, 0))} of {int(offered[kind])} pass" for kind in KINDS
        }
        passed["clutter regions per m²"] = int(counts.get("clutter", 0)) / site.area
        results.notes[f"{name}, {site.name}"] = passed
    return results


JUDGED: dict[str, Callable[[Material], Results]] = {
    "templates": templates,
    "screened": screened,
    "signature strength": signature_strength,
    "sparsity": sparsity,
    "unscreened": unscreened,
    "between sites": between_sites,
}
"""Parts by which statements of the paper are judged."""
PARTS = {"sizes": sizes, **JUDGED, "other screens": other_screens, "variants": variants}
"""All parts in order, by the names of the files in which their results are stored."""

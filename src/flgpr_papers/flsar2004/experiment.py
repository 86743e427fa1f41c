"""The experiments of flsar2004, Sec. 3 and 4, part by part: curves, areas, findings and tables."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.features import principal_templates
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
    Measure,
    auc,
    auc_interval,
    component_interval,
    difference,
    likeness_interval,
    pd_count,
    proportion,
    ratio_interval,
    roc,
    spread_of_folds,
    stronger_interval,
)
from flgpr_papers.flsar2004.lanes import Settings
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
    with_lost,
)
from flgpr_papers.kit.findings import (
    SHARE,
    SHARE_DIFFERENCE,
    UNDECIDED,
    Finding,
    Interval,
    clip,
    difference_of_shares,
    in_words,
    judge,
    measured,
    spread,
)
from flgpr_papers.kit.settings import packaged_text

FloatArray = NDArray[np.float64]
Examples = tuple[pd.DataFrame, FloatArray]
SHALLOW = 0.06
"""Depth up to which the paper's first three depths lie, m, with their scatter."""
FEWEST_EXAMPLES = 6
"""Looks at mines, and clutter regions, that a classifier of Fig. 5 needs past the prescreeners."""
SURFACE = -0.05
"""Depth above which a mine lies on the surface, m."""
FIG5_FAR = 0.04
"""False alarms per m² at which the curves of Fig. 5 are compared.

It is the lower end of what the paper names (par. 50).
"""
_STATEMENTS = tomllib.loads(packaged_text("flsar2004", "statements"))


@dataclass
class Results:
    """What a part yields."""

    curves: dict[str, dict[str, pd.DataFrame]] = field(
        default_factory=dict
    )  #: ROC by figure and label
    #: areas, partial: areas under whole ROCs, and up to 0.07 false alarms per m² over that, with
    #: their intervals
    areas: dict[str, Interval] = field(default_factory=dict)
    partial: dict[str, Interval] = field(default_factory=dict)
    chance: dict[str, float] = field(
        default_factory=dict
    )  #: partial areas of scores that know nothing
    findings: list[Finding] = field(default_factory=list)
    notes: dict[str, Any] = field(default_factory=dict)  #: what else is told, as JSON can hold it

    def judge(self, statement: str, interval: Interval, **words: Any) -> None:
        """Judge a statement of ``statements.toml`` by the interval of its number."""
        declared = _STATEMENTS[statement]
        rule = tuple(declared["rule"]) if "rule" in declared else None
        bounds = {"share": SHARE, "difference": SHARE_DIFFERENCE}.get(declared.get("is", ""))
        claim = declared["claim"].format(**words)
        self.findings.append(
            measured(claim, declared["paper"], declared["quantity"], interval, rule, bounds=bounds)
        )

    def judge_all(self, statement: str, intervals: dict[str, Interval], **words: Any) -> None:
        """Judge a statement that must not depend on a choice of ours.

        It is judged by the interval of every choice.

        Where the choices are not of one verdict, it cannot be said.
        """
        declared = _STATEMENTS[statement]
        rule: tuple[float, float] = (declared["rule"][0], declared["rule"][1])
        bounds = SHARE if declared["is"] == "share" else SHARE_DIFFERENCE
        cut = {name: clip(interval, bounds) for name, interval in intervals.items()}
        verdicts = {judge(low, high, rule) for _, low, high in cut.values()}
        verdict = verdicts.pop() if len(verdicts) == 1 else UNDECIDED
        text = "; ".join(f"{name}: {in_words(*interval)}" for name, interval in cut.items())
        self.findings.append(
            Finding(
                claim=declared["claim"].format(**words),
                paper=declared["paper"],
                ours=text,
                verdict=verdict,
                note="every formulation must give the same verdict",
                quantity=declared["quantity"],
                interval=next(iter(cut.values())),
                rule=rule,
                parts=tuple(value for value, _, _ in cut.values()),
                bounds=bounds,
            )
        )

    def add_areas(self, name: str, scores: HeldOut, searched: float, count: int) -> None:
        """Keep both areas under a ROC, and what chance gives."""
        measure = Measure(searched)
        self.areas[name] = auc_interval(scores, count)
        self.partial[name] = measure.interval(scores, count)
        self.chance[name] = measure.chance(scores)

    def add(self, other: Results) -> None:
        """Take another part's results in."""
        self.curves |= other.curves
        self.areas |= other.areas
        self.partial |= other.partial
        self.chance |= other.chance
        self.findings += other.findings
        self.notes |= other.notes


@dataclass(frozen=True)
class Material:
    """What all parts work on."""

    settings: Settings
    sites: list[Site]  #: both sites
    templates: list[NDArray[Any]]  #: templates of each
    examples: list[Examples]  #: examples without prescreener of each, and their features


def prepare(settings: Settings, sites: list[Site]) -> Material:
    """Make templates and examples."""
    templates = [make_templates(settings, site) for site in sites]
    pairs = zip(sites, templates, strict=True)
    return Material(
        settings,
        sites,
        templates,
        [open_examples(settings, site, site_examples) for site, site_examples in pairs],
    )


def sizes(material: Material) -> Results:
    """Count the examples and tell how well the fiducials register the images."""
    results = Results()
    counts = {}
    registration: dict[str, Any] = {}
    for site, (table, _) in zip(material.sites, material.examples, strict=True):
        kinds = table["kind"].value_counts()
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


def pick_examples(
    examples: Examples,
    kinds: tuple[str, ...],
    depth: tuple[float, float] = (-1.0, 1.0),
    columns: str = "both",
) -> Examples:
    """Examples of some kinds of mines between two depths, and all clutter.

    Features of one or both polarizations.
    """
    table, X = examples
    is_mine = table["kind"].isin(kinds) & table["depth"].between(*depth)
    rows = np.flatnonzero(is_mine | (table["kind"] == "clutter"))
    half = X.shape[1] // 2
    halves = {"both": slice(None), "HH": slice(0, half), "VV": slice(half, None)}
    return table.iloc[rows].reset_index(drop=True), X[rows][:, halves[columns]]


def open_area(examples: Examples, settings: Settings) -> float:
    """Area of the clutter tiles, m²: what was searched beside the mines."""
    count = int((examples[0]["kind"] == "clutter").sum())
    return count * settings.features.region[0] * settings.features.region[1]


def templates(material: Material) -> Results:
    """Principal components, and how alike the sites are (par. 19 and 24)."""
    settings = material.settings
    sites = material.sites
    results = Results()
    chips = [signatures(settings, site, False)[0] for site in sites]
    share, cosine = component_interval(chips[0], settings.classify.bootstrap)
    results.judge("component", share)
    results.judge("component-mean", cosine)
    results.judge("templates", likeness_interval(chips[0], chips[1], settings.classify.bootstrap))
    results.notes["energy of the first component"] = {
        f"{site.name}, {'magnitudes' if magnitude else 'complex'}": _first_share(
            settings, site, magnitude
        )
        for site in sites
        for magnitude in (True, False)
    }
    return results


def _first_share(settings: Settings, site: Site, magnitude: bool) -> float:
    """Return the mean share of energy in the first principal component."""
    chips = signatures(settings, site, False, magnitude)[0]
    return float(
        np.mean(
            [principal_templates(chips[:, p, r], 1)[1][0] for p, r in np.ndindex(*chips.shape[1:3])]
        )
    )


def screened(material: Material) -> Results:
    """Fig. 5: metal mines flush and at 5 cm, with prescreeners; what the second one adds.

    What becomes of plastic.
    """
    settings = material.settings
    sites = material.sites
    results = Results()
    options = settings.classify
    peaks = []
    passed = {}
    for site, template in zip(sites, material.templates, strict=True):
        scores: dict[str, HeldOut] = {}
        figure: dict[str, pd.DataFrame] = {}
        screen = learn_screen(settings, site)
        offered = _offered_looks(site, ("metal",), (SURFACE, SHALLOW))
        for label, polarizations in (("HH", ("HH",)), ("VV", ("VV",)), ("both", POLARIZATIONS)):
            regions = screened_regions(site, screen, polarizations)
            examples = screened_examples(settings, site, template, regions)
            if label == "both":
                passed[site.name] = (examples[0], _offered(site))
            chosen = pick_examples(examples, ("metal",), (SURFACE, SHALLOW), label)
            is_metal = chosen[0]["kind"] == "metal"
            mines = int(is_metal.sum())
            clutter = int((~is_metal).sum())
            if min(mines, clutter) < FEWEST_EXAMPLES:
                results.notes[f"fig5 {site.name} {label}"] = (
                    f"{mines} of {len(offered)} looks at mines and {clutter} clutter regions pass;"
                    f" a classifier needs {FEWEST_EXAMPLES} of each"
                )
                continue
            held_out_scores = leave_one_out(*chosen, rvm(options), options.folds)
            figure[label] = roc(held_out_scores, site.area, len(offered))
            scores[label] = with_lost(held_out_scores, chosen[0][is_metal], offered)
            if label == "both":
                peaks.append((int(is_metal.sum()), len(offered)))
        results.curves[f"fig5 {site.name}"] = figure
        if len(scores) == len(POLARIZATIONS) + 1:
            measure = Measure(site.area, FIG5_FAR, at=True)
            for label in POLARIZATIONS:
                gap = difference(scores["both"], scores[label], measure, options.bootstrap)
                results.judge("fusion", gap, site=site.name, label=label)
            gap = difference(scores["VV"], scores["HH"], measure, options.bootstrap)
            results.judge("polarizations", gap, site=site.name)
        first, second, third = clutter_past_prescreeners(site, screen, settings.prescreen.halo)
        results.notes[f"prescreeners one after the other, {site.name}"] = {
            "clutter clusters past amplitude and size": first,
            "past standard deviation too": second,
            "past the ellipse too": third,
        }
        if first:
            results.judge("second-prescreener", proportion(first - second, first), site=site.name)
    if len(peaks) == 2:
        results.judge("peak", difference_of_shares(*peaks))
    examples_table, all_offered = passed[sites[0].name]
    counts = {kind: int((examples_table["kind"] == kind).sum()) for kind in ("metal", "plastic")}
    results.judge("screened-plastic", proportion(counts["plastic"], int(all_offered["plastic"])))
    shares = [(counts[kind], int(all_offered[kind])) for kind in ("metal", "plastic")]
    results.judge("screened-metal", difference_of_shares(*shares))
    return results


def _offered_looks(site: Site, kinds: tuple[str, ...], depth: tuple[float, float]) -> pd.DataFrame:
    """Return the mines outside the subset of some kinds between two depths, a row per drive."""
    mines = site.mines[~site.mines["subset"]]
    return mines[mines["kind"].isin(kinds) & mines["depth"].between(*depth)].reset_index(drop=True)


def signature_strength(material: Material) -> Results:
    """Par. 41: plastic signatures are not always stronger at the temperate site."""
    settings = material.settings
    results = Results()
    peaks = []
    for site in material.sites:
        chips, mines = signatures(settings, site, False)
        floor = np.median(site.image, axis=(2, 3))[None]
        over_clutter = (chips.max(axis=(3, 4)) / floor).mean(axis=(1, 2))
        depth = np.round(mines["depth"].to_numpy(dtype=np.float64) / 0.05) * 0.05
        plastic = (mines["kind"] == "plastic").to_numpy()
        peaks.append(
            pd.DataFrame({"peak": over_clutter, "depth": depth, "target": mines["target"]})[plastic]
        )
    arid, temperate = peaks
    results.judge(
        "plastic-not-always-stronger",
        stronger_interval(temperate, arid, settings.classify.bootstrap),
    )
    return results


def other_screens(material: Material) -> Results:
    """Note what other prescreening would do.

    Thresholds learnt on plastic mines too, "and" over all six images.
    """
    settings = material.settings
    site = material.sites[0]
    template = material.templates[0]
    results = Results()
    kinds = ("metal", "plastic")
    learnt = learn_screen(settings, site)
    offered = _offered(site)
    tried = {
        "prescreened": screened_regions(site, learnt, POLARIZATIONS),
        "prescreened, and over all six images": screened_regions(
            site, learnt, POLARIZATIONS, "and"
        ),
        "prescreened, thresholds learnt on metal and plastic": screened_regions(
            site, learn_screen(settings, site, kinds), POLARIZATIONS
        ),
    }
    for name, regions in tried.items():
        counts = screened_examples(settings, site, template, regions)[0]["kind"].value_counts()
        results.notes[f"{name}, {site.name}"] = {
            **{kind: f"{int(counts.get(kind, 0))} of {int(offered[kind])} pass" for kind in kinds},
            "clutter regions per m²": int(counts.get("clutter", 0)) / site.area,
        }
    return results


def _offered(site: Site) -> Any:
    """Count the mines outside the subset, by kind."""
    return site.mines[~site.mines["subset"]]["kind"].value_counts()


def sparsity(material: Material) -> Results:
    """Fig. 6: metal mines down to 5 cm, VV, temperate, no prescreener.

    RVM against SVM, RBF against polynomials.
    """
    settings = material.settings
    results = Results()
    chosen = pick_examples(material.examples[1], ("metal",), (-1.0, SHALLOW), "VV")
    searched = open_area(chosen, settings)
    options = settings.classify
    count = settings.classify.bootstrap
    machines: dict[str, Classifier] = {
        "RVM": rvm(options),
        "SVM": svm(options),
        "RVM polynomial": rvm(options, "poly"),
        "SVM polynomial": svm(options, "poly"),
        "RVM, prior by the evidence": rvm_by_evidence(options),
        "RVM, ARD, width by evidence": evidence_rvm(options),
        "sum of the correlations": sum_of_correlations,
    }
    scores = {
        name: leave_one_out(*chosen, machine, options.folds) for name, machine in machines.items()
    }
    of_the_paper = ("RVM", "SVM", "sum of the correlations")
    results.curves["fig6"] = {label: roc(scores[label], searched) for label in of_the_paper}
    results.curves["machines"] = {
        label: roc(machine_scores, searched) for label, machine_scores in scores.items()
    }
    for label, machine_scores in scores.items():
        results.add_areas(f"fig6 {label}", machine_scores, searched, count)
    few = thin_examples(chosen, options.examples, settings.seed)
    compared = {name: machine for name, machine in machines.items() if "polynomial" not in name}
    del compared["sum of the correlations"]
    loo = {name: leave_one_out(*few, machine, options.folds) for name, machine in compared.items()}
    results.curves["fig6 as many examples"] = {
        label: roc(loo[label], open_area(few, settings)) for label in ("RVM", "SVM")
    }
    results.notes["vectors, leave-one-out"] = {
        "examples": len(few[0]),
        "mines": int((few[0]["kind"] != "clutter").sum()),
        **{
            label: float(machine_scores.vector_share.mean())
            for label, machine_scores in loo.items()
        },
    }
    results.notes["vectors by fold"] = {
        label: machine_scores.vector_share.tolist() for label, machine_scores in loo.items()
    }
    own = "RVM, ARD, width by evidence"
    measure = Measure(searched)
    results.judge("machines", difference(scores["RVM"], scores["SVM"], measure, count))
    results.judge("relevance-share", spread_of_folds(loo["RVM"].vector_share))
    results.judge("support-share", spread_of_folds(loo["SVM"].vector_share))
    results.judge("sparser", ratio_interval(loo["RVM"].vector_share, loo["SVM"].vector_share))
    results.judge("own", difference(scores[own], scores["RVM"], measure, count))
    results.judge("own-sparser", ratio_interval(loo[own].vector_share, loo["RVM"].vector_share))
    results.judge("kernel", difference(scores["RVM"], scores["RVM polynomial"], measure, count))
    return results


def thin_examples(examples: Examples, most: tuple[int, int], seed: int) -> Examples:
    """Draw as many mines and clutter examples as the paper had, or as there are."""
    table, X = examples
    rng = np.random.default_rng(seed)
    mine_rows = np.flatnonzero(table["kind"] != "clutter")
    clutter = np.flatnonzero(table["kind"] == "clutter")
    counts = min(most[0], len(mine_rows)), min(most[1], len(clutter))
    rows = np.sort(
        np.concatenate(
            [rng.choice(mine_rows, counts[0], False), rng.choice(clutter, counts[1], False)]
        )
    )
    return table.iloc[rows].reset_index(drop=True), X[rows]


def unscreened(material: Material) -> Results:
    """Fig. 7 to 9: metal and plastic without prescreener, by depth, and by novelty detectors.

    Both polarizations.
    """
    settings = material.settings
    examples = material.examples[1]
    results = Results()
    options = settings.classify
    count = settings.classify.bootstrap
    binary: dict[str, HeldOut] = {}
    searched = open_area(examples, settings)
    measure = Measure(searched)
    for kind in ("metal", "plastic"):
        chosen = pick_examples(examples, (kind,))
        binary[kind] = leave_one_out(*chosen, rvm(options), options.folds)
        baseline = leave_one_out(*chosen, sum_of_correlations, options.folds)
        novel = {
            name: leave_one_out(*chosen, one_class(options, name), options.folds, novelty=True)
            for name in NOVELTY_RIVALS
        }
        results.curves.setdefault("fig7", {})[kind] = roc(binary[kind], searched)
        results.curves["fig7"][f"{kind}, sum of the correlations"] = roc(baseline, searched)
        results.curves.setdefault("fig9", {})[kind] = roc(novel[NOVELTY_RIVALS[0]], searched)
        results.add_areas(f"fig7 {kind}", binary[kind], searched, count)
        results.add_areas(f"fig7 {kind}, sum of the correlations", baseline, searched, count)
        by_mine = held_out(*chosen, rvm(options), options.folds)
        results.add_areas(
            f"fig7 {kind}, both looks at a mine held out together", by_mine, searched, count
        )
        again = retrained(*chosen, rvm(options), options.folds, max(count // 80, 4))
        retrained_name = f"fig7 {kind}, both looks held out, trained anew in every draw"
        results.areas[retrained_name] = spread(auc(by_mine), again, bounds=SHARE)
        for name, scores in novel.items():
            results.add_areas(f"fig9 {kind}, one-class {name}", scores, searched, count)
        gaps = {
            name: difference(binary[kind], scores, measure, count)
            for name, scores in novel.items()
            if "rvm" in name
        }
        results.judge_all("novelty", gaps, kind=kind)
        results.judge("plain-sum", difference(binary[kind], baseline, measure, count), kind=kind)
    results.judge("plastic", measure.interval(binary["plastic"], count))
    results.judge("comparable", difference(binary["metal"], binary["plastic"], measure, count))
    _depths(searched, pick_examples(examples, ("plastic",)), binary["plastic"], results)
    return results


def _depths(searched: float, chosen: Examples, scores: HeldOut, results: Results) -> None:
    """Fig. 8: plastic mines on the surface, flush and 5 cm deep, against all depths."""
    table = chosen[0]
    depth = table["depth"].to_numpy()[(table["kind"] != "clutter").to_numpy()]
    flush = (depth > SURFACE) & (depth <= 0.025)
    sets = {
        "surface": depth <= SURFACE,
        "flush": flush,
        "5 cm": (depth > 0.025) & (depth <= SHALLOW),
        "all depths": np.ones(depth.size, np.bool_),
    }
    for label, rows in sets.items():
        if not rows.any():
            continue
        subset = HeldOut(
            scores.mine[rows], scores.clutter, scores.target[rows], scores.tile, scores.vector_share
        )
        results.curves.setdefault("fig8", {})[label] = roc(subset, searched)
    for far in (0.04, 0.07):
        shallow, deep = (
            pd_count(scores, searched, far, rows) for rows in (depth <= SHALLOW, depth > SHALLOW)
        )
        results.judge("depth", difference_of_shares(shallow, deep), far=far)


def between_sites(material: Material) -> Results:
    """Fig. 10: trained at one site, with its templates, and tested at the other; buried mines."""
    settings = material.settings
    sites = material.sites
    results = Results()
    options = settings.classify
    count = settings.classify.bootstrap
    for first, second in ((0, 1), (1, 0)):
        direction = f"{sites[first].name} to {sites[second].name}"
        claimed = first == 0  # the paper trains at the arid site and speaks of no other way
        seen_examples = open_examples(settings, sites[second], material.templates[first])
        searched = open_area(seen_examples, settings)
        measure = Measure(searched)
        novel: dict[str, dict[str, HeldOut]] = {}
        for kind in ("metal", "plastic"):
            train, test = (
                pick_examples(examples, (kind,), (SURFACE, 1.0))
                for examples in (material.examples[first], seen_examples)
            )
            novel[kind] = {
                name: across(train, test, one_class(options, name)) for name in NOVELTY_RIVALS
            }
            binary = across(train, test, rvm(options))
            baseline = across(train, test, sum_of_correlations)
            figure = results.curves.setdefault(f"fig10 {direction}", {})
            examples = novel[kind][NOVELTY_RIVALS[0]]
            figure |= {
                f"{kind}, one-class": roc(examples, searched),
                f"{kind}, binary": roc(binary, searched),
            }
            for name, scores in {
                **{f"one-class {n}": s for n, s in novel[kind].items()},
                "binary": binary,
            }.items():
                results.add_areas(f"fig10 {direction}, {kind}, {name}", scores, searched, count)
            results.add_areas(
                f"fig10 {direction}, {kind}, sum of the correlations", baseline, searched, count
            )
            if claimed:
                gaps = {
                    n: difference(binary, s, measure, count)
                    for n, s in novel[kind].items()
                    if "rvm" in n
                }
                results.judge_all("carries-binary", gaps, kind=kind)
        machines = [name for name in NOVELTY_RIVALS if "rvm" in name]
        for kind in ("metal", "plastic"):
            intervals = {name: measure.interval(novel[kind][name], count) for name in machines}
            if claimed:
                results.judge_all("carries", intervals, kind=kind, way=direction)
            else:
                results.judge("carries-back", intervals[machines[0]], kind=kind, way=direction)
        if claimed:
            gaps = {
                name: difference(novel["metal"][name], novel["plastic"][name], measure, count)
                for name in machines
            }
            results.judge_all("carries-metal", gaps, way=direction)
    return results


def variants(material: Material) -> Results:
    """Try other templates and complex correlation, without prescreener.

    Both polarizations, binary RVM, all depths.
    """
    settings = material.settings
    results = Results()
    options = settings.classify
    count = settings.classify.bootstrap
    summary: dict[str, Any] = {}
    for site in material.sites:
        for kind in ("metal", "plastic"):
            scores: dict[str, HeldOut] = {}
            for name, variant in VARIANTS.items():
                variant_templates = make_templates(settings, site, variant)
                chosen = pick_examples(
                    open_examples(settings, site, variant_templates, variant.magnitude), (kind,)
                )
                scores[name] = held_out(*chosen, rvm(options), options.folds)
            main = next(name for name, variant in VARIANTS.items() if variant == MAIN)
            measure = Measure(open_area(chosen, settings))
            summary[f"{site.name}, {kind}"] = {
                name: {
                    "area": measure.interval(variant_scores, count),
                    "less the main one": difference(variant_scores, scores[main], measure, count),
                }
                for name, variant_scores in scores.items()
            }
    results.notes["templates"] = summary
    return results


JUDGED: dict[str, Callable[[Material], Results]] = {
    "templates": templates,
    "screened": screened,
    "signature strength": signature_strength,
    "sparsity": sparsity,
    "unscreened": unscreened,
    "between sites": between_sites,
}
"""Parts that statements of the paper are judged by."""
PARTS = {"sizes": sizes, **JUDGED, "other screens": other_screens, "variants": variants}

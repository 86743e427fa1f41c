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
    HeldOut,
    Site,
    across,
    evidence_rvm,
    held_out,
    learn_screen,
    make_templates,
    one_class,
    open_examples,
    retrained,
    rvm,
    screened_examples,
    screened_regions,
    signatures,
    svm,
)
from flgpr_papers.flsar2004.findings import (
    auc,
    auc_difference,
    auc_interval,
    component_interval,
    likeness_interval,
    pd_count,
    proportion,
    ratio_interval,
    roc,
)
from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.kit.findings import Finding, Interval, difference_of_shares, measured, spread
from flgpr_papers.kit.settings import packaged_text

FloatArray = NDArray[np.float64]
Examples = tuple[pd.DataFrame, FloatArray]
SHALLOW = 0.06
"""Depth up to which the paper's first three depths lie, m, with their scatter."""
_STATEMENTS = tomllib.loads(packaged_text("flsar2004", "statements"))


@dataclass
class Results:
    """What a part yields."""

    curves: dict[str, dict[str, pd.DataFrame]] = field(default_factory=dict)  #: ROC by figure and label
    areas: dict[str, tuple[float, float, float]] = field(default_factory=dict)  #: areas under ROCs with their intervals
    findings: list[Finding] = field(default_factory=list)
    notes: dict[str, Any] = field(default_factory=dict)  #: what else is told, as JSON can hold it

    def judge(self, statement: str, interval: Interval, **words: Any) -> None:
        """Judge a statement of ``statements.toml`` by the interval of its number."""
        one = _STATEMENTS[statement]
        rule = tuple(one["rule"]) if "rule" in one else None
        self.findings.append(measured(one["claim"].format(**words), one["paper"], one["quantity"], interval, rule))

    def add(self, other: Results) -> None:
        """Take another part's results in."""
        self.curves |= other.curves
        self.areas |= other.areas
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
    return Material(settings, sites, templates, [open_examples(settings, site, one) for site, one in pairs])


def sizes(material: Material) -> Results:
    """Count the examples and tell how well the fiducials register the images."""
    results = Results()
    results.notes["examples"] = {
        site.name: {kind: int(count) for kind, count in table["kind"].value_counts().items()}
        for site, (table, _) in zip(material.sites, material.examples, strict=True)
    }
    results.notes["registration"] = {
        site.name: {
            name: {"shift": list(found.shift), "residual": found.residual, "fiducials": found.used}
            for name, found in site.registration.items()
        }
        for site in material.sites
    }
    return results


def _pick(
    examples: Examples, kinds: tuple[str, ...], depth: tuple[float, float] = (-1.0, 1.0), columns: str = "both"
) -> Examples:
    """Examples of some kinds of mines between two depths, and all clutter; features of one or both polarizations."""
    table, X = examples
    mine = table["kind"].isin(kinds) & table["depth"].between(*depth)
    rows = np.flatnonzero(mine | (table["kind"] == "clutter"))
    half = X.shape[1] // 2
    parts = {"both": slice(None), "HH": slice(0, half), "VV": slice(half, None)}
    return table.iloc[rows].reset_index(drop=True), X[rows][:, parts[columns]]


def _open_area(examples: Examples, settings: Settings) -> float:
    """Area of the clutter tiles, m²: what was searched beside the mines."""
    count = int((examples[0]["kind"] == "clutter").sum())
    return count * settings.features.region[0] * settings.features.region[1]


def templates(material: Material) -> Results:
    """Principal components, and how alike the sites are (par. 19 and 24)."""
    settings, sites, results = material.settings, material.sites, Results()
    chips = [signatures(settings, site, False)[0] for site in sites]
    share, cosine = component_interval(chips[0], settings.classify.bootstrap)
    results.judge("component", share)
    results.judge("component-mean", cosine)
    results.judge("templates", likeness_interval(chips[0], chips[1], settings.classify.bootstrap))
    results.notes["energy of the first component"] = {
        f"{site.name}, {'magnitudes' if magnitude else 'complex'}": _first_share(settings, site, magnitude)
        for site in sites
        for magnitude in (True, False)
    }
    return results


def _first_share(settings: Settings, site: Site, magnitude: bool) -> float:
    chips = signatures(settings, site, False, magnitude)[0]
    return float(np.mean([principal_templates(chips[:, p, r], 1)[1][0] for p, r in np.ndindex(*chips.shape[1:3])]))


def screened(material: Material) -> Results:
    """Fig. 5: metal mines flush and at 5 cm, with prescreeners; and what becomes of the plastic ones."""
    settings, sites, results = material.settings, material.sites, Results()
    peaks, passed = [], {}
    for site, template in zip(sites, material.templates, strict=True):
        scores: dict[str, HeldOut] = {}
        figure: dict[str, pd.DataFrame] = {}
        screen = learn_screen(settings, site)
        for label, polarizations in (("HH", ("HH",)), ("VV", ("VV",)), ("both", POLARIZATIONS)):
            regions = screened_regions(site, screen, polarizations)
            examples = screened_examples(settings, site, template, regions)
            if label == "both":
                passed[site.name] = (examples[0], _offered(site))
            chosen = _pick(examples, ("metal",), (-0.05, SHALLOW), label)
            wanted = _offered(site, "metal", (-0.05, SHALLOW))
            if (chosen[0]["kind"] == "metal").sum() < 6 or (chosen[0]["kind"] == "clutter").sum() < 6:
                results.notes[f"fig5 {site.name} {label}"] = "too few examples pass the prescreeners"
                continue
            scores[label] = held_out(*chosen, rvm(settings.classify), settings.classify.folds)
            figure[label] = roc(scores[label], site.area, wanted)
            if label == "both":
                peaks.append((int((chosen[0]["kind"] == "metal").sum()), wanted))
        results.curves[f"fig5 {site.name}"] = figure
        if len(scores) == 3:
            for label in ("HH", "VV"):
                gap = auc_difference(scores["both"], scores[label], settings.classify.bootstrap)
                results.judge("fusion", gap, site=site.name, label=label)
    if len(peaks) == 2:
        results.judge("peak", difference_of_shares(*peaks))
    for kind in ("plastic", "metal"):
        examples_table, offered = passed[sites[0].name]
        count = int((examples_table["kind"] == kind).sum())
        results.judge(f"screened-{kind}", proportion(count, int(offered[kind])))
    return results


def other_screens(material: Material) -> Results:
    """Note what other prescreening would do: thresholds learnt on plastic mines too, "and" over all six images."""
    settings, site, template, results = material.settings, material.sites[0], material.templates[0], Results()
    kinds = ("metal", "plastic")
    learnt, offered = learn_screen(settings, site), _offered(site)
    tried = {
        "prescreened": screened_regions(site, learnt, POLARIZATIONS),
        "prescreened, and over all six images": screened_regions(site, learnt, POLARIZATIONS, "and"),
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


def _offered(site: Site, kind: str | None = None, depth: tuple[float, float] = (-1.0, 1.0)) -> Any:
    """Count the mines outside the subset: of one kind between two depths, or of every kind."""
    mines = site.mines[~site.mines["subset"]]
    if kind is None:
        return mines["kind"].value_counts()
    return int(((mines["kind"] == kind) & mines["depth"].between(*depth)).sum())


def sparsity(material: Material) -> Results:
    """Fig. 6: metal mines down to 5 cm, VV, temperate, no prescreener; RVM against SVM, RBF against polynomials."""
    settings, results = material.settings, Results()
    chosen = _pick(material.examples[1], ("metal",), (-1.0, SHALLOW), "VV")
    area = _open_area(chosen, settings)
    options, folds, count = settings.classify, settings.classify.folds, settings.classify.bootstrap
    scores = {
        "RVM": held_out(*chosen, rvm(options), folds),
        "SVM": held_out(*chosen, svm(options), folds),
        "RVM polynomial": held_out(*chosen, rvm(options, "poly"), folds),
        "SVM polynomial": held_out(*chosen, svm(options, "poly"), folds),
        "RVM, ARD, width by evidence": held_out(*chosen, evidence_rvm(options), folds),
    }
    results.curves["fig6"] = {label: roc(one, area) for label, one in scores.items()}
    results.areas |= {f"fig6 {label}": auc_interval(one, count) for label, one in scores.items()}
    few = _thin(chosen, options.examples, settings.seed)
    machines = {"RVM": rvm(options), "SVM": svm(options), "RVM, ARD, width by evidence": evidence_rvm(options)}
    loo = {name: held_out(*few, machine, None) for name, machine in machines.items()}
    results.curves["fig6 leave-one-out"] = {label: roc(one, _open_area(few, settings)) for label, one in loo.items()}
    results.notes["vectors, leave-one-out"] = {
        "examples": len(few[0]),
        "mines": int((few[0]["kind"] != "clutter").sum()),
        **{label: float(one.kept.mean()) for label, one in loo.items()},
    }
    results.notes["vectors by fold"] = {label: one.kept.tolist() for label, one in loo.items()}
    own = "RVM, ARD, width by evidence"
    results.judge("machines", auc_difference(scores["RVM"], scores["SVM"], count))
    results.judge("machines-loo", auc_difference(loo["RVM"], loo["SVM"], count))
    results.judge("sparser", ratio_interval(loo["RVM"].kept, loo["SVM"].kept))
    results.judge("own", auc_difference(scores[own], scores["RVM"], count))
    results.judge("own-sparser", ratio_interval(loo[own].kept, loo["RVM"].kept))
    results.judge("kernel", auc_difference(scores["RVM"], scores["RVM polynomial"], count))
    return results


def _thin(examples: Examples, most: tuple[int, int], seed: int) -> Examples:
    """Draw as many mines and clutter examples as the paper had, or as there are."""
    table, X = examples
    rng = np.random.default_rng(seed)
    mine = np.flatnonzero(table["kind"] != "clutter")
    clutter = np.flatnonzero(table["kind"] == "clutter")
    wanted = min(most[0], len(mine)), min(most[1], len(clutter))
    rows = np.sort(np.concatenate([rng.choice(mine, wanted[0], False), rng.choice(clutter, wanted[1], False)]))
    return table.iloc[rows].reset_index(drop=True), X[rows]


def unscreened(material: Material) -> Results:
    """Fig. 7 to 9: metal and plastic without prescreener, by depth, and by novelty detectors; both polarizations."""
    settings, examples, results = material.settings, material.examples[1], Results()
    options, count = settings.classify, settings.classify.bootstrap
    binary: dict[str, HeldOut] = {}
    novel: dict[str, HeldOut] = {}
    for kind in ("metal", "plastic"):
        chosen = _pick(examples, (kind,))
        area = _open_area(chosen, settings)
        binary[kind] = held_out(*chosen, rvm(options), options.folds)
        rivals = {
            name: held_out(*chosen, one_class(options, name), options.folds, True) for name in ("rvm", "svm", "gmm")
        }
        novel[kind] = rivals["rvm"]
        results.curves.setdefault("fig7", {})[kind] = roc(binary[kind], area)
        results.curves.setdefault("fig9", {})[kind] = roc(novel[kind], area)
        results.areas[f"fig7 {kind}"] = auc_interval(binary[kind], count)
        again = retrained(*chosen, rvm(options), options.folds, max(count // 80, 4))
        results.areas[f"fig7 {kind}, trained anew in every draw"] = spread(auc(binary[kind]), again)
        for name, one in rivals.items():
            results.areas[f"fig9 {kind}, one-class {name}"] = auc_interval(one, count)
        results.judge("novelty", auc_difference(binary[kind], novel[kind], count), kind=kind)
    results.judge("plastic", auc_interval(binary["plastic"], count))
    results.judge("comparable", auc_difference(binary["metal"], binary["plastic"], count))
    _depths(settings, _pick(examples, ("plastic",)), binary["plastic"], results)
    return results


def _depths(settings: Settings, chosen: Examples, scores: HeldOut, results: Results) -> None:
    """Fig. 8: plastic mines by depth."""
    table = chosen[0]
    depth = table["depth"].to_numpy()[(table["kind"] != "clutter").to_numpy()]
    area = _open_area(chosen, settings)
    for label, rows in (("to 5 cm", depth <= SHALLOW), ("10 and 15 cm", depth > SHALLOW), ("all", depth > -1)):
        part = HeldOut(scores.mine[rows], scores.clutter, scores.target[rows], scores.tile, scores.kept)
        results.curves.setdefault("fig8", {})[label] = roc(part, area)
    for far in (0.04, 0.07):
        shallow, deep = (pd_count(scores, area, far, rows) for rows in (depth <= SHALLOW, depth > SHALLOW))
        results.judge("depth", difference_of_shares(shallow, deep), far=far)


def between_sites(material: Material) -> Results:
    """Fig. 10: trained at one site, with its templates, and tested at the other; buried mines."""
    settings, sites, results = material.settings, material.sites, Results()
    options, count = settings.classify, settings.classify.bootstrap
    for first, second in ((0, 1), (1, 0)):
        way = f"{sites[first].name} to {sites[second].name}"
        seen = open_examples(settings, sites[second], material.templates[first])
        novel: dict[str, HeldOut] = {}
        for kind in ("metal", "plastic"):
            train, test = (_pick(one, (kind,), (-0.05, 1.0)) for one in (material.examples[first], seen))
            novel[kind] = across(train, test, one_class(options))
            binary = across(train, test, rvm(options))
            area = _open_area(test, settings)
            figure = results.curves.setdefault(f"fig10 {way}", {})
            figure |= {f"{kind}, one-class": roc(novel[kind], area), f"{kind}, binary": roc(binary, area)}
            results.areas[f"fig10 {way}, {kind}, one-class"] = auc_interval(novel[kind], count)
            results.areas[f"fig10 {way}, {kind}, binary"] = auc_interval(binary, count)
        results.judge("carries", auc_interval(novel["metal"], count), way=way)
        results.judge("carries-metal", auc_difference(novel["metal"], novel["plastic"], count), way=way)
    return results


def variants(material: Material) -> Results:
    """Try other templates and complex correlation, without prescreener; both polarizations, binary RVM, all depths."""
    settings, results = material.settings, Results()
    options, count = settings.classify, settings.classify.bootstrap
    told: dict[str, Any] = {}
    for site in material.sites:
        for kind in ("metal", "plastic"):
            scores: dict[str, HeldOut] = {}
            for name, variant in VARIANTS.items():
                made = make_templates(settings, site, variant)
                chosen = _pick(open_examples(settings, site, made, variant.magnitude), (kind,))
                scores[name] = held_out(*chosen, rvm(options), options.folds)
            main = next(name for name, variant in VARIANTS.items() if variant == MAIN)
            told[f"{site.name}, {kind}"] = {
                name: {"area": auc_interval(one, count), "less the main one": auc_difference(one, scores[main], count)}
                for name, one in scores.items()
            }
    results.notes["templates"] = told
    return results


JUDGED: dict[str, Callable[[Material], Results]] = {
    "templates": templates,
    "screened": screened,
    "sparsity": sparsity,
    "unscreened": unscreened,
    "between sites": between_sites,
}
"""Parts that statements of the paper are judged by."""
PARTS = {"sizes": sizes, **JUDGED, "other screens": other_screens, "variants": variants}

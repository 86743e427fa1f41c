"""Experiments of flsar2004 with prescreeners (Sec. 3): Fig. 5, and what else could be screened."""

from __future__ import annotations

from typing import Any

import pandas as pd

from flgpr.stages.clusters import ClusterScreen
from flgpr_papers.flsar2004.examples import (
    POLARIZATIONS,
    Site,
    clutter_past_prescreeners,
    learn_screen,
    screened_examples,
    screened_regions,
)
from flgpr_papers.flsar2004.findings import Measure, difference, proportion, roc
from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.flsar2004.machines import HeldOut, leave_one_out, rvm, with_lost
from flgpr_papers.flsar2004.material import (
    SHALLOW,
    SURFACE,
    Examples,
    Material,
    Results,
    pick_examples,
)
from flgpr_papers.kit.findings import difference_of_shares

FEWEST_EXAMPLES = 6
"""Looks at mines, and clutter regions, that a classifier of Fig. 5 needs past the prescreeners."""
FIG5_FAR = 0.04
"""False alarms per m² at which the curves of Fig. 5 are compared.

It is the lower end of what the paper names (par. 50).
"""
_KINDS = ("metal", "plastic")


def screened(material: Material) -> Results:
    """Run Fig. 5: metal mines flush and at 5 cm, with prescreeners.

    What the second prescreener adds, and what becomes of plastic mines, is measured, too.

    Parameters
    ----------
    material : Material
        Both sites.
    """
    settings = material.settings
    results = Results()
    passed_shares = []
    examples_by_site: dict[str, Examples] = {}
    for site, template in zip(material.sites, material.templates, strict=True):
        screen = learn_screen(settings, site)
        offered = _offered_looks(site, ("metal",), (SURFACE, SHALLOW))
        scores: dict[str, HeldOut] = {}
        results.curves[f"fig5 {site.name}"] = {}
        for label, polarizations in (("HH", ("HH",)), ("VV", ("VV",)), ("both", POLARIZATIONS)):
            regions = screened_regions(site, screen, polarizations)
            examples = screened_examples(settings, site, template, regions)
            if label == "both":
                examples_by_site[site.name] = examples
            chosen = pick_examples(examples, ("metal",), (SURFACE, SHALLOW), label)
            passed = _classify_passed(settings, site, label, chosen, offered, results)
            if passed is not None:
                scores[label] = passed
                if label == "both":
                    mines = int((chosen[0]["kind"] == "metal").sum())
                    passed_shares.append((mines, len(offered)))
        if len(scores) == len(POLARIZATIONS) + 1:
            _judge_polarizations(settings, site, scores, results)
        _count_clutter(settings, site, screen, results)
    if len(passed_shares) == 2:
        results.judge("peak", difference_of_shares(*passed_shares))
    first_site = material.sites[0]
    _judge_kinds(first_site, examples_by_site[first_site.name], results)
    return results


def _classify_passed(
    settings: Settings,
    site: Site,
    label: str,
    chosen: Examples,
    offered: pd.DataFrame,
    results: Results,
) -> HeldOut | None:
    """Score what passes the prescreeners, lost mines included; None if it is too little.

    The curve is added to those of Fig. 5.
    """
    table, _ = chosen
    is_metal = table["kind"] == "metal"
    mines = int(is_metal.sum())
    clutter = int((~is_metal).sum())
    if min(mines, clutter) < FEWEST_EXAMPLES:
        results.details[f"fig5 {site.name} {label}"] = (
            f"{mines} of {len(offered)} looks at mines and {clutter} clutter regions pass;"
            f" a classifier needs {FEWEST_EXAMPLES} of each"
        )
        return None
    options = settings.classify
    held_out_scores = leave_one_out(*chosen, rvm(options), options.folds)
    curve = roc(held_out_scores, site.area, len(offered))
    results.curves[f"fig5 {site.name}"][label] = curve
    return with_lost(held_out_scores, table[is_metal], offered)


def _judge_polarizations(
    settings: Settings, site: Site, scores: dict[str, HeldOut], results: Results
) -> None:
    """Judge the fusion of polarizations, and VV against HH, at a site."""
    draws = settings.classify.bootstrap
    measure = Measure(site.area, FIG5_FAR, at=True)
    for label in POLARIZATIONS:
        gap = difference(scores["both"], scores[label], measure, draws)
        results.judge("fusion", gap, site=site.name, label=label)
    gap = difference(scores["VV"], scores["HH"], measure, draws)
    results.judge("polarizations", gap, site=site.name)


def _count_clutter(settings: Settings, site: Site, screen: ClusterScreen, results: Results) -> None:
    """Count the clutter past each prescreener of a site, and judge what the second one removes."""
    first, second, third = clutter_past_prescreeners(site, screen, settings.prescreen.halo)
    results.details[f"prescreeners one after the other, {site.name}"] = {
        "clutter clusters past amplitude and size": first,
        "past standard deviation too": second,
        "past the ellipse too": third,
    }
    if first:
        results.judge("second-prescreener", proportion(first - second, first), site=site.name)


def _judge_kinds(site: Site, examples: Examples, results: Results) -> None:
    """Judge how many metal and plastic mines of a site pass the prescreeners."""
    table, _ = examples
    offered = _offered(site)
    shares = {}
    for kind in _KINDS:
        shares[kind] = (int((table["kind"] == kind).sum()), int(offered[kind]))
    results.judge("screened-plastic", proportion(*shares["plastic"]))
    results.judge("screened-metal", difference_of_shares(shares["metal"], shares["plastic"]))


def _offered_looks(site: Site, kinds: tuple[str, ...], depth: tuple[float, float]) -> pd.DataFrame:
    """Return the mines outside the subset of some kinds between two depths, a row per drive."""
    mines = site.mines[~site.mines["subset"]]
    return mines[mines["kind"].isin(kinds) & mines["depth"].between(*depth)].reset_index(drop=True)


def _offered(site: Site) -> Any:
    """Return the number of mines outside the subset, by kind."""
    return site.mines[~site.mines["subset"]]["kind"].value_counts()


def other_screens(material: Material) -> Results:
    """Count what other prescreening would pass at the arid site.

    The thresholds are learnt on plastic mines, too, or the images are joined by "and" over all six.

    Parameters
    ----------
    material : Material
        Both sites.
    """
    settings = material.settings
    site = material.sites[0]
    results = Results()
    screen = learn_screen(settings, site)
    screen_of_both = learn_screen(settings, site, _KINDS)
    tried = {
        "prescreened": screened_regions(site, screen, POLARIZATIONS),
        "prescreened, and over all six images": screened_regions(
            site, screen, POLARIZATIONS, "and"
        ),
        "prescreened, thresholds learnt on metal and plastic": screened_regions(
            site, screen_of_both, POLARIZATIONS
        ),
    }
    offered = _offered(site)
    for name, regions in tried.items():
        table, _ = screened_examples(settings, site, material.templates[0], regions)
        counts = table["kind"].value_counts()
        passed: dict[str, Any] = {}
        for kind in _KINDS:
            passed[kind] = f"{int(counts.get(kind, 0))} of {int(offered[kind])} pass"
        passed["clutter regions per m²"] = int(counts.get("clutter", 0)) / site.area
        results.details[f"{name}, {site.name}"] = passed
    return results

"""The parts of the experiment of flsar2004, Sec. 3 and 4, in order.

Parts that compare machines, depths and sites without prescreener stand in `comparisons`. Here are
those about signatures, templates and prescreeners, and the table of all parts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from flgpr.features import principal_templates
from flgpr.stages.clusters import ClusterScreen
from flgpr_papers.flsar2004.comparisons import KINDS, between_sites, sparsity, unscreened, variants
from flgpr_papers.flsar2004.examples import (
    POLARIZATIONS,
    Site,
    clutter_past_prescreeners,
    learn_screen,
    screened_examples,
    screened_regions,
    signatures,
)
from flgpr_papers.flsar2004.findings import (
    Measure,
    component_interval,
    difference,
    likeness_interval,
    stronger_interval,
)
from flgpr_papers.flsar2004.lanes import RadiusIs
from flgpr_papers.flsar2004.machines import Examples, HeldOut, leave_one_out, rvm, with_lost
from flgpr_papers.flsar2004.material import SHALLOW, SURFACE, Material, Results, pick_examples
from flgpr_papers.kit.intervals import difference_of_shares, proportion

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
            shares = []
            for polarization, distance in np.ndindex(*chips.shape[1:3]):
                shares.append(principal_templates(chips[:, polarization, distance], 1)[1][0])
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
    depth = np.round(mines["depth"].to_numpy(dtype=np.float64) / 0.05) * 0.05
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
        tables.append(examples[0])
        if "both" in scores:
            passed_shares.append((int((chosen[0]["kind"] == "metal").sum()), len(offered)))
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
    table, _ = chosen
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
    scores = leave_one_out(*chosen, rvm(options), options.folds)
    results.add_curve(f"fig5 {case}", label, scores, site.area, len(offered))
    return with_lost(scores, table[is_metal], offered)


def _judge_polarizations(
    material: Material, site: Site, scores: dict[str, HeldOut], results: Results
) -> None:
    """Judge the fusion of polarizations, and VV against HH, at a site."""
    measure = Measure(site.area, FIG5_FAR, at=True)
    for label in POLARIZATIONS:
        gap = difference(scores["both"], scores[label], measure, material.draws)
        results.judge("fusion", gap, site=site.name, label=label)
    gap = difference(scores["VV"], scores["HH"], measure, material.draws)
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
        table, _ = screened_examples(settings, site, material.templates[0], regions)
        counts = table["kind"].value_counts()
        passed: dict[str, Any] = {}
        for kind in KINDS:
            passed[kind] = f"{int(counts.get(kind, 0))} of {int(offered[kind])} pass"
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

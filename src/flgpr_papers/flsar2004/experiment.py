"""The parts of the experiment of flsar2004, Sec. 3 and 4, in order.

Parts with prescreeners stand in `prescreened`, those that compare machines, depths and sites in
`comparisons`. Here are the parts about signatures and templates, and the table of all parts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from flgpr.features import principal_templates
from flgpr_papers.flsar2004.comparisons import between_sites, sparsity, unscreened, variants
from flgpr_papers.flsar2004.examples import Site, signatures
from flgpr_papers.flsar2004.findings import (
    component_interval,
    likeness_interval,
    stronger_interval,
)
from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.flsar2004.material import Material, Results
from flgpr_papers.flsar2004.prescreened import other_screens, screened


def sizes(material: Material) -> Results:
    """Count the examples, and record how well the fiducials register the images.

    Parameters
    ----------
    material : Material
        Both sites.
    """
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
    results.details["examples"] = counts
    results.details["registration"] = registration
    return results


def templates(material: Material) -> Results:
    """Judge the principal components, and how alike the sites are (par. 19 and 24).

    Parameters
    ----------
    material : Material
        Both sites.
    """
    settings = material.settings
    draws = settings.classify.bootstrap
    results = Results()
    arid_site, temperate_site = material.sites
    arid, _ = signatures(settings, arid_site, False)
    temperate, _ = signatures(settings, temperate_site, False)
    share, cosine = component_interval(arid, draws)
    results.judge("component", share)
    results.judge("component-mean", cosine)
    results.judge("templates", likeness_interval(arid, temperate, draws))
    energy = {}
    for site in material.sites:
        for magnitude in (True, False):
            values = "magnitudes" if magnitude else "complex"
            energy[f"{site.name}, {values}"] = _first_share(settings, site, magnitude)
    results.details["energy of the first component"] = energy
    return results


def _first_share(settings: Settings, site: Site, magnitude: bool) -> float:
    """Return the mean share of energy in the first principal component."""
    chips, _ = signatures(settings, site, False, magnitude)
    shares = []
    for polarization, distance in np.ndindex(*chips.shape[1:3]):
        _, energy = principal_templates(chips[:, polarization, distance], 1)
        shares.append(energy[0])
    return float(np.mean(shares))


def signature_strength(material: Material) -> Results:
    """Judge that plastic signatures are not always stronger at the temperate site (par. 41).

    Parameters
    ----------
    material : Material
        Both sites.
    """
    settings = material.settings
    results = Results()
    arid, temperate = [_plastic_peaks(settings, site) for site in material.sites]
    interval = stronger_interval(temperate, arid, settings.classify.bootstrap)
    results.judge("plastic-not-always-stronger", interval)
    return results


def _plastic_peaks(settings: Settings, site: Site) -> pd.DataFrame:
    """Return the peak of every plastic mine over the clutter, with its depth and target."""
    chips, mines = signatures(settings, site, False)
    clutter = np.median(site.image, axis=(2, 3))[None]
    peak = (chips.max(axis=(3, 4)) / clutter).mean(axis=(1, 2))
    # Mines scatter about their depth: they are compared by steps of 5 cm.
    depth = np.round(mines["depth"].to_numpy(dtype=np.float64) / 0.05) * 0.05
    table = pd.DataFrame({"peak": peak, "depth": depth, "target": mines["target"]})
    return table[(mines["kind"] == "plastic").to_numpy()]


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

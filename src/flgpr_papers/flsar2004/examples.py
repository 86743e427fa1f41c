"""Examples of flsar2004: regions about mines and clutter, and their features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.stages import TrainingView
from flgpr.chain.stages.clusters import (
    ClusterScreen,
    ClusterSettings,
    TemplateSettings,
    templates_of,
)
from flgpr.features import (
    align_phases,
    clutter_tiles,
    cut_regions,
    mean_template,
    principal_templates,
    register_fiducials,
    template_features,
)
from flgpr.features.registration import SurveyOffset
from flgpr.model import Grid, Lane
from flgpr.screen import energy_ratio, find_clusters
from flgpr.screen.clusters import Rule
from flgpr_papers.flsar2004.lanes import Pass, Settings

FloatArray = NDArray[np.float64]
POLARIZATIONS = ("HH", "VV")
ANTENNA_HEIGHT = 3.5


@dataclass(frozen=True)
class Site:
    """Both drives at a site, one behind the other in one strip."""

    name: str
    #: (polarization, range, y, x) images; the phase of the way to the pixel at the middle of the
    #: band is taken out
    wave: NDArray[np.complex64]
    image: NDArray[np.float32]  #: (polarization, range, y, x) their magnitudes
    grid: Grid  #: pixels of the strip
    #: one row per mine and drive: x, y in the strip, kind, depth, target (the same for both
    #: drives), subset
    mines: pd.DataFrame
    lanes: tuple[Lane, ...]  #: the lane in both drives
    registration: dict[
        str, SurveyOffset
    ]  #: of (polarization, range) to the registration by fiducials, drive by drive

    @property
    def view(self) -> xr.DataArray:
        """Magnitudes as the stages of a recipe take them."""
        ranges = np.arange(self.image.shape[1])
        coords = {
            "polarization": list(POLARIZATIONS),
            "subband": ranges,
            "y": self.grid.y,
            "x": self.grid.x,
        }
        return xr.DataArray(self.image, dims=("polarization", "subband", "y", "x"), coords=coords)

    @property
    def area(self) -> float:
        """Area of the lane, counted once per drive, m²."""
        return sum(lane.area for lane in self.lanes)


def join(settings: Settings, drives: Sequence[Pass]) -> Site:
    """Join the drives of a site into one strip and choose the subset.

    The subset is for templates and thresholds.
    """
    first = drives[0].grid
    grid = Grid(first.x_min, first.y_min, first.nx, first.ny * len(drives), first.dx, first.dy)
    mines = []
    lanes = []
    registration = {}
    for k, drive in enumerate(drives):
        offset = k * first.ny * first.dy
        for p, r in np.ndindex(*drive.image.shape[:2]):
            # Focused on the ground, what stands higher appears nearer by height·H/distance.
            known = np.array(drive.fiducials[["x", "y"]], dtype=np.float64)
            known[:, 1] -= (
                drive.fiducials["height"].to_numpy() * ANTENNA_HEIGHT / settings.ranges[r]
            )
            name = f"{drive.direction} {POLARIZATIONS[p]} {settings.ranges[r]:g} m"
            registration[name] = register_fiducials(np.abs(drive.image[p, r]), drive.grid, known)
        shift = np.median(
            [
                registered.shift
                for key, registered in registration.items()
                if key.startswith(drive.direction)
            ],
            axis=0,
        )
        table = drive.truth[["x", "y", "kind", "depth"]].assign(
            target=drive.truth["target_id"], direction=drive.direction
        )
        table["x"] += shift[0]
        table["y"] += shift[1] + offset
        mines.append(table)
        lanes.append(Lane(settings.lane[0], settings.lane[1], offset, settings.length + offset))
    table = pd.concat(mines, ignore_index=True)
    names = np.sort(table["target"].unique())
    rng = np.random.default_rng(settings.seed + settings.sites.index(drives[0].site))
    chosen = rng.choice(names, max(round(settings.features.share * len(names)), 4), replace=False)
    table["subset"] = table["target"].isin(chosen)
    wave = np.concatenate([drive.image for drive in drives], axis=2)
    return Site(drives[0].site, wave, np.abs(wave), grid, table, tuple(lanes), registration)


def signatures(
    settings: Settings, site: Site, subset: bool, magnitude: bool = True
) -> tuple[NDArray[Any], pd.DataFrame]:
    """Cut images of template size about the mines: those of the subset, or all the others."""
    mines = site.mines[site.mines["subset"] == subset].reset_index(drop=True)
    image = site.image if magnitude else site.wave
    return cut_regions(image, site.grid, mines[["x", "y"]], settings.features.template), mines


@dataclass(frozen=True)
class Variant:
    """A way to make templates and to correlate with them."""

    components: int  #: number of principal components; 0 is the mean
    magnitude: bool  #: whether magnitudes are correlated, or complex values


MAIN = Variant(0, True)
VARIANTS = {
    "mean template, magnitudes": MAIN,
    "first component, magnitudes": Variant(1, True),
    "three components, magnitudes": Variant(3, True),
    "mean template, complex": Variant(0, False),
    "first component, complex": Variant(1, False),
    "three components, complex": Variant(3, False),
}


def make_templates(settings: Settings, site: Site, variant: Variant = MAIN) -> NDArray[Any]:
    """Compute templates from the subset's signatures.

    Their shape is (polarization, range, y, x) or (..., component, y, x).

    Complex signatures have any phase, as mines do not lie where they are surveyed to a part of a
    wavelength: they are turned to one phase before they are averaged.
    """
    if variant == MAIN:
        return templates_of([_training(site)], TemplateSettings(**_sizes(settings)))
    chips = signatures(settings, site, True, variant.magnitude)[0]
    channels = []
    for p, r in np.ndindex(*chips.shape[1:3]):
        images = chips[:, p, r]
        channels.append(
            principal_templates(images, variant.components)[0]
            if variant.components
            else mean_template(align_phases(images))
        )
    return np.stack(channels).reshape(*chips.shape[1:3], *channels[0].shape)


def open_examples(
    settings: Settings, site: Site, templates: NDArray[Any], magnitude: bool = True
) -> tuple[pd.DataFrame, FloatArray]:
    """Examples without prescreener.

    Every mine outside the subset, and the tiles of the lane that hold none.
    """
    features = settings.features
    mines = site.mines[~site.mines["subset"]]
    tiles = [
        clutter_tiles(lane, features.region, site.mines[["x", "y"]], features.keep_off).assign(
            clutter=f"{k}"
        )
        for k, lane in enumerate(site.lanes)
    ]
    table = pd.concat([mines, pd.concat(tiles).assign(kind="clutter")], ignore_index=True)
    return _with_features(settings, site, templates, table, magnitude)


def _with_features(
    settings: Settings,
    site: Site,
    templates: NDArray[Any],
    table: pd.DataFrame,
    magnitude: bool = True,
) -> tuple[pd.DataFrame, FloatArray]:
    """Return examples with their correlations with the templates."""
    table = table.assign(site=site.name).drop(columns=["clutter", "subset"], errors="ignore")
    table["target"] = table["target"].fillna("") if "target" in table else ""
    image = site.image if magnitude else site.wave
    regions = cut_regions(image, site.grid, table[["x", "y"]], settings.features.region)
    return table, template_features(regions, templates, magnitude)


def learn_screen(
    settings: Settings, site: Site, kinds: tuple[str, ...] = ("metal",)
) -> ClusterScreen:
    """Train the recipe's prescreeners on the subset's mines of some kinds.

    If there is none of them, all of the subset is used.
    """
    table = ClusterSettings(
        **_sizes(settings),
        radius=settings.prescreen.radius,
        pass_share=settings.prescreen.pass_share,
        reach=settings.prescreen.halo,
        kinds=kinds,
    )
    return ClusterScreen(table, None, ClusterScreen.fit(table, [_training(site)])[0])  # type: ignore[arg-type]


def screened_regions(
    site: Site, screen: ClusterScreen, polarizations: Sequence[str], rule: Rule = "and-or"
) -> pd.DataFrame:
    """Return the regions in the lane that pass in all ranges of a polarization (par. 44).

    The images are joined by "and" (par. 18).
    """
    table = screen.settings.model_copy(update={"polarizations": tuple(polarizations), "rule": rule})
    regions = ClusterScreen(table, screen.setup, screen.learnt).alarms(site.view)
    inside = np.zeros(len(regions), np.bool_)
    for lane in site.lanes:
        inside |= lane.contains(regions["x"], regions["y"])
    return regions[inside].reset_index(drop=True)


def clutter_past_prescreeners(
    site: Site, screen: ClusterScreen, halo: float
) -> tuple[int, int, int]:
    """Count the clusters of clutter, over all images, that pass the prescreeners.

    They are those that pass the first, the second too, and all three.

    Clutter is what lies in the lane and further than ``halo`` (m) from every mine.
    """
    mines = site.mines[["x", "y"]].to_numpy(dtype=np.float64)
    counts = np.zeros(3, dtype=np.int64)
    for channel, (ellipse, limits) in screen.channels(site.view):
        clusters = find_clusters(channel, limits.amplitude, screen.settings.radius)
        x = clusters["x"].to_numpy()
        y = clusters["y"].to_numpy()
        in_lane = np.logical_or.reduce([lane.contains(x, y) for lane in site.lanes])
        distance = np.hypot(x[:, None] - mines[:, 0], y[:, None] - mines[:, 1]).min(axis=1)
        clutter = clusters[in_lane & (distance > halo)]
        large = clutter[clutter["size"] >= limits.size]
        even = large[large["std"] <= limits.std]
        ratio = energy_ratio(channel, even[["x", "y"]].to_numpy(), ellipse)
        counts += [len(large), len(even), int((ratio <= limits.energy_ratio).sum())]
    return int(counts[0]), int(counts[1]), int(counts[2])


def _training(site: Site) -> TrainingView:
    """Show the site to a stage with the subset's mines alone."""
    return TrainingView(site.view, site.mines[site.mines["subset"]], site.lanes[0])


def _sizes(settings: Settings) -> dict[str, Any]:
    """Sizes that the stages of the recipe are told; all of the subset trains them."""
    return {
        "region": settings.features.region,
        "template": settings.features.template,
        "share": 0.999,
    }


def screened_examples(
    settings: Settings, site: Site, templates: NDArray[Any], regions: pd.DataFrame
) -> tuple[pd.DataFrame, FloatArray]:
    """Label regions by the mines within the halo.

    Further regions of one mine, and those of the subset, are dropped.
    """
    mines = site.mines.reset_index(drop=True)
    places = mines[["x", "y"]].to_numpy(dtype=np.float64)
    distance = np.linalg.norm(
        regions[["x", "y"]].to_numpy(dtype=np.float64)[:, None] - places, axis=2
    )
    nearest = distance.argmin(axis=1)
    near = distance[np.arange(len(regions)), nearest] <= settings.prescreen.halo
    label = mines.iloc[nearest][["kind", "depth", "target", "direction", "subset"]].reset_index(
        drop=True
    )
    label.loc[~near, ["kind", "depth", "target", "direction", "subset"]] = [
        "clutter",
        np.nan,
        "",
        "",
        False,
    ]
    table = pd.concat([regions[["x", "y"]], label], axis=1)
    again = table.duplicated(["target", "direction"]) & (table["target"] != "")
    table = table[~again & ~table["subset"].astype(bool)].reset_index(drop=True)
    return _with_features(settings, site, templates, table)

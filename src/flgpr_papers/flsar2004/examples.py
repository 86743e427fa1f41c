"""Examples of flsar2004: regions about mines and clutter, and their features."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.features import (
    SurveyOffset,
    align_phases,
    clutter_tiles,
    cut_regions,
    mean_template,
    principal_templates,
    register_fiducials,
    template_features,
)
from flgpr.model import Grid, Lane
from flgpr.screen import energy_ratio, find_clusters
from flgpr.screen.clusters import Rule
from flgpr.stages import TrainingView
from flgpr.stages.clusters import (
    ClusterScreen,
    ClusterSettings,
    TemplateSettings,
    templates_of,
)
from flgpr.types import AnyArray, BoolArray, ComplexArray, Entries, Float32Array, floats
from flgpr_papers.flsar2004.lanes import Pass, RadiusIs, Settings
from flgpr_papers.flsar2004.machines import Examples

POLARIZATIONS = ("HH", "VV")
ANTENNA_HEIGHT = 3.5
"""Height of the antennas above the ground, m."""


@dataclass(frozen=True)
class Site:
    """Both drives at a site, one behind the other in one strip."""

    name: str
    #: (polarization, range, y, x) images; the phase of the way to the pixel at the middle of the
    #: band is taken out
    wave: ComplexArray
    image: Float32Array  #: (polarization, range, y, x) their magnitudes
    grid: Grid  #: pixels of the strip
    #: one row per mine and drive: x, y in the strip, kind, depth, target (the same for both
    #: drives), subset
    mines: pd.DataFrame
    lanes: tuple[Lane, ...]  #: the lane in both drives
    #: offset of every image from the survey, by direction, polarization and range
    registration: dict[str, SurveyOffset]

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
    """Join the drives of a site into one strip and choose the subset of the mines.

    The subset is for templates and thresholds.

    Parameters
    ----------
    settings : Settings
        The study.
    drives : sequence of Pass
        The drives of a site.
    """
    first = drives[0].grid
    grid = Grid(first.x_min, first.y_min, first.nx, first.ny * len(drives), first.dx, first.dy)
    tables = []
    lanes = []
    registration: dict[str, SurveyOffset] = {}
    for k, drive in enumerate(drives):
        offset = k * first.ny * first.dy
        offsets = _survey_offsets(settings, drive)
        registration |= offsets
        shift_x, shift_y = np.median([known.shift for known in offsets.values()], axis=0)
        table = drive.truth[["x", "y", "kind", "depth"]].assign(
            target=drive.truth["target_id"], direction=drive.direction
        )
        table["x"] += shift_x
        table["y"] += shift_y + offset
        tables.append(table)
        lanes.append(Lane(settings.lane[0], settings.lane[1], offset, settings.length + offset))
    mines = pd.concat(tables, ignore_index=True)
    # A share of all mines, and at least four.
    names = np.sort(mines["target"].unique())
    rng = np.random.default_rng(settings.seed + settings.sites.index(drives[0].site))
    count = max(round(settings.features.share * len(names)), 4)
    mines["subset"] = mines["target"].isin(rng.choice(names, count, replace=False))
    wave = np.concatenate([drive.image for drive in drives], axis=2)
    return Site(drives[0].site, wave, np.abs(wave), grid, mines, tuple(lanes), registration)


def _survey_offsets(settings: Settings, drive: Pass) -> dict[str, SurveyOffset]:
    """Return the offset of every image of a drive from the survey, by its fiducials."""
    offsets = {}
    for p, r in np.ndindex(*drive.image.shape[:2]):
        # Focused on the ground, what stands higher appears nearer by height·H/distance.
        surveyed = np.array(drive.fiducials[["x", "y"]], dtype=np.float64)
        height = drive.fiducials["height"].to_numpy()
        surveyed[:, 1] -= height * ANTENNA_HEIGHT / settings.ranges[r]
        name = f"{drive.direction} {POLARIZATIONS[p]} {settings.ranges[r]:g} m"
        offsets[name] = register_fiducials(np.abs(drive.image[p, r]), drive.grid, surveyed)
    return offsets


def signatures(
    settings: Settings, site: Site, subset: bool, magnitude: bool = True
) -> tuple[AnyArray, pd.DataFrame]:
    """Cut images of template size about the mines: those of the subset, or all the others.

    Parameters
    ----------
    settings : Settings
        The study.
    site : Site
        The site.
    subset : bool
        Whether the mines are those of the subset.
    magnitude : bool
        Whether magnitudes are cut, or complex values.

    Returns
    -------
    chips : (mine, polarization, range, y, x) ndarray
        The images.
    mines : DataFrame
        Their mines.
    """
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


def make_templates(settings: Settings, site: Site, variant: Variant = MAIN) -> AnyArray:
    """Compute templates from the subset's signatures.

    Complex signatures have any phase, as mines do not lie where they are surveyed to a part of a
    wavelength: they are turned to one phase before they are averaged.

    Parameters
    ----------
    settings : Settings
        The study.
    site : Site
        The site.
    variant : Variant
        Kind of the templates.

    Returns
    -------
    (polarization, range, y, x) or (polarization, range, component, y, x) ndarray
        The templates.
    """
    if variant == MAIN:
        return templates_of([_training(site)], TemplateSettings(**_sizes(settings)))
    chips, _ = signatures(settings, site, True, variant.magnitude)
    channels = []
    for p, r in np.ndindex(*chips.shape[1:3]):
        images = chips[:, p, r]
        if variant.components:
            template, _ = principal_templates(images, variant.components)
        else:
            template = mean_template(align_phases(images))
        channels.append(template)
    return np.stack(channels).reshape(*chips.shape[1:3], *channels[0].shape)


def open_examples(
    settings: Settings, site: Site, templates: AnyArray, magnitude: bool = True
) -> Examples:
    """Return the examples without prescreener and their features.

    They are every mine outside the subset, and the tiles of the lane that hold none.

    Parameters
    ----------
    settings : Settings
        The study.
    site : Site
        The site.
    templates : ndarray
        As :func:`make_templates` returns them.
    magnitude : bool
        Whether magnitudes are correlated, or complex values.
    """
    features = settings.features
    all_mines = site.mines[["x", "y"]]
    tables = []
    for k, lane in enumerate(site.lanes):
        tiles = clutter_tiles(lane, features.region, all_mines, features.keep_off)
        tables.append(tiles.assign(clutter=f"{k}"))
    clutter = pd.concat(tables).assign(kind="clutter")
    mines = site.mines[~site.mines["subset"]]
    table = pd.concat([mines, clutter], ignore_index=True)
    return _with_features(settings, site, templates, table, magnitude)


def _with_features(
    settings: Settings,
    site: Site,
    templates: AnyArray,
    table: pd.DataFrame,
    magnitude: bool = True,
) -> Examples:
    """Return examples with their correlations with the templates."""
    table = table.assign(site=site.name).drop(columns=["clutter", "subset"], errors="ignore")
    table["target"] = table["target"].fillna("") if "target" in table else ""
    image = site.image if magnitude else site.wave
    regions = cut_regions(image, site.grid, table[["x", "y"]], settings.features.region)
    return Examples(table, template_features(regions, templates, magnitude))


def learn_screen(
    settings: Settings,
    site: Site,
    kinds: tuple[str, ...] = ("metal",),
    radius_is: RadiusIs | None = None,
) -> ClusterScreen:
    """Train the recipe's prescreeners on the subset's mines of some kinds.

    If there is none of them, all of the subset is used.

    Parameters
    ----------
    settings : Settings
        The study.
    site : Site
        The site.
    kinds : tuple of str
        Kinds of mines.
    radius_is : str, optional
        What the paper's 20 cm are; by default as the settings say.
    """
    table = ClusterSettings(
        **_sizes(settings),
        radius=settings.prescreen.radius,
        radius_is=radius_is or settings.prescreen.radius_is,
        pass_share=settings.prescreen.pass_share,
        reach=settings.prescreen.halo,
        kinds=kinds,
    )
    learnt, _ = ClusterScreen.fit(table, [_training(site)])
    return ClusterScreen(table, None, learnt)  # type: ignore[arg-type]


def screened_regions(
    site: Site, screen: ClusterScreen, polarizations: Sequence[str], rule: Rule = "and-or"
) -> pd.DataFrame:
    """Return the regions in the lane that pass in all ranges of a polarization (par. 44).

    Parameters
    ----------
    site : Site
        The site.
    screen : ClusterScreen
        The trained prescreeners.
    polarizations : sequence of str
        Polarizations whose images are screened.
    rule : str
        How the images are joined; "and" is par. 18.
    """
    changes = {"polarizations": tuple(polarizations), "rule": rule}
    table = screen.settings.model_copy(update=changes)
    regions = ClusterScreen(table, screen.setup, screen.learnt).alarms(site.view)
    is_inside = np.zeros(len(regions), np.bool_)
    for lane in site.lanes:
        is_inside |= lane.contains(regions["x"], regions["y"])
    return regions[is_inside].reset_index(drop=True)


def clutter_past_prescreeners(
    site: Site, screen: ClusterScreen, halo: float
) -> tuple[int, int, int]:
    """Return the number of clutter clusters that pass the first, the second and all prescreeners.

    They are counted over all images.

    Parameters
    ----------
    site : Site
        The site.
    screen : ClusterScreen
        The trained prescreeners.
    halo : float
        Clutter lies in the lane and farther than this from every mine, m.
    """
    counts = np.zeros(3, dtype=np.int64)
    for channel, ellipse, limits, clusters, is_clutter in clutter_clusters(site, screen, halo):
        large = clusters[is_clutter & (clusters["size"] >= limits.size)]
        even = large[large["std"] <= limits.std]
        ratio = energy_ratio(channel, even[["x", "y"]].to_numpy(), ellipse)
        counts += [len(large), len(even), int((ratio <= limits.energy_ratio).sum())]
    first, second, third = counts.tolist()
    return first, second, third


def clutter_clusters(
    site: Site, screen: ClusterScreen, halo: float
) -> Iterator[tuple[Any, Any, Any, pd.DataFrame, BoolArray]]:
    """Yield every image with its ellipse, its limits, its clusters, and which of them are clutter.

    The parameters are those of :func:`clutter_past_prescreeners`.
    """
    mines = floats(site.mines[["x", "y"]])
    for channel, (ellipse, limits) in screen.channels(site.view):
        clusters = find_clusters(channel, limits.amplitude, screen.settings.forming)
        places = floats(clusters[["x", "y"]])
        in_lane = np.logical_or.reduce([lane.contains(*places.T) for lane in site.lanes])
        distance = np.hypot(*(places[:, None] - mines).transpose(2, 0, 1)).min(axis=1)
        yield channel, ellipse, limits, clusters, in_lane & (distance > halo)


def _training(site: Site) -> TrainingView:
    """Return the site as a stage sees it in training, with the subset's mines alone."""
    return TrainingView(site.view, site.mines[site.mines["subset"]], site.lanes[0])


def _sizes(settings: Settings) -> Entries:
    """Return the sizes in the settings of the recipe's stages; all of the subset trains them."""
    return {
        "region": settings.features.region,
        "template": settings.features.template,
        "share": 0.999,
    }


def screened_examples(
    settings: Settings, site: Site, templates: AnyArray, regions: pd.DataFrame
) -> Examples:
    """Return screened regions as examples with features, labelled by the mines within the halo.

    Further regions of one mine, and those of the subset, are dropped.

    Parameters
    ----------
    settings : Settings
        The study.
    site : Site
        The site.
    templates : ndarray
        As :func:`make_templates` returns them.
    regions : DataFrame
        As :func:`screened_regions` returns them.
    """
    mines = site.mines.reset_index(drop=True)
    mine_positions = floats(mines[["x", "y"]])
    region_positions = floats(regions[["x", "y"]])
    distance = np.linalg.norm(region_positions[:, None] - mine_positions, axis=2)
    nearest = distance.argmin(axis=1)
    is_hit = distance[np.arange(len(regions)), nearest] <= settings.prescreen.halo
    columns = ["kind", "depth", "target", "direction", "subset"]
    labels = mines.iloc[nearest][columns].reset_index(drop=True)
    labels.loc[~is_hit, columns] = ["clutter", np.nan, "", "", False]
    table = pd.concat([regions[["x", "y"]], labels], axis=1)
    is_repeated = table.duplicated(["target", "direction"]) & (table["target"] != "")
    is_of_subset = table["subset"].astype(bool)
    table = table[~is_repeated & ~is_of_subset].reset_index(drop=True)
    return _with_features(settings, site, templates, table)

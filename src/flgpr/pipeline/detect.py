"""Detection: a run and a recipe in, alarms out. Truth is not among what it takes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from flgpr.clutter import gain_background, remove_background, self_signature, suppress_by_model
from flgpr.features import local_contrast
from flgpr.imaging import ScanImager
from flgpr.kernels.sampling import bilinear
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import Grid, Lane, lane_to_scan
from flgpr.pipeline.blocks import FeatureChain
from flgpr.pipeline.classifier import Classifier
from flgpr.pipeline.memory import CACHE
from flgpr.pipeline.progress import Track, silent
from flgpr.pipeline.recipe import Recipe, SuppressionTable, lane_of
from flgpr.pipeline.sections import Section
from flgpr.pipeline.view_chain import contributions
from flgpr.pipeline.view_evidence import Evidence, collect_evidence
from flgpr.pipeline.wang2007 import Found, ranked
from flgpr.screen import prescreen, run_view, sample_scan, select

MAIN = "main"


@dataclass(frozen=True)
class Detection:
    """What one chain found.

    Attributes
    ----------
    name, title : str
        "main" for the recipe itself, else the variant's.
    alarms : DataFrame
        Alarm table, the most mine-like first; ``roadside`` (main only, where the recipe suppresses the roadside) is the
        share of the alarm's amplitude that the modelled roadside response explains.
    view : xarray.DataArray
        Run-view (polarization, subband, y, x) in units of the gain background.
    notes : dict
        Figures worth reporting.
    channel : tuple of str, optional
        Polarization and sub-band the alarms were raised on.
    features, contributions : DataFrame, optional
        Per alarm its features, and what each of them adds to the confidence.
    training : DataFrame, optional
        Features of the training alarms, with their ``label``.
    evidence : Evidence, optional
        What explains the alarms, for the viewer.
    before : DataArray, optional
        Run-view before clutter suppression, for the viewer.
    """

    name: str
    title: str
    alarms: pd.DataFrame
    view: xr.DataArray
    notes: dict[str, Any] = field(default_factory=dict)
    channel: tuple[str, str] | None = None
    features: pd.DataFrame | None = None
    contributions: pd.DataFrame | None = None
    training: pd.DataFrame | None = None
    evidence: Evidence | None = None
    before: xr.DataArray | None = None


def detect(
    run: xr.Dataset,
    recipe: Recipe,
    lane: Lane | None = None,
    track: Track = silent,
    classifier: Classifier | None = None,
    section: Section | None = None,
) -> list[Detection]:
    """Run a recipe on a run.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    recipe : Recipe
        The recipe.
    lane : Lane, optional
        Lane in place of the recipe's.
    track : Track
        Shows progress.
    classifier : Classifier, optional
        Trained classifier whose score is the confidence, for recipes with features; default: the local contrast.
    section : Section, optional
        Part of the lane, for recipes with features; default all of it.

    Returns
    -------
    list of Detection
        The recipe's own result first, then its variants.

    Raises
    ------
    ValueError
        If the recipe does not fit the run; the message names the entry.
    """
    _check_channels(run, recipe)
    lane = lane or lane_of(run, recipe)
    if recipe.features is not None:
        chain = FeatureChain(run, recipe, lane, classifier, section=section)
        chain.go(track)
        return [detection_with_features(chain)]
    if classifier is not None:
        raise ValueError("model needs a recipe with the table features, got one without")
    imager = ScanImager(run, recipe.image.grid(), recipe.image.subbands, recipe.image.window, recipe.image.tolerance)
    images = _remember(imager, track)
    main = _chain(imager.run, images, recipe, lane, recipe.background.self_signature, MAIN, recipe.description)
    main = replace(main, before=run_view(images, recipe.run_view.grid(lane), recipe.run_view.y_max))
    several = [main]
    suppressed: list[xr.DataArray] = []
    roadside: dict[str, Any] = {}
    for variant in recipe.variants:
        chosen: Iterable[xr.DataArray] = images
        notes: dict[str, Any] = {}
        if variant.suppress_roadside and recipe.suppression is not None:
            if not suppressed:
                suppressed, roadside = _suppress_roadside(imager, images, recipe.suppression, lane, track)
            share = _roadside_share(images, suppressed, main.alarms, recipe)
            alarms, features = (t.assign(roadside=share) for t in (main.alarms, _known_features(main.alarms)))
            several[0] = replace(main, alarms=alarms, features=features, notes=roadside)
            chosen, notes = suppressed, roadside
        signature = variant.self_signature or recipe.background.self_signature
        several.append(_chain(imager.run, chosen, recipe, lane, signature, variant.name, variant.title, notes))
    return several


def detection_of(found: Found, recipe: Recipe) -> Detection:
    """Make a detection of what the chain with features found: alarms ranked by confidence.

    Parameters
    ----------
    found : Found
        Alarms and features.
    recipe : Recipe
        The recipe.

    Returns
    -------
    Detection
        The main detection.
    """
    alarms, features = found.ranked()
    return Detection(MAIN, recipe.description, alarms, found.view, found.notes, features=features)


def detection_with_features(chain: FeatureChain) -> Detection:
    """Make a detection of a chain whose stages are all done, with what explains it.

    Parameters
    ----------
    chain : FeatureChain
        The chain.

    Returns
    -------
    Detection
        The main detection.
    """
    recipe, detection = chain.recipe, detection_of(chain.found(), chain.recipe)
    evidence, before = chain.evidence()
    return replace(
        detection,
        channel=(recipe.prescreen.polarization, recipe.prescreen.subband),
        contributions=contributions(detection, recipe, chain.classifier),
        evidence=evidence,
        before=before,
    )


def _check_channels(run: xr.Dataset, recipe: Recipe) -> None:
    known = [str(label) for label in run["polarization"].values]
    for name, wanted in (("prescreen", recipe.prescreen.polarization), ("contrast", recipe.contrast.polarization)):
        if wanted not in known:
            raise ValueError(f"{name}.polarization must be one the run has ({', '.join(known)}), got {wanted!r}")


def _remember(imager: ScanImager, track: Track) -> Iterable[xr.DataArray]:
    """Keep the images of a short run; let those of a long one be made anew on every pass."""
    polarizations, pixels = imager.run.sizes["polarization"], imager.grid.nx * imager.grid.ny
    size = 8 * len(imager) * polarizations * len(imager.subbands) * pixels
    if size > CACHE:
        return imager
    return list(track(imager, "imaging", len(imager)))


def _chain(
    run: xr.Dataset,
    images: Iterable[xr.DataArray],
    recipe: Recipe,
    lane: Lane,
    signature_method: Any,
    name: str,
    title: str,
    notes: dict[str, Any] | None = None,
) -> Detection:
    """Background, run-view, prescreener and confidence: Wang et al. 2007, Sec. II, up to its best single feature."""
    image, table = recipe.image, recipe.background
    signature = self_signature((one.values for one in images), signature_method)
    gain = gain_background(
        (one.values for one in images),
        signature,
        *table.windows(image.spacing),
    )

    def cleaned() -> Iterator[xr.DataArray]:
        for one in images:
            yield one.copy(data=remove_background(one.values, signature, gain))

    view = run_view(cleaned(), recipe.run_view.grid(lane), recipe.run_view.y_max)
    screen, contrast = recipe.prescreen, recipe.contrast
    chosen = select(view, screen.polarization, screen.subband)
    alarms = prescreen(chosen, lane, screen.radius, screen.density, screen.count)
    confidence = local_contrast(
        cleaned(), alarms, contrast.polarization, contrast.subband, recipe.run_view.y_max, contrast.patch()
    )
    found = _alarm_table(alarms, confidence)
    return Detection(
        name,
        title,
        found,
        view,
        dict(notes or {}),
        channel=(screen.polarization, screen.subband),
        features=_known_features(found),
        contributions=found[["confidence"]].set_axis(["contrast"], axis=1),
        evidence=collect_evidence(cleaned(), found, contrast.patch(), recipe.run_view.y_max, run, contrast.subband),
    )


def _known_features(table: pd.DataFrame) -> pd.DataFrame:
    return table[["confidence", "magnitude", "scans"]].rename(columns={"confidence": "contrast"})


def _alarm_table(alarms: pd.DataFrame, confidence: pd.DataFrame) -> pd.DataFrame:
    return ranked(alarms.assign(confidence=confidence["contrast"], scans=confidence["scans"]), confidence)[0]


def _suppress_roadside(
    imager: ScanImager, images: Iterable[xr.DataArray], table: SuppressionTable, lane: Lane, track: Track
) -> tuple[list[xr.DataArray], dict[str, Any]]:
    points = roadside_mask(images, table, lane)
    notes: dict[str, Any] = {"mask_pixels": len(points)}
    if not len(points):
        return list(images), notes
    frequency = np.asarray(imager.run["frequency"].values)
    weight = band_weights(frequency, (imager.subbands[table.subband],), WINDOWS["hann"])[0]
    cleaned = []
    for scan in track([int(scan) for scan in imager.scans], "subtracting the roadside", len(imager)):
        local = lane_to_scan(points, imager.run["pose"].values[scan])
        fit = suppress_by_model(imager.signal(scan), imager.operator_on(scan, local), table.iterations, weight)
        cleaned.append(imager.image(scan, fit.data))
    peaks = [_peak_under(points, chosen, table.subband) for chosen in (images, cleaned)]
    notes["mask_centre"] = [round(float(value), 3) for value in points[:, :2].mean(axis=0)]
    notes["mask_peak_reduced_by_db"] = round(20 * float(np.log10(peaks[0] / peaks[1])), 1)
    return cleaned, notes


def _peak_under(points: NDArray[np.float64], images: Iterable[xr.DataArray], subband: str) -> float:
    peaks = []
    for one in images:
        values = sample_scan(one.sel(subband=subband), lane_to_scan(points, np.asarray(one.attrs["pose"])))
        peaks.append(float(np.nanmax(values, initial=0.0)))
    return max(peaks)


def roadside_mask(images: Iterable[xr.DataArray], table: SuppressionTable, lane: Lane) -> NDArray[np.float64]:
    """Find the ground beside the lane that outshines everything in it.

    Parameters
    ----------
    images : iterable of xarray.DataArray
        Scan images, not cleaned.
    table : SuppressionTable
        Sub-band, pixel spacing (m) and growth of the mask (m).
    lane : Lane
        The lane; the mask never enters it.

    Returns
    -------
    (pixel, 3) ndarray
        Points of the mask in the lane frame, m; none where nothing beside the lane outshines it.
    """
    images = list(images)
    x = np.concatenate([one["x"].values + one.attrs["pose"][0] for one in images])
    y = np.concatenate([one["y"].values + one.attrs["pose"][1] for one in images])
    grid = Grid.spanning((x.min(), x.max()), (lane.y_min, min(lane.y_max, y.max())), table.spacing)
    power = [np.mean(np.abs(one.sel(subband=[table.subband])) ** 2, axis=0, keepdims=True) for one in images]
    bright = run_view(
        (np.sqrt(one).assign_attrs(image.attrs) for one, image in zip(power, images, strict=True)), grid, np.inf
    )
    level = bright.values[0, 0]
    inside = lane.contains(*np.meshgrid(grid.x, grid.y))
    seen = np.isfinite(level)
    mask = ~inside & seen & (np.where(seen, level, 0) > level[inside & seen].max(initial=0.0))
    steps = round(table.grow / table.spacing)
    if steps and mask.any():
        mask = binary_dilation(mask, iterations=steps) & ~inside
    points: NDArray[np.float64] = grid.points()[mask]
    return points


def _roadside_share(
    images: Iterable[xr.DataArray], suppressed: list[xr.DataArray], alarms: pd.DataFrame, recipe: Recipe
) -> NDArray[np.float64]:
    total, modelled = np.zeros(len(alarms)), np.zeros(len(alarms))
    channel = {"polarization": recipe.prescreen.polarization, "subband": recipe.prescreen.subband}
    centres = np.zeros((len(alarms), 3))
    centres[:, :2] = alarms[["x", "y"]].to_numpy(dtype=np.float64)
    for plain, clean in zip(images, suppressed, strict=True):
        local = lane_to_scan(centres, np.asarray(plain.attrs["pose"]))
        x, y = plain["x"].values, plain["y"].values
        place = (local[:, 1] - y[0]) / (y[1] - y[0]), (local[:, 0] - x[0]) / (x[1] - x[0])
        before, after = (bilinear(one.sel(channel).values, *place) for one in (plain, clean))
        total += np.nan_to_num(np.abs(before) ** 2)
        modelled += np.nan_to_num(np.abs(before - after) ** 2)
    return np.sqrt(modelled / np.maximum(total, np.finfo(float).tiny))

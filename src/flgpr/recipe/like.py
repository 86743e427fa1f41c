"""A recipe like another one, fitted to the array of a run.

What belongs to the array follows from the run (``recipe/choice.py``), by the rules of a recipe
that is made from nothing but a run. What belongs to the method stays as in the model recipe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flgpr.model.printable import printable
from flgpr.recipe.choice import MEDIAN_STEP, Figures, pixels_of
from flgpr.recipe.fit import FITTED_MAP
from flgpr.recipe.schema import Recipe, parse_recipe, recipe_names, recipe_text
from flgpr.recipe.writing import EARLY
from flgpr.toml_text import parse_toml, toml_lines
from flgpr.types import PathLike

Tables = dict[str, Any]
_ROADSIDE = "it reads one sub-band of its own array on a grid of its own"
_WHY_NOT = {
    "clutter.early": "its path is that of its own array",
    "clutter.roadside": _ROADSIDE,
    "features.roadside": _ROADSIDE,
}
_FITTED = {
    *(
        f"map.{name}"
        for name in (FITTED_MAP, "deflection", "neyman-pearson", "whitening", "magnitude")
    ),
    *("clutter.standing", "clutter.masks", "screen.clusters", "features.templates"),
}
"""Stages of which every entry that belongs to an array has a rule."""
# m from the middle that the roadside of masks begins, and that images reach, at least
_BESIDE = (2.0, 3.0)
_OTHER_STAGE = "no rule fits its entries to an array"
_AHEAD = "distances ahead lie in the images as they do in the model's"
_SHORTEST_CUT = 6  # pixels


@dataclass(frozen=True)
class ModelRecipe:
    """A recipe whose method another one is to have."""

    name: str  #: as it was asked for: a packaged recipe, or a file
    text: str  #: its TOML text
    recipe: Recipe


def likeable_names() -> list[str]:
    """Return the names of the packaged recipes that can be fitted to an array."""
    names = []
    for name in recipe_names():
        if not faults_of_model(parse_recipe(recipe_text(name), name)):
            names.append(name)
    return names


def faults_of_model(model: Recipe) -> list[str]:
    """Return why a recipe cannot be fitted to an array, entry by entry; empty if it can."""
    faults = []
    for name, stage in model.named().items():
        has_own_path = getattr(stage.settings, "path", None) is not None
        if name == f"clutter.{EARLY['stage']}" and not has_own_path:
            continue  # it goes by the images, and is fitted like them
        if name not in _FITTED:
            faults.append(f"{name}: {_WHY_NOT.get(name, _OTHER_STAGE)}")
    return faults


def load_model_recipe(like: PathLike) -> ModelRecipe:
    """Return a recipe whose method another one can have.

    Parameters
    ----------
    like : str or path
        Packaged recipe, or a file.

    Raises
    ------
    ValueError
        If there is no such recipe, it is not valid, or it cannot be fitted to an array.
    """
    text = recipe_text(like)
    model = parse_recipe(text, str(like))
    faults = faults_of_model(model)
    if faults:
        known = ", ".join(likeable_names())
        raise ValueError(
            f"like must be a recipe that can be fitted to an array ({known}), got {like}: "
            f"{'; '.join(faults)}"
        )
    return ModelRecipe(str(like), text, model)


def like_text(figures: Figures, model: ModelRecipe, antennas: str = "") -> str:
    """Write a recipe like another one, fitted to the array of a run.

    Parameters
    ----------
    figures : Figures
        What follows from the run.
    model : ModelRecipe
        The model recipe.
    antennas : str
        A packaged sensor, or a file, that has the antennas of the run. Without one a map that
        simulates signatures assumes those of the model's sensor.

    Returns
    -------
    str
        TOML of the recipe.
    """
    return _Fitted(figures, model, antennas).text()


class _Fitted:
    """The tables of a recipe like another one.

    Distances ahead lie in the images as they lie in the model's. Lengths that belong to a mine stay,
    and pixels are counted anew.

    Parameters
    ----------
    figures : Figures
        What follows from the run.
    model : ModelRecipe
        The model recipe.
    antennas : str
        A sensor that has the antennas of the run.
    """

    def __init__(self, figures: Figures, model: ModelRecipe, antennas: str) -> None:
        self.figures = figures
        self.model = model.recipe
        self.model_name = model.name
        self.tables: Tables = parse_toml(model.text)
        self.simulates = "sensor" in self.tables.get("map", {})  # signatures of an array
        self.antennas = antennas
        self.half = figures.image_x[1]  # of the images, m; masks need the roadside in them
        self.reasons: dict[str, str] = {}
        self.left_out: list[str] = []

    def text(self) -> str:
        """Return the TOML text."""
        self._check_polarizations()
        self._leave_out()
        self._fit_clutter()
        self._fit_image()
        self._fit_background()
        self._fit_view()
        if self.simulates:
            self._fit_map()
        elif self.model.map is not None:
            self._fit_cuts()
        self._fit_prescreen()
        self._fit_contrast()
        self._fit_features()
        name = printable(self.model.name)
        shown_like = printable(self.model_name)
        self.tables["name"] = f"{self.model.name}-fitted"
        self.tables["description"] = f"Like {self.model.name}, {self.figures.fitted_to}"
        head = [
            f"# Made by `flgpr recipe for --like {shown_like}`",
            f"# {self.figures.described}",
            '# Lengths in m, frequencies in Hz. Entries marked "run:" were taken from the run, by '
            "the rules of",
            f"# `flgpr recipe for`; all others are those of {name}, see "
            f"`flgpr recipe show {shown_like}`.",
        ]
        head += [f"# Left out: {reason}." for reason in self.left_out]
        comments = {}
        for entry, reason in self.reasons.items():
            comments[entry] = reason if reason.startswith("assumed") else f"run: {reason}"
        return "\n".join([*head, "", *toml_lines(self.tables, comments)]) + "\n"

    def _set(self, table: str, entry: str, value: Any, reason: str = "") -> None:
        """Set an entry that follows from the run."""
        name = f"{table}.{entry}"
        self.tables.setdefault(table, {})[entry] = value
        self.reasons[name] = reason or self.figures.reasons[name]

    def _check_polarizations(self) -> None:
        """Refuse a method that combines polarizations of which the run lacks one."""
        has = self.figures.setup.polarizations
        needs = ", ".join(self.model.image.polarizations)
        lacks = not set(self.model.image.polarizations) <= set(has)
        if "clutter.masks" in self.model.named():
            needs = "VV, and VH or HV"
            lacks = "VV" not in has or not {"VH", "HV"} & set(has)
        elif not self.model.needs_looks or self.simulates:
            return
        if lacks:
            raise ValueError(
                f"like must be a recipe whose polarizations the run has, got {self.model_name}: it "
                f"needs {needs}; this run has {', '.join(has)}"
            )

    def _leave_out(self) -> None:
        """Leave out what belongs to the model's own lane."""
        if self.tables.pop("lane", None) is not None:
            self.left_out.append("[lane], which is another one")
        if self.tables["run_view"].pop("y", None) is not None:
            self.left_out.append("run_view.y, which belongs to another lane")

    def _fit_image(self) -> None:
        """Fit the images: pixels, sub-bands, window and polarizations."""
        self._set("image", "x", [-self.half, self.half])
        self._set("image", "y", list(self.figures.image_y))
        self._set("image", "spacing", self.figures.fine)
        if self.figures.method.window != self.model.image.window:
            self._set("image", "window", self.figures.method.window)
        if self.figures.setup.aperture:
            self._set("image", "frames", "all")
        if self.model.image.polarizations:
            self._set(
                "image",
                "polarizations",
                self._measured(self.model.image.polarizations),
                "those of the model that the run has",
            )
        bands = self.figures.bands
        if bands != self.model.image.subbands or self.simulates:
            self._set("image", "subbands", {name: list(band) for name, band in bands.items()})

    def _fit_clutter(self) -> None:
        """Fit the masks, and take the ground's echo out where no self-signature does."""
        stages = []
        for table in self.tables.pop("clutter", []):
            if table["stage"] == "masks":
                stages.append(self._masks(table))
            elif table["stage"] == "standing" and self.figures.setup.drives:
                stages.append(table)
        if self.figures.method.early:
            stages.insert(0, EARLY)
        if stages:
            # They come first, among the entries without a table.
            self.tables = {"clutter": stages, **self.tables}
            reason = self.figures.reasons["clutter"]
            self.reasons["clutter"] = reason if self.figures.method.early else _AHEAD

    def _masks(self, table: Tables) -> Tables:
        """Return masks with the grid, the sub-regions and the roadside of the run's images."""
        half = self.half = max(self.half, _BESIDE[1])
        begin = table["roadside"][0] / self.model.image.x[1] * half
        fitted: Tables = {
            "edges": self._ahead(table["edges"]),
            "roadside": [max(round(begin, 2), _BESIDE[0]), half],
        }
        if "x" in table:
            fitted |= {"x": [-half, half], "y": self._ahead(table["y"])}
            fitted["spacing"] = 2 * self.figures.fine
        return table | fitted

    def _ahead(self, distances: Sequence[float]) -> list[float]:
        """Return distances ahead, m, that lie in the images as others lie in the model's."""
        return np.interp(distances, self.model.image.y, self.figures.image_y).round(2).tolist()

    def _fit_length(self, table: str, entry: str, length: str, own: float) -> None:
        """Fit a length that follows the height, where another one comes out."""
        fitted = self.figures.method.lengths[length]
        if fitted != own:
            self._set(table, entry, fitted)

    def _measured(self, wanted: tuple[str, ...]) -> list[str]:
        """Return the polarizations of the model that the run has, or the best that it has."""
        labels = [label for label in wanted if label in self.figures.setup.polarizations]
        return labels or [self.figures.polarization]

    def _fit_background(self) -> None:
        """Fit the self-signature and the pixels of the median."""
        method = self.model.background.self_signature
        if not self.figures.setup.drives:
            method = "none"
        elif method == "none" and "clutter" not in self.tables:
            method = "mean"
        if method != self.model.background.self_signature or method != "none":
            self._set("background", "self_signature", method)
        if self.model.background.gain == "smooth":
            reason = f"{MEDIAN_STEP} m"
            self._set("background", "median_step", self.figures.median_step, reason)
        self._fit_length("background", "mean", "mean", self.model.background.mean)

    def _fit_view(self) -> None:
        """Fit the run-view."""
        self._set("run_view", "x", list(self.figures.view_x))
        self._set("run_view", "spacing", self.figures.coarse)
        self._set("run_view", "y_max", self.figures.y_max)
        if self.model.run_view.look == "ranges":
            self._fit_ranges()

    def _fit_ranges(self) -> None:
        """Fit the distances ahead that have a view each: scans must see every place from each."""
        ranges = self._ahead(self.model.run_view.ranges)
        apart = min(np.diff(ranges))
        if self.figures.setup.scan_step > apart:
            raise ValueError(
                f"like must be a recipe whose views the run has, got {self.model_name}: it needs a "
                f"look at {len(ranges)} distances ahead, {apart:.2g} m apart; the scans of this run "
                f"are {self.figures.setup.scan_step:.2g} m apart"
            )
        self._set("run_view", "ranges", ranges, _AHEAD)
        self._set("run_view", "y_max", self._ahead([self.model.run_view.y_max])[0], _AHEAD)
        self._set("run_view", "within", round(apart / 2, 2), "half of what parts them")

    def _fit_cuts(self) -> None:
        """Fit the pixels of range cuts, and the polarizations that are cut."""
        settings = self.model.map_settings
        across, along = (step / self.figures.fine for step in self.model.image.steps)
        length = max(round(settings.length * along), _SHORTEST_CUT)
        self._set("map", "length", length, f"{settings.length * self.model.image.steps[1]:.2g} m")
        steps = zip(settings.clutter_step, (along, across), strict=True)
        pixels = [max(round(step * factor), 1) for step, factor in steps]
        self._set("map", "clutter_step", pixels, "the same distances as there")

    def _fit_map(self) -> None:
        """Fit the map: the array whose signatures are simulated, and the contrast's channels."""
        table = self.tables["map"]
        own = table["sensor"]
        self._set("map", "sensor", "run", "its own antennas, tones and height")
        if self.antennas:
            reason = "the sensor that has its antennas and tones"
            self._set("map", "antennas", self.antennas, reason)
        else:
            table["antennas"] = table.get("antennas") or own
            self.reasons["map.antennas"] = (
                "assumed, for a run does not hold their pattern, tilt and errors; a sensor's own "
                "file tells them"
            )
        settings = self.model.map_settings
        if self.figures.step != settings.step:
            self._set("map", "step", self.figures.step)
        for entry in ("clear", "guard", "outer"):
            self._fit_length("map", entry, entry, getattr(settings, entry))
        wanted = tuple(getattr(settings, "polarizations", ()))
        measured = self._measured(wanted)
        if measured != list(wanted):
            reason = f"those of {', '.join(wanted)} that it has"
            if not set(measured) & set(wanted):
                reason = f"it has none of {', '.join(wanted)}"
            self._set("map", "polarizations", measured, reason)

    def _fit_prescreen(self) -> None:
        """Fit the prescreener: its radius, and its channel, which of a map is the map."""
        self._fit_length("prescreen", "radius", "radius", self.model.prescreen.radius)
        if self.model.map is None:
            self._set("prescreen", "polarization", self._polarization("prescreen"))
            subband = self.figures.subband
            if "ranges" in self.tables["run_view"]:
                subband = f"{self.tables['run_view']['ranges'][0]:g} m"
            self._set("prescreen", "subband", subband)
            return
        self._set("prescreen", "count", "lane")
        if len(self.figures.bands) == 1:
            self._set("prescreen", "subband", self.figures.subband, "there is one sub-band")

    def _polarization(self, table: str) -> str:
        """Return the model's polarization in a table, or the best that the run has."""
        own = str(getattr(self.model, table).polarization)
        return self._measured((own,))[0]

    def _fit_contrast(self) -> None:
        """Fit the channel and the pixels of the local contrast."""
        contrast = self.model.contrast
        spacing = self.figures.coarse
        polarization = self._polarization("contrast")
        if polarization != contrast.polarization:
            reason = f"it has no {contrast.polarization}"
            self._set("contrast", "polarization", polarization, reason)
        if self.model.map is None:
            self._set("contrast", "subband", self.figures.subband, "the prescreener's")
        elif contrast.subband not in self.figures.bands:
            self._set("contrast", "subband", next(iter(self.figures.bands)), "all of its band")
        patch = contrast.size * contrast.spacing
        fitted_patch = self.figures.method.lengths["patch"]
        if spacing == contrast.spacing and fitted_patch == patch:
            return
        reason = "" if fitted_patch != patch else f"{patch:g} m"
        size = pixels_of([fitted_patch], spacing)[0]
        self._set("contrast", "spacing", spacing, "the run-view's")
        self._set("contrast", "size", size, reason)
        for entry in ("inner", "guard"):
            lengths = [pixels * contrast.spacing for pixels in getattr(contrast, entry)]
            in_metres = " m x ".join(f"{length:g}" for length in lengths)
            self._set("contrast", entry, pixels_of(lengths, spacing), f"{in_metres} m")

    def _fit_features(self) -> None:
        """Fit the pixels of the features, or leave them out where their polarizations lack."""
        features = self.model.features
        if features is None:
            return
        if not self.figures.has_features:
            del self.tables["features"]
            self.left_out.append("[features], which are of runs with HH, VV, and HV or VH")
            return
        steps = self.model.image.steps
        lengths = [pixels * step for pixels, step in zip(features.inner, steps, strict=True)]
        inner = pixels_of(lengths, self.figures.fine)
        if inner != list(features.inner):
            in_metres = " m x ".join(f"{length:g}" for length in lengths)
            self._set("features", "inner", inner, f"{in_metres} m of the image")

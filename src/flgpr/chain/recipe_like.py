"""A recipe like another one, fitted to the array of a run.

What belongs to the array follows from the run, by the rules of a recipe that is made from nothing
but a run. What belongs to the method stays as in the model recipe.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.chain.recipe import Recipe, parse_recipe, recipe_names, recipe_text
from flgpr.chain.recipe_choice import (
    MEDIAN_STEP,
    Choice,
    Method,
    choose,
    described,
    fitted_to,
    image_x,
    image_y,
    last_look,
    median_step,
    pieces_of,
    pixels_of,
    polarization_of,
    reasons_for,
    toml_frequency,
    view_x,
    window_of,
)
from flgpr.chain.recipe_fit import FITTED_MAP, Band, FloatArray, RadarSetup, allow_features
from flgpr.door import parse_toml
from flgpr.model.printable import printable

Tables = dict[str, Any]
_CUTS = "the length of its cuts is counted in pixels of its own array's range cells"
_WHY_NOT = {
    "clutter.masks": "its edges and its roadside are places ahead of its own array",
    "clutter.roadside": "it reads one sub-band of its own array on a grid of its own",
    "features.roadside": "it reads one sub-band of its own array on a grid of its own",
    "map.deflection": _CUTS,
    "map.neyman-pearson": _CUTS,
    "map.whitening": _CUTS,
    "map.magnitude": _CUTS,
    "screen.clusters": "its region and its template are resolutions of its own array",
    "features.templates": "its region and its template are resolutions of its own array",
}
_OTHER_STAGE = "no rule fits its entries to an array"
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


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
    for name in model.named():
        if name != f"map.{FITTED_MAP}":
            faults.append(f"{name}: {_WHY_NOT.get(name, _OTHER_STAGE)}")
    if model.run_view.look == "ranges":
        faults.append("run_view.ranges: they are distances ahead of its own array")
    return faults


def load_model(like: str | Path) -> tuple[str, Recipe]:
    """Return the text of a model recipe, and the recipe.

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
    return text, model


def like_text(setup: RadarSetup, like: str | Path, antennas: str = "") -> str:
    """Write a recipe like another one, fitted to the array of a run.

    Parameters
    ----------
    setup : RadarSetup
        What the recipe depends on.
    like : str or path
        Name of the model recipe, or its file.
    antennas : str
        A packaged sensor, or a file, that has the antennas of the run. Without one a map that
        simulates signatures assumes those of the model's sensor.

    Returns
    -------
    str
        TOML of the recipe.

    Raises
    ------
    ValueError
        If the model cannot be fitted to an array, or none can be fitted to this run.
    """
    text, model = load_model(like)
    if setup.aperture and model.map is not None:
        raise ValueError(
            f"like must be a recipe without a map, got {like}: the radar moves across what it "
            "looks at, so the run is one synthetic aperture and no place has several looks"
        )
    choice = _choose(setup, model)
    return _Fitted(setup, choice, model, parse_toml(text), antennas).text(like)


def _choose(setup: RadarSetup, model: Recipe) -> Choice:
    """Choose the figures for a model's method: as many sub-bands as leave the images clear."""
    method = Method(
        patch=model.contrast.size * model.contrast.spacing,
        mean=model.background.mean,
        blur=1 if _window(setup, model) == "boxcar" else 2,
    )
    if model.map is None:
        return choose(setup, method)
    bands = model.image.subbands
    for count in range(len(bands), 1, -1):
        try:
            return choose(setup, _with_bands(method, setup, bands, count))
        except ValueError:
            continue  # fewer sub-bands are wider and have more tones
    return choose(setup, _with_bands(method, setup, bands, 1))


def _with_bands(method: Method, setup: RadarSetup, model: Mapping[str, Band], count: int) -> Method:
    """Return a method with at most so many low sub-bands, of which the last limits the looks."""
    bands = _low_bands(setup.tones, model, count)
    return replace(method, bands=bands, subband=list(bands)[-1])


def _window(setup: RadarSetup, model: Recipe) -> str:
    """Return the model's window, or one of low sidelobes where no self-signature is subtracted."""
    own = model.image.window
    return window_of(setup) if own == "boxcar" else own


def _low_bands(tones: FloatArray, model: Mapping[str, Band], count: int) -> dict[str, Band]:
    """Return the model's sub-bands if a run's band holds them, else the lowest of the run.

    These lie side by side, at most ``count``, none narrower than the model's narrowest. Their
    lower and their upper end are as many octaves apart as the model's, or as the tones reach.
    """
    if count == len(model) and all(_holds(tones, band) for band in model.values()):
        return dict(model)
    lowest = min(low for low, _ in model.values())
    highest = max(high for _, high in model.values())
    narrowest = min(high - low for low, high in model.values())
    piece = pieces_of(tones)[0]
    low = float(piece[0])
    if piece[-1] > lowest:
        low = max(low, lowest)
    high = min(low * highest / lowest, float(piece[-1]))
    if np.count_nonzero((piece >= low) & (piece <= high)) < 2:
        low, high = float(piece[0]), float(piece[-1])
    count = max(min(count, int((high - low) / narrowest)), 1)
    edges = np.geomspace(low, high, count + 1)
    edges[0], edges[-1] = low, high
    names = list(model)[:count]
    return {name: (float(edges[k]), float(edges[k + 1])) for k, name in enumerate(names)}


def _holds(tones: FloatArray, band: Band) -> bool:
    """Return whether a run's band, in one piece, holds a sub-band."""
    low, high = band
    return any(piece[0] <= low and high <= piece[-1] for piece in pieces_of(tones))


class _Fitted:
    """The tables of a recipe like another one.

    Parameters
    ----------
    setup : RadarSetup
        What the recipe depends on.
    choice : Choice
        Its figures.
    model : Recipe
        The model recipe.
    tables : dict
        Its tables as the TOML has them.
    antennas : str
        A sensor that has the antennas of the run.
    """

    def __init__(
        self, setup: RadarSetup, choice: Choice, model: Recipe, tables: Tables, antennas: str
    ) -> None:
        self.setup = setup
        self.choice = choice
        self.model = model
        self.tables = tables
        self.antennas = antennas
        self.reasons: dict[str, str] = {}
        self.left_out: list[str] = []
        self._known_reasons = reasons_for(setup, choice)

    def text(self, like: str | Path) -> str:
        """Return the TOML text."""
        self._leave_out()
        self._fit_image()
        self._fit_background()
        self._fit_view()
        if self.model.map is not None:
            self._fit_map()
        self._fit_prescreen()
        self._fit_contrast()
        self._fit_features()
        name = printable(self.model.name)
        shown_like = printable(str(like))
        self.tables["name"] = f"{self.model.name}-fitted"
        self.tables["description"] = f"Like {self.model.name}, {fitted_to(self.setup)}"
        head = [
            f"# Made by `flgpr recipe for --like {shown_like}`",
            f"# {described(self.setup)}",
            '# Lengths in m, frequencies in Hz. Entries marked "run:" were taken from the run, by '
            "the rules of",
            f"# `flgpr recipe for`; all others are those of {name}, see "
            f"`flgpr recipe show {shown_like}`.",
        ]
        head += [f"# Left out: {reason}." for reason in self.left_out]
        return "\n".join([*head, "", *_lines_of(self.tables, self.reasons)]) + "\n"

    def _set(self, table: str, entry: str, value: Any, reason: str = "") -> None:
        """Set an entry that follows from the run."""
        name = f"{table}.{entry}"
        self.tables.setdefault(table, {})[entry] = value
        self.reasons[name] = reason or self._known_reasons[name]

    def _leave_out(self) -> None:
        """Leave out what belongs to the model's own lane."""
        if self.tables.pop("lane", None) is not None:
            self.left_out.append("[lane], which is another one")
        if self.tables["run_view"].pop("y", None) is not None:
            self.left_out.append("run_view.y, which belongs to another lane")

    def _fit_image(self) -> None:
        """Fit the images: pixels, sub-bands, window and polarizations."""
        self._set("image", "x", list(image_x(self.choice)))
        self._set("image", "y", list(image_y(self.setup, self.choice)))
        self._set("image", "spacing", self.choice.fine)
        window = _window(self.setup, self.model)
        if window != self.model.image.window:
            self._set("image", "window", window)
        if self.setup.aperture:
            self._set("image", "frames", "all")
        if self.model.image.polarizations:
            self._set(
                "image",
                "polarizations",
                self._measured(self.model.image.polarizations),
                "those of the model that the run has",
            )
        bands = self.choice.bands
        if bands == self.model.image.subbands:
            return
        reason = ""
        if self.model.map is not None:
            reason = (
                "the lowest of its tones, side by side, as many octaves together as those of "
                f"{self.model.name} or as the band has"
            )
            missing = len(self.model.image.subbands) - len(bands)
            if missing:
                reason += f"; {missing} fewer, for want of band or of tones"
        self._set("image", "subbands", {name: list(band) for name, band in bands.items()}, reason)

    def _measured(self, wanted: tuple[str, ...]) -> list[str]:
        """Return the polarizations of the model that the run has, or the best that it has."""
        labels = [label for label in wanted if label in self.setup.polarizations]
        return labels or [polarization_of(self.setup.polarizations)]

    def _fit_background(self) -> None:
        """Fit the self-signature and the pixels of the median."""
        method = "none"
        if self.setup.drives:
            method = self.model.background.self_signature
            if method == "none":
                method = "mean"
        self._set("background", "self_signature", method)
        self._set("background", "median_step", median_step(self.choice), f"{MEDIAN_STEP} m")

    def _fit_view(self) -> None:
        """Fit the run-view."""
        self._set("run_view", "x", list(view_x(self.setup, self.choice)))
        self._set("run_view", "spacing", self.choice.coarse)
        self._set("run_view", "y_max", last_look(self.setup, self.choice))

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
        settings = self.model.map.settings if self.model.map is not None else None
        wanted = tuple(getattr(settings, "polarizations", ()))
        measured = self._measured(wanted)
        if measured != list(wanted):
            reason = f"those of {', '.join(wanted)} that it has"
            if not set(measured) & set(wanted):
                reason = f"it has none of {', '.join(wanted)}"
            self._set("map", "polarizations", measured, reason)

    def _fit_prescreen(self) -> None:
        """Fit the channel of the prescreener; that of a map is the map."""
        if self.model.map is None:
            self._set("prescreen", "polarization", self._polarization("prescreen"))
            self._set("prescreen", "subband", self.choice.subband)
        elif len(self.choice.bands) == 1:
            self._set("prescreen", "subband", self.choice.subband, "there is one sub-band")

    def _polarization(self, table: str) -> str:
        """Return the model's polarization in a table, or the best that the run has."""
        own = str(getattr(self.model, table).polarization)
        return self._measured((own,))[0]

    def _fit_contrast(self) -> None:
        """Fit the channel and the pixels of the local contrast."""
        contrast = self.model.contrast
        spacing = self.choice.coarse
        polarization = self._polarization("contrast")
        if polarization != contrast.polarization:
            reason = f"it has no {contrast.polarization}"
            self._set("contrast", "polarization", polarization, reason)
        if self.model.map is None:
            self._set("contrast", "subband", self.choice.subband, "the prescreener's")
        elif contrast.subband not in self.choice.bands:
            self._set("contrast", "subband", self.choice.subband, "the last of its sub-bands")
        if spacing == contrast.spacing:
            return
        self._set("contrast", "spacing", spacing, "the run-view's")
        size = pixels_of([contrast.size * contrast.spacing], spacing)[0]
        self._set("contrast", "size", size, f"{contrast.size * contrast.spacing:g} m")
        for entry in ("inner", "guard"):
            lengths = [pixels * contrast.spacing for pixels in getattr(contrast, entry)]
            in_metres = " m x ".join(f"{length:g}" for length in lengths)
            self._set("contrast", entry, pixels_of(lengths, spacing), f"{in_metres} m")

    def _fit_features(self) -> None:
        """Fit the pixels of the features, or leave them out where their polarizations lack."""
        features = self.model.features
        if features is None:
            return
        if not allow_features(self.setup.polarizations):
            del self.tables["features"]
            self.left_out.append("[features], which are of runs with HH, VV, and HV or VH")
            return
        steps = self.model.image.steps
        lengths = [pixels * step for pixels, step in zip(features.inner, steps, strict=True)]
        inner = pixels_of(lengths, self.choice.fine)
        if inner != list(features.inner):
            in_metres = " m x ".join(f"{length:g}" for length in lengths)
            self._set("features", "inner", inner, f"{in_metres} m of the image")


def _lines_of(
    table: Mapping[str, Any], reasons: Mapping[str, str], path: tuple[str, ...] = ()
) -> list[str]:
    """Return the lines of a table, its own entries before the tables within it."""
    lines = []
    inner_lines: list[str] = []
    for name, value in table.items():
        where = ".".join([*path, name])
        reason = reasons.get(where, "")
        mark = "run: " if not reason.startswith("assumed") else ""
        comment = f"  # {mark}{reason}" if reason else ""
        if isinstance(value, dict):
            header = ".".join(_key(part) for part in (*path, name))
            inner_lines += ["", f"[{header}]{comment}"]
            inner_lines += _lines_of(value, reasons, (*path, name))
        else:
            lines.append(f"{_key(name)} = {_toml(value)}{comment}")
    return lines + inner_lines


def _key(name: str) -> str:
    """Return a key as TOML writes it."""
    return name if _BARE_KEY.fullmatch(name) else _toml(name)


def _toml(value: Any) -> str:
    """Return a value as TOML writes it; frequencies in GHz."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(member) for member in value)}]"
    if isinstance(value, float) and abs(value) >= 1e6:
        return toml_frequency(value)
    # JSON leaves as it is the one character that TOML does not allow in a text.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")

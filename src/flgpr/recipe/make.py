"""A recipe made from a run: its figures follow from band, polarizations, array and course."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import xarray as xr

from flgpr.model import Sensor, aperture_run, load_sensor
from flgpr.model.faults import faults_of
from flgpr.model.motion import plausible_run
from flgpr.model.run_sensor import preset_of, sensor_of_run
from flgpr.model.sensor import Footprint
from flgpr.recipe.choice import figures_of
from flgpr.recipe.like import ModelRecipe, like_text, load_model_recipe
from flgpr.recipe.radar_setup import Band, goes_across, radar_setup
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.recipe.writing import fitted_text
from flgpr.store import MAX_MEMORY, open_run
from flgpr.store.outputs import write_new
from flgpr.toml_text import parse_toml
from flgpr.types import PathLike

ASSUMED_ANTENNAS = "sri-array"
"""The packaged sensor whose antennas and errors a run is assumed to have."""
# Antenna heights beyond an image that hold clutter, too, aside, before and behind: those of
# sri-array's footprint.
_FILLED = (0.2, 0.3, 0.4)


def recipe_for(
    run: PathLike,
    output: PathLike | None = None,
    max_memory: int = MAX_MEMORY,
    like: PathLike | None = None,
    again: bool = False,
) -> str:
    """Make a recipe for a stored run, see :func:`fit_recipe`.

    Parameters
    ----------
    run : str or path
        Run store.
    output : str or path, optional
        File to write the recipe to.
    max_memory : int
        Bytes that reading the run may take.
    like : str or path, optional
        Packaged recipe, or a file, whose method the recipe has.
    again : bool
        Whether earlier drives over the road are given.

    Returns
    -------
    str
        TOML of the recipe.

    Raises
    ------
    FileExistsError
        If another file is there.
    ValueError
        As of :func:`fit_recipe`.
    """
    # A model that cannot be fitted is refused before the run is read.
    model = None if like is None else load_model_recipe(like)
    dataset = open_run(run, max_memory)
    with faults_of(run):
        text = fit_recipe(dataset, like=model, again=again)
    if output is not None:
        write_new(Path(output), text)
    return text


def recipe_or_fitted(
    recipe: PathLike | None,
    run: PathLike,
    model: PathLike | None = None,
    max_memory: int = MAX_MEMORY,
    again: bool = False,
) -> str:
    """Return the text of a recipe, or that of the one that is made for a stored run.

    Parameters
    ----------
    recipe : str or path, optional
        Packaged recipe, or a file; None makes one.
    run : str or path
        Run store.
    model : str or path, optional
        Folder of a trained model, which works with its own recipe alone.
    max_memory : int
        Bytes that reading the run may take.
    again : bool
        Whether earlier drives over the road are given.

    Raises
    ------
    ValueError
        If there is no such recipe, none for the model, or as of :func:`fit_recipe`.
    """
    if recipe is not None:
        text = recipe_text(recipe)
        parse_recipe(text, str(recipe))  # an error names the file
        return with_earlier(text) if again else text
    # A model holds what the stages of its own recipe have learnt.
    if model is not None:
        raise ValueError("recipe must be given with a model: the one it was trained with, got none")
    return recipe_for(run, max_memory=max_memory, again=again)


def with_earlier(text: str) -> str:
    """Return the text of a recipe with the clutter stage "earlier" as its last, if it has none."""
    clutter = parse_toml(text).get("clutter", [])
    if any(stage["stage"] == "earlier" for stage in clutter):
        return text
    inline = re.compile(r"^(clutter = \[.*)\]$", re.MULTILINE)  # as fitted recipes have it
    if inline.search(text):
        return inline.sub(r'\1, {stage = "earlier"}]', text)
    return f'{text}\n[[clutter]]\nstage = "earlier"\n'


def fit_recipe(
    run: xr.Dataset,
    begins: bool = False,
    like: PathLike | ModelRecipe | None = None,
    again: bool = False,
) -> str:
    """Make a recipe from what a run is: its band, polarizations, array and course.

    Lengths that belong to a mine and its surroundings are those of Wang et al. 2007 for antennas 5 m
    high, and shorter for lower ones; the rest follows from the run, and a comment beside every entry
    says how. The same run gives the same text. The recipe has the
    table features where the run has HH, VV and HV or VH, and no lane: a detection searches the
    ground that the run sees. A radar that moves past what it looks at, farther than twice its
    array's width, gets an image over the whole run (``frames = "all"``).

    With ``like`` the method is that of another recipe: what belongs to the array follows from the
    run as without it, all else stays as it is there. A map that simulates signatures of bodies
    simulates them for the antennas, tones and height of the run; the pattern and tilt of the
    antennas, and the errors, are those of the packaged sensor that has this array, or else assumed
    as in the other recipe.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    begins : bool
        Whether the scans are the beginning of a drive that goes on. Its recipe takes the mean of
        many scans as self-signature.
    like : str, path or ModelRecipe, optional
        Packaged recipe, or a file, whose method the recipe has; or one that is loaded.
    again : bool
        Whether earlier drives over the road are given. What they predict is subtracted; without
        ``like`` the band is one, which ends where grating lobes come near.

    Returns
    -------
    str
        TOML of the recipe.

    Raises
    ------
    ValueError
        If the run has no complete scan or no height, or its tones are too few or too far apart to
        make an image; or the other recipe cannot be fitted to an array, or not to this one.

    Examples
    --------
    >>> from flgpr.store import open_run, sample_lane
    >>> from flgpr.recipe.make import fit_recipe
    >>> from flgpr.recipe.schema import parse_recipe
    >>> recipe = parse_recipe(fit_recipe(open_run(sample_lane() / "run.zarr")))
    >>> recipe.image.y, recipe.prescreen.polarization, list(recipe.image.subbands)
    ((1.2, 7.2), 'HH', ['F1'])
    """
    model = like if like is None or isinstance(like, ModelRecipe) else load_model_recipe(like)
    run = plausible_run(run)
    aperture = goes_across(run)
    setup = radar_setup(aperture_run(run) if aperture else run, aperture)
    setup = replace(setup, begins=begins)
    if aperture and model is not None and model.recipe.needs_looks:
        raise ValueError(
            f"like must be a recipe without a map, masks or views, got {model.name}: the radar moves across what "
            "it looks at, so the run is one synthetic aperture and no place has several looks"
        )
    if model is None:
        text = fitted_text(figures_of(setup, again=again and not aperture))
    else:
        text = like_text(figures_of(setup, model.recipe), model, preset_of(run))
    if again:
        text = with_earlier(text)
    parse_recipe(text, "fitted")
    return text


def sensor_for(run: xr.Dataset) -> Sensor:
    """Return a sensor that simulates lanes as the array of a run would see them.

    Antennas, tones, polarizations and height are those of the run, see
    :func:`flgpr.model.run_sensor.sensor_of_run`. What a run does not hold, the antennas' pattern
    and tilt and the radar's errors, is that of the packaged sensor with these antennas and tones;
    without one it is assumed as in ``sri-array``, and the ground that is filled with clutter is
    that of the images of :func:`fit_recipe` and what surrounds it.

    Parameters
    ----------
    run : xarray.Dataset
        A run.

    Returns
    -------
    Sensor
        The sensor.

    Raises
    ------
    ValueError
        If no recipe can be made for the run, its tones lie on no even raster, or the radar moves
        across what it looks at.
    """
    run = plausible_run(run)
    if goes_across(run):
        raise ValueError(
            "sensor must look ahead, got a run that moves across what it looks at: name a "
            "sensor's file"
        )
    preset = preset_of(run)
    if preset:
        return sensor_of_run(run, load_sensor(preset))
    setup = radar_setup(run)
    figures = figures_of(setup)
    footprint = filled_ground(figures.image_x, figures.image_y, setup.height)
    sensor = sensor_of_run(run, load_sensor(ASSUMED_ANTENNAS), footprint)
    return with_ground_below(sensor, footprint) if sensor.is_low else sensor


def filled_ground(x: Band, y: Band, height: float) -> Footprint:
    """Return the ground that holds clutter, m: that of images with these borders, and what surrounds it.

    Parameters
    ----------
    x, y : tuple of float
        Borders of the images, m in the scan frame.
    height : float
        Height of the antennas, m.
    """
    aside, before, behind = _FILLED
    (left, right), (near, far) = x, y
    return (
        left - aside * height,
        right + aside * height,
        near - before * height,
        far + behind * height,
    )


def with_ground_below(sensor: Sensor, footprint: Footprint) -> Sensor:
    """Return a sensor whose footprint has the ground below its antennas, too.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    footprint : tuple of float
        Ground that its images show and what surrounds it, m.
    """
    below = sensor.model_copy(update={"footprint": "auto"}).ground_in_view
    joined = (
        min(footprint[0], below[0]),
        max(footprint[1], below[1]),
        min(footprint[2], below[2]),
        footprint[3],
    )
    return sensor.model_copy(update={"footprint": joined})

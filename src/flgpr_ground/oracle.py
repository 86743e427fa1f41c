"""What is left to gain: a detector that knows every mine's echo and the clutter's covariance."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.ndimage import maximum_filter
from scipy.special import ive

from flgpr.jobs.workers import DEFAULTS, Report, RunOptions
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import engine_of
from flgpr.model import Grid, Lane, ground_points, lane_to_scan
from flgpr.recipe.schema import load_recipe
from flgpr.simulate import Simulator
from flgpr.store import open_run, write_whole
from flgpr.types import (
    AnyArray,
    ArrayLike,
    Complex128Array,
    ComplexArray,
    Entries,
    FloatArray,
    IntArray,
)
from flgpr_ground.ground import Ground, GroundLane, load_ground
from flgpr_ground.lanes import SEALED, passphrase, read_ground
from flgpr_trials.blind import open_truth

ORACLE = "oracle.csv"
"""File of what the oracle finds on a ground without tiers."""
STEP = 0.2  # m between places, and between the nine pixels of a chip
RADIUS = 0.75  # m; of false alarms nearer than this the largest counts
_LOAD = 1e-3  # of the mean power, on the diagonal: the inverse exists with few looks, too
_OFFSETS = np.arange(-1, 2)
"""Numbers of the pixels of a chip along an axis, from its middle."""


@dataclass(frozen=True)
class Looks:
    """Looks at places."""

    place: IntArray  #: (look,) number of the place
    ahead: FloatArray  #: (look,) distance ahead, m
    chip: ComplexArray  #: (look, value)


def oracle_file(ground: Ground) -> str:
    """Return the name of the file of what the oracle finds on a ground, or on one tier of it."""
    return f"oracle-{ground.tier}.csv" if ground.tier else ORACLE


def run_oracle(
    folder: str | Path,
    recipe: str = "wang2007",
    options: RunOptions = DEFAULTS,
    tier: str | None = None,
) -> pd.DataFrame:
    r"""Compute at how many false alarms each mine is found by a detector that knows its echo.

    Of a place seen in scans k, x_k holds the cleaned image about it: all polarizations and
    sub-bands, 3 x 3 pixels 0.2 m apart. Known are the mine's own s_k, what its body returns through
    the ground and the hole it lies in, and R_k, the covariance of target-free ground of the site at
    that distance ahead. As the ground's texture changes from place to place, x_k is divided by its
    own rms, sqrt(x^H R^-1 x) over all values. In Gaussian clutter that differs from look to look,
    the logarithm of the likelihood ratio is, but for a constant,

    - with the phase known, :math:`\sum_k 2\,\mathrm{Re}\, s_k^H R_k^{-1} x_k`,
    - with a phase of its own in every look, :math:`\sum_k \ln I_0(2 |s_k^H R_k^{-1} x_k|)`

    (Van Trees, "Detection, Estimation, and Modulation Theory", part I, 1968, Sec. 4.2 and 4.4).
    Each mine's statistic is tried on the site's target-free lane, too, at every place, with the
    looks nearest in distance: local maxima that reach the mine's own value are the false alarms at
    which it is found. So dependent looks count as they are; a detector that knew their dependence,
    too, could still do a little better.

    Parameters
    ----------
    folder : str or path
        Folder of ``flgpr benchmark run``; its truth is opened, which is logged. ``oracle.csv`` is
        written there, of a ground with tiers ``oracle-TIER.csv`` for each.
    recipe : str
        Recipe whose images it looks at, with their self-signature and gain.
    options : RunOptions, optional
        Who does the work.
    tier : str, optional
        The tier to look at; by default, and with "all", every tier of the ground.

    Returns
    -------
    DataFrame
        A row per mine in the test lanes of sites that have target-free lanes: lane, target_id,
        kind, ``looks``, ``far`` and ``far_phase`` (false alarms per m² without and with the phase),
        ``area`` of the target-free ground (m²). On a ground with tiers also ``body``, if it is a
        packaged one, and ``tier``.

    Raises
    ------
    ValueError
        If the folder is no benchmark's, its lanes are not there, no site has a target-free test
        lane, or the ground has no such tier.
    """
    benchmark = Path(folder)
    tiers = read_ground(benchmark).chosen_tiers(tier)
    lanes = [_lanes_of_sites(ground, benchmark) for ground in tiers]
    # Opening the truth is logged: it comes after all that can be wrong.
    truth, *_ = open_truth(benchmark / "lanes" / SEALED, passphrase(tiers[0]))
    tables = [
        _look_at_tier(ground, of_sites, benchmark, recipe, options, truth)
        for ground, of_sites in zip(tiers, lanes, strict=True)
    ]
    return pd.concat(tables, ignore_index=True)


def _lanes_of_sites(ground: Ground, benchmark: Path) -> dict[str, list[str]]:
    """Return the lanes that the oracle looks at by site, those without targets first.

    A ground without target-free test lanes is refused, and so are lanes that are not there yet.
    """
    names = {}
    for site in ground.sites:
        bare, tested = lanes_of_site(ground, site)
        if bare is not None and tested:
            names[site] = [lane.name for lane in (bare, *tested)]
    if not names:
        raise ValueError(
            "sites must have test lanes without targets, whose false alarms count, got none "
            f"in {benchmark}"
        )
    stores = [benchmark / "lanes" / f"{name}.zarr" for name in itertools.chain(*names.values())]
    missing = ", ".join(store.stem for store in stores if not store.is_dir())
    if missing:
        raise ValueError(f"lanes must be made by `flgpr benchmark run` first, not there: {missing}")
    return names


def _look_at_tier(
    ground: Ground,
    lanes: Mapping[str, list[str]],
    folder: Path,
    recipe: str,
    options: RunOptions,
    truth: pd.DataFrame,
) -> pd.DataFrame:
    """Look at a ground or at one of its tiers, and write what was found."""
    description = (ground.quick, ground.text)
    jobs: list[tuple[Any, ...]] = []
    for site, names in lanes.items():
        targets = truth[truth["lane"].isin(names)].to_dict("list")
        jobs.append((description, str(folder.resolve()), recipe, site, names, targets))
    label = f"oracle, {ground.tier}" if ground.tier else "oracle"
    rows_of_site = {}
    with options.executor() as executor:
        for report in options.track(executor.run(_look_at_site, jobs), label, len(jobs)):
            rows_of_site[report["lane"]] = report["found"]
    table = pd.DataFrame([row for site in lanes for row in rows_of_site[site]])
    if ground.tier:
        table = table.assign(tier=ground.tier)
    write_whole(folder / oracle_file(ground), table.to_csv(index=False, float_format="%.6g"))
    return table


def lanes_of_site(ground: Ground, site: str) -> tuple[GroundLane | None, list[GroundLane]]:
    """Return a site's test lane without targets, and those with some that are like it.

    Parameters
    ----------
    ground : Ground
        The ground, or one of its tiers.
    site : str
        Name of the site.

    Returns
    -------
    bare : GroundLane or None
        The lane without targets; None if the site has none.
    with_targets : list of GroundLane
        Lanes of the same ground, seen by the same array.
    """
    simulated = []
    for lane in ground.lanes.values():
        if lane.site == site and lane.part == "test" and lane.stored is None:
            simulated.append(lane)
    bare = next((lane for lane in simulated if lane.empty), None)
    with_targets = []
    for lane in simulated:
        if bare is None or lane.empty or lane.sensor != bare.sensor:
            continue
        if lane.scene.surface == bare.scene.surface:
            with_targets.append(lane)
    return bare, with_targets


def _look_at_site(
    description: tuple[bool, str],
    folder: str,
    recipe: str,
    site: str,
    names: Sequence[str],
    truth: dict[str, list[Any]],
) -> Report:
    """Find the false alarms per m² of every mine of a site.

    The first of the lanes is the one without targets.
    """
    ground = load_ground(*description)
    bare, *tested = (ground.lanes[name] for name in names)
    targets = pd.DataFrame(truth)
    clutter = BareGround(cleaned_lane(folder, bare, recipe), bare.lane)
    rows = []
    for lane in tested:
        mines = targets[targets["lane"] == lane.name]
        setup = cleaned_lane(folder, lane, recipe)
        looks, echoes = looks_at_mines(setup, lane, mines)
        for number, target in enumerate(mines.to_dict("records")):
            at_mine = looks.place == number
            row: Entries = {
                "site": site,
                "lane": lane.name,
                "target_id": target["target_id"],
                "kind": target["kind"],
                "looks": int(at_mine.sum()),
            }
            if "body" in target:
                row["body"] = target["body"]
            row |= clutter.rates(looks.ahead[at_mine], looks.chip[at_mine], echoes[at_mine])
            rows.append(row)
    return {"lane": site, "found": rows}


class BareGround:
    """Target-free ground of a site, by all looks at its places.

    Covariances are those of a metre of distance ahead.

    Parameters
    ----------
    setup : ImagedRun
        The lane with its background.
    lane : Lane
        Its borders.
    kinds : tuple of str
        What is known of the clutter: "full", its covariance, or "diagonal", the power of every
        value alone.
    """

    def __init__(self, setup: ImagedRun, lane: Lane, kinds: tuple[str, ...] = ("full",)) -> None:
        self.grid = Grid.spanning((lane.x_min, lane.x_max), (lane.y_min, lane.y_max), STEP)
        self.area = lane.area
        points = self.grid.points().reshape(-1, 3)
        looks = join_looks([of_scan for _, _, of_scan in _looks_of_scans(setup, points)])
        self.place = looks.place
        self.ahead = looks.ahead
        # Clutter weakens and resolution falls with distance: a covariance for every metre.
        metre = looks.ahead.astype(int)
        self.inverses: dict[str, dict[int, Complex128Array]] = {kind: {} for kind in kinds}
        self.chips = {kind: looks.chip.copy() for kind in kinds}
        for number, kind in itertools.product(np.unique(metre).tolist(), kinds):
            at_metre = metre == number
            chips = looks.chip[at_metre]
            if kind == "full":
                inverse = inverse_covariance(chips)
            else:
                inverse = np.diag(1 / (np.abs(chips) ** 2).mean(axis=0, dtype=float)) + 0j
            self.inverses[kind][number] = inverse
            self.chips[kind][at_metre] = divided_by_rms(chips, inverse)

    def inverse(self, ahead: float, kind: str = "full") -> Complex128Array:
        """Return the inverse covariance (value, value) at a distance (m).

        At a distance that was not seen it is that of the nearest one.
        """
        inverses = self.inverses[kind]
        return inverses[min(inverses, key=lambda metre: abs(metre + 0.5 - ahead))]  # its middle

    def nearest(self, ahead: float) -> tuple[IntArray, IntArray]:
        """Return the places that are seen, and the number of each one's look nearest to a distance."""
        order = np.lexsort((-np.abs(self.ahead - ahead), self.place))
        last = np.r_[self.place[order][1:] != self.place[order][:-1], True]
        return self.place[order][last], order[last]

    def rate(self, statistic: FloatArray, level: float) -> float:
        """Return the false alarms per m², local maxima of a statistic (place,) that reach a level."""
        over_ground = statistic.reshape(self.grid.ny, self.grid.nx)
        return count_maxima(over_ground, level) / self.area

    def rates(self, ahead: FloatArray, chip: ComplexArray, echo: ComplexArray) -> dict[str, float]:
        """Compute the false alarms per m² that reach a mine's statistics.

        Parameters
        ----------
        ahead : (look,) ndarray
            Distances ahead of the looks at the mine, m.
        chip : (look, value) ndarray of complex
            The looks.
        echo : (look, value) ndarray of complex
            The mine's own echo in them.

        Returns
        -------
        dict
            ``far`` and ``far_phase`` (per m²) without and with the phase, and ``area`` (m²). A mine
            that no image shows is found at no number of false alarms.
        """
        if not len(ahead):
            return {"far": math.inf, "far_phase": math.inf, "area": self.area}
        filters = []
        normalized = []
        for y, look, look_echo in zip(ahead, chip, echo, strict=True):
            inverse = self.inverse(y)
            filters.append(inverse @ look_echo)
            normalized.append(divided_by_rms(look[None], inverse)[0])
        filter_array = np.array(filters)
        at_mine = np.einsum("kc,kc->k", filter_array.conj(), np.array(normalized))
        levels = log_likelihoods(at_mine[None])

        columns = []
        for y, look_filter in zip(ahead, filter_array, strict=True):
            seen, number = self.nearest(y)
            chips = np.zeros((self.grid.nx * self.grid.ny, chip.shape[1]), np.complex64)
            chips[seen] = self.chips["full"][number]
            columns.append(chips @ look_filter.conj())
        maps = log_likelihoods(np.stack(columns, axis=1))
        far, far_phase = (
            self.rate(statistic, float(level[0]))
            for level, statistic in zip(levels, maps, strict=True)
        )
        return {"far": far, "far_phase": far_phase, "area": self.area}


def inverse_covariance(chip: ComplexArray) -> Complex128Array:
    """Invert the covariance of chips.

    A thousandth of its mean power is added to its diagonal.

    Parameters
    ----------
    chip : (look, value) ndarray of complex
        The looks.

    Returns
    -------
    (value, value) ndarray of complex
        The inverse.
    """
    covariance = chip.T.astype(np.complex128) @ chip.conj() / len(chip)
    size = len(covariance)
    load = _LOAD * np.trace(covariance).real / size
    return np.linalg.inv(covariance + load * np.eye(size))


def divided_by_rms(chip: ComplexArray, inverse: Complex128Array) -> ComplexArray:
    """Divide chips by their own rms in whitened clutter.

    Parameters
    ----------
    chip : (look, value) ndarray of complex
        The looks.
    inverse : (value, value) ndarray of complex
        Inverse covariance of the clutter.

    Returns
    -------
    (look, value) ndarray of complex
        The divided looks.
    """
    whitened = np.einsum("kc,cd,kd->k", chip.conj(), inverse, chip, optimize=True)
    rms = np.sqrt(np.maximum(whitened.real / len(inverse), 1e-12))
    return np.asarray(chip / rms[:, None], dtype=np.complex64)


def cleaned_lane(folder: str, lane: GroundLane, recipe: str) -> ImagedRun:
    """Return a lane with its background.

    Parameters
    ----------
    folder : str
        Folder of ``flgpr benchmark run``.
    lane : GroundLane
        The lane.
    recipe : str
        Recipe of the images and of the background.

    Returns
    -------
    ImagedRun
        The lane, whose images are cleaned when they are asked for.
    """
    return cleaned_run(open_run(Path(folder) / "lanes" / f"{lane.name}.zarr"), lane.lane, recipe)


def cleaned_run(run: xr.Dataset, lane: Lane, recipe: str) -> ImagedRun:
    """Return a run over a lane with its background, as :func:`cleaned_lane` does."""
    setup = ImagedRun(run, load_recipe(recipe), lane, explains=False)
    engine_of(setup).run(names=("signature", "gain"))
    return setup


def _looks_of_scans(
    setup: ImagedRun, points: FloatArray
) -> Iterator[tuple[int, FloatArray, Looks]]:
    """Yield the scans: index, x and y of the places in sight in the scan frame, and their looks."""
    for index in range(len(setup)):
        image = setup.coherent(index)
        numbers, places = places_in_sight(setup, points, image.attrs["pose"])
        chips = chips_at(image.values, setup.near, places)
        yield index, places, Looks(numbers, places[:, 1], chips)


def looks_at_mines(
    setup: ImagedRun, lane: GroundLane, mines: pd.DataFrame
) -> tuple[Looks, ComplexArray]:
    """Cut the chips about the mines of a lane, and what the mines' bodies add to them.

    Parameters
    ----------
    setup : ImagedRun
        The lane with its background.
    lane : GroundLane
        The same lane, with its scene.
    mines : pandas.DataFrame
        Truth of the mines: ``x`` and ``y``, m.

    Returns
    -------
    looks : Looks
        Scan after scan; places are numbers of mines.
    echoes : (look, value) ndarray of complex
        What the bodies add to each look.
    """
    simulator = Simulator(lane.scene, lane.sensor, lane.seed)
    scans = setup.near_imager.scans.tolist()
    looks = []
    echoes = []
    for index, places, of_scan in _looks_of_scans(setup, ground_points(mines)):
        looks.append(of_scan)
        if len(places):
            echo = setup.near_imager.image(scans[index], simulator.bodies(scans[index])).values
            echo = echo / (setup.gains[index][..., None, None] * setup.background.gain)
            echoes.append(chips_at(echo.astype(np.complex64), setup.near, places))
    return join_looks(looks), np.concatenate(echoes)


def join_looks(looks: Sequence[Looks]) -> Looks:
    """Join the looks of scans."""
    columns = zip(*((look.place, look.ahead, look.chip) for look in looks), strict=True)
    return Looks(*map(np.concatenate, columns))


def places_in_sight(
    setup: ImagedRun, points: FloatArray, pose: ArrayLike
) -> tuple[IntArray, FloatArray]:
    """Return the numbers of the places whose chips the image of a pose shows, and their x and y.

    They count as far ahead as the run-view takes looks; x and y are in the scan frame, m.

    Parameters
    ----------
    setup : ImagedRun
        A lane with its background.
    points : (place, 3) ndarray of float
        Places in the lane frame, m.
    pose : (6,) array_like
        The pose, m and rad.

    Returns
    -------
    numbers : (seen,) ndarray of int
        Numbers of the places.
    places : (seen, 2) ndarray of float
        Their x and y, m.
    """
    places = lane_to_scan(points, np.asarray(pose))[:, :2]
    x_min, x_max, y_min, y_end = setup.near.extent()
    edge = 2 * STEP
    y_max = min(setup.recipe.run_view.y_max, y_end - edge)
    x, y = places.T
    inside_x = (x > x_min + edge) & (x < x_max - edge)
    inside_y = (y > y_min + edge) & (y <= y_max)
    numbers = np.flatnonzero(inside_x & inside_y)
    return numbers, places[numbers]


def chips_at(image: ComplexArray, grid: Grid, places: FloatArray) -> ComplexArray:
    """Cut chips out of an image: the pixels nearest to places and those about them.

    Parameters
    ----------
    image : (polarization, subband, y, x) ndarray of complex
        The image.
    grid : Grid
        Its pixels, in the scan frame.
    places : (place, 2) ndarray of float
        x and y of the places in the scan frame, m.

    Returns
    -------
    (place, value) ndarray of complex
        Values go through polarization, sub-band and nine pixels.
    """
    row = np.round((places[:, 1] - grid.y_min) / grid.dy)
    column = np.round((places[:, 0] - grid.x_min) / grid.dx)
    down = np.round(STEP * _OFFSETS / grid.dy)
    across = np.round(STEP * _OFFSETS / grid.dx)
    rows = (row[:, None, None] + down[:, None]).astype(int)
    columns = (column[:, None, None] + across).astype(int)
    # (polarization, sub-band, place, 3, 3) becomes (place, value).
    cut = np.moveaxis(image[:, :, rows, columns], 2, 0)
    values = math.prod(image.shape[:2]) * _OFFSETS.size**2
    return np.ascontiguousarray(cut.reshape(len(places), values))


def log_likelihoods(values: AnyArray) -> tuple[FloatArray, FloatArray]:
    """Sum log-likelihood ratios of filtered looks (Van Trees 1968, Sec. 4.2 and 4.4).

    Parameters
    ----------
    values : (place, look) ndarray of complex
        Looks, each filtered by the mine's own echo.

    Returns
    -------
    unknown : (place,) ndarray of float
        Sums with a phase of its own in every look.
    known : (place,) ndarray of float
        Sums with the phases known.
    """
    z = 2 * np.abs(values)
    # I_0 itself overflows beyond z of 700; ive is I_0 exp(-z).
    unknown = (np.log(ive(0, z)) + z).sum(axis=1)
    known = 2 * values.real.sum(axis=1)
    return unknown, known


def count_maxima(values: FloatArray, level: float) -> int:
    """Count the local maxima of a map that reach a level.

    Parameters
    ----------
    values : (y, x) ndarray of float
        The map, in steps of ``STEP``.
    level : float
        The level.

    Returns
    -------
    int
        Maxima that none within ``RADIUS`` exceeds.
    """
    reach = round(RADIUS / STEP)
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = (u**2 + v**2) * STEP**2 <= RADIUS**2
    is_maximum = values == maximum_filter(values, footprint=disc, mode="nearest")
    return int(np.count_nonzero(is_maximum & (values >= level)))

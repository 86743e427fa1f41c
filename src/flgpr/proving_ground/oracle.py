"""What is left to gain: a detector that knows every mine's own echo and the clutter's covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.special import ive

from flgpr.chain.lane_setup import LaneSetup
from flgpr.chain.method import engine_of
from flgpr.chain.recipe import load_recipe
from flgpr.execution.survey import DEFAULTS, RunOptions
from flgpr.execution.workers import Report
from flgpr.model import Grid, Lane, ground_points, lane_to_scan
from flgpr.proving_ground.ground import Ground, GroundLane, load_ground
from flgpr.proving_ground.running import SEALED, passphrase, read_ground
from flgpr.simulate import Simulator
from flgpr.store import open_run, write_whole
from flgpr.trials import open_truth

ORACLE = "oracle.csv"
STEP = 0.2  # m between places, and between the nine pixels of a chip
RADIUS = 0.75  # m; of false alarms nearer than this the largest counts
FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex64]


@dataclass(frozen=True)
class Looks:
    """Looks at places: number of the place, distance ahead (m), and chip (look, value)."""

    place: NDArray[np.int64]
    ahead: FloatArray
    chip: ComplexArray


def oracle_file(ground: Ground) -> str:
    """Name the file that takes what the oracle finds on a ground, or on one tier of it."""
    return f"oracle-{ground.tier}.csv" if ground.tier else ORACLE


def run_oracle(
    folder: str | Path,
    recipe: str = "wang2007",
    how: RunOptions = DEFAULTS,
    tier: str | None = None,
) -> pd.DataFrame:
    r"""Tell for every mine of the test lanes at how many false alarms it would be found by who knows it beforehand.

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
    which it is found. So dependent looks count as they are; what knew of that, too, could still do
    a little better.

    Parameters
    ----------
    folder : str or path
        Folder of ``flgpr benchmark run``; its truth is opened, which is logged. ``oracle.csv`` is
        written there, of a ground with tiers ``oracle-TIER.csv`` for each.
    recipe : str
        Recipe whose images it looks at, with their self-signature and gain.
    how : RunOptions, optional
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
    home = Path(folder)
    tiers = read_ground(home).chosen_tiers(tier)
    for part in tiers:
        needed = _needed(part)
        if not needed:
            raise ValueError(
                "sites must have test lanes without targets, whose false alarms count, got none "
                f"in {home}"
            )
        missing = [name for name in needed if not (home / "lanes" / f"{name}.zarr").is_dir()]
        if missing:
            raise ValueError(
                "lanes must be made by `flgpr benchmark run` first, not there: "
                f"{', '.join(missing)}"
            )
    truth = open_truth(home / "lanes" / SEALED, passphrase(tiers[0]))[0]
    return pd.concat(
        [_look_at_tier(part, home, recipe, how, truth) for part in tiers], ignore_index=True
    )


def _needed(ground: Ground) -> list[str]:
    """Name the lanes that the oracle looks at."""
    names = []
    for site in ground.sites:
        bare, tested = _lanes(ground, site)
        if bare is not None and tested:
            names += [lane.name for lane in (bare, *tested)]
    return names


def _look_at_tier(
    ground: Ground, home: Path, recipe: str, how: RunOptions, truth: pd.DataFrame
) -> pd.DataFrame:
    """Look at a ground or at one of its tiers, and write what was found."""
    jobs: list[tuple[Any, ...]] = []
    for site in ground.sites:
        bare, tested = _lanes(ground, site)
        if bare is not None and tested:
            names = [lane.name for lane in (bare, *tested)]
            rows = truth[truth["lane"].isin(names)].to_dict("list")
            jobs.append(
                ((ground.quick, ground.text), str(home.resolve()), recipe, site, names, rows)
            )
    name = f"oracle, {ground.tier}" if ground.tier else "oracle"
    with how.executor() as executor:
        tables = {
            one["lane"]: one["found"]
            for one in how.track(executor.run(_of_site, jobs), name, len(jobs))
        }
    found = pd.DataFrame([row for job in jobs for row in tables[job[3]]])
    if ground.tier:
        found = found.assign(tier=ground.tier)
    write_whole(home / oracle_file(ground), found.to_csv(index=False, float_format="%.6g"))
    return found


def _lanes(ground: Ground, site: str) -> tuple[GroundLane | None, list[GroundLane]]:
    """Find a site's test lane without targets, and those with some on ground, and seen by an array, like its own."""
    some = [
        lane
        for lane in ground.lanes.values()
        if (lane.site, lane.part, lane.stored) == (site, "test", None)
    ]
    bare = next((lane for lane in some if lane.empty), None)
    if bare is None:
        return None, []
    like = [
        one for one in some if (one.sensor, one.scene.surface) == (bare.sensor, bare.scene.surface)
    ]
    return bare, [lane for lane in like if not lane.empty]


def _of_site(
    form: tuple[bool, str],
    home: str,
    recipe: str,
    site: str,
    names: Sequence[str],
    truth: dict[str, list[Any]],
) -> Report:
    """Find the false alarms per m² of every mine of a site; the first of the lanes is the one without."""
    (bare, *tested), rows = (load_ground(*form).lanes[name] for name in names), pd.DataFrame(truth)
    clutter = Clutter(_cleaned(home, bare, recipe), bare.lane)
    found = []
    for lane in tested:
        mines = rows[rows["lane"] == lane.name]
        seen, own = _mines(_cleaned(home, lane, recipe), lane, mines)
        for number, mine in enumerate(mines.to_dict("records")):
            at = seen.place == number
            rates = clutter.rates(seen.ahead[at], seen.chip[at], own[at])
            about = {"target_id": mine["target_id"], "kind": mine["kind"], "looks": int(at.sum())}
            about |= {"body": mine["body"]} if "body" in mine else {}
            found.append({"site": site, "lane": lane.name, **about, **rates})
    return {"lane": site, "found": found}


class Clutter:
    """Target-free ground of a site, by all looks at its places; covariances are those of a metre of distance ahead."""

    def __init__(self, setup: LaneSetup, lane: Lane) -> None:
        self.grid = Grid.spanning((lane.x_min, lane.x_max), (lane.y_min, lane.y_max), STEP)
        self.looks = looks_at(setup, self.grid.points().reshape(-1, 3))
        self.area = lane.area
        metre = self.looks.ahead.astype(int)
        self._inverse = {
            int(one): _inverted(self.looks.chip[metre == one]) for one in np.unique(metre)
        }
        for one, inverse in self._inverse.items():
            self.looks.chip[metre == one] = _evened(self.looks.chip[metre == one], inverse)

    def inverse(self, ahead: float) -> NDArray[np.complex128]:
        """Give the inverse covariance (value, value) at a distance, or at the nearest that was seen."""
        return self._inverse[min(self._inverse, key=lambda metre: abs(metre + 0.5 - ahead))]

    def rates(self, ahead: FloatArray, chip: ComplexArray, own: ComplexArray) -> dict[str, float]:
        """Count false alarms per m² that reach a mine's statistics, from its looks and its own echoes in them."""
        filters = np.array([self.inverse(y) @ echo for y, echo in zip(ahead, own, strict=True)])
        even = np.array(
            [_evened(one[None], self.inverse(y))[0] for y, one in zip(ahead, chip, strict=True)]
        )
        of_mine = _statistics(np.einsum("kc,kc->k", filters.conj(), even)[None])
        values = np.stack(
            [self._nearest(y) @ one.conj() for y, one in zip(ahead, filters, strict=True)], axis=1
        )
        counts = [
            _maxima(one.reshape(self.grid.ny, self.grid.nx), float(level[0]))
            for level, one in zip(of_mine, _statistics(values), strict=True)
        ]
        return {"far": counts[0] / self.area, "far_phase": counts[1] / self.area, "area": self.area}

    def _nearest(self, ahead: float) -> ComplexArray:
        """Chips (place, value) of every place's look that is nearest to a distance; zero for places never seen."""
        order = np.lexsort((-np.abs(self.looks.ahead - ahead), self.looks.place))
        chips = np.zeros((self.grid.nx * self.grid.ny, self.looks.chip.shape[1]), np.complex64)
        chips[self.looks.place[order]] = self.looks.chip[
            order
        ]  # of one place's looks the nearest is the last
        return chips


def _inverted(chip: ComplexArray) -> NDArray[np.complex128]:
    """Invert the covariance of chips (look, value), a thousandth of its mean power added to its diagonal."""
    covariance = chip.T.astype(np.complex128) @ chip.conj() / len(chip)
    load = 1e-3 * np.trace(covariance).real / len(covariance)
    return np.asarray(np.linalg.inv(covariance + load * np.eye(len(covariance))))


def _evened(chip: ComplexArray, inverse: NDArray[np.complex128]) -> ComplexArray:
    """Divide chips (look, value) by their own rms in whitened clutter."""
    power = np.einsum("kc,cd,kd->k", chip.conj(), inverse, chip, optimize=True).real / len(inverse)
    return np.asarray(chip / np.sqrt(np.maximum(power, 1e-12))[:, None], dtype=np.complex64)


def _cleaned(home: str, lane: GroundLane, recipe: str) -> LaneSetup:
    """Return a lane with its background."""
    run = open_run(Path(home) / "lanes" / f"{lane.name}.zarr")
    setup = LaneSetup(run, load_recipe(recipe), lane.lane, explains=False)
    engine_of(setup).run(names=("signature", "gain"))
    return setup


def looks_at(setup: LaneSetup, points: FloatArray) -> Looks:
    """Cut the chips about places (place, 3), in the lane frame (m), out of all scans that see them."""
    parts = []
    for index in range(len(setup.cleaned)):
        image = setup.cleaned.coherent(index)
        seen, where = _seen(setup, points, image)
        parts.append(Looks(seen, where[:, 1], _chips(image.values, setup.cleaned.grid, where)))
    return _joined(parts)


def _mines(setup: LaneSetup, lane: GroundLane, mines: pd.DataFrame) -> tuple[Looks, ComplexArray]:
    """Cut the chips about the mines of a lane, and what the mines' bodies add to them."""
    simulator = Simulator(lane.scene, lane.sensor, lane.seed)
    cleaned = setup.cleaned
    points = ground_points(mines)
    parts = []
    own = []
    for index, scan in enumerate(int(one) for one in cleaned.imager.scans):
        image = cleaned.coherent(index)
        seen, where = _seen(setup, points, image)
        if len(seen):
            echo = cleaned.imager.image(scan, simulator.bodies(scan)).values
            echo = echo / (cleaned.gains[index][..., None, None] * cleaned.background.gain)
            parts.append(Looks(seen, where[:, 1], _chips(image.values, cleaned.grid, where)))
            own.append(_chips(echo.astype(np.complex64), cleaned.grid, where))
    return _joined(parts), np.concatenate(own)


def _joined(parts: Sequence[Looks]) -> Looks:
    return Looks(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("place", "ahead", "chip")
        )
    )


def _seen(
    setup: LaneSetup, points: FloatArray, image: xr.DataArray
) -> tuple[NDArray[np.int64], FloatArray]:
    """Tell which places have their chips in what the run-view takes of an image, and where in the scan frame."""
    where = lane_to_scan(points, np.asarray(image.attrs["pose"]))[:, :2]
    x_min, x_max, y_min, _ = setup.cleaned.grid.extent()
    edge = 2 * STEP
    far = setup.recipe.run_view.y_max
    inside = (where[:, 0] > x_min + edge) & (where[:, 0] < x_max - edge)
    seen = np.flatnonzero(inside & (where[:, 1] > y_min + edge) & (where[:, 1] <= far))
    return seen, where[seen]


def _chips(image: ComplexArray, grid: Grid, where: FloatArray) -> ComplexArray:
    """Cut values (place, polarization x sub-band x 9) of the pixels nearest to places and about them."""
    row = np.round((where[:, 1] - grid.y_min) / grid.dy)
    column = np.round((where[:, 0] - grid.x_min) / grid.dx)
    down, across = (np.round(STEP * np.arange(-1, 2) / step) for step in (grid.dy, grid.dx))
    rows, columns = row[:, None, None] + down[:, None], column[:, None, None] + across
    cut = image[:, :, rows.astype(int), columns.astype(int)]
    return np.ascontiguousarray(
        np.moveaxis(cut, 2, 0).reshape(len(where), math.prod(image.shape[:2]) * 9)
    )


def _statistics(values: NDArray[Any]) -> tuple[FloatArray, FloatArray]:
    """Sum log-likelihood ratios of filtered looks (place, look): phases unknown, and known."""
    z = 2 * np.abs(values)
    return (np.log(ive(0, z)) + z).sum(axis=1), 2 * values.real.sum(axis=1)


def _maxima(values: FloatArray, level: float) -> int:
    """Count the local maxima of a map (y, x) that reach a level."""
    reach = round(RADIUS / STEP)
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = (u**2 + v**2) * STEP**2 <= RADIUS**2
    return int(
        np.count_nonzero(
            (values >= level) & (values == maximum_filter(values, footprint=disc, mode="nearest"))
        )
    )

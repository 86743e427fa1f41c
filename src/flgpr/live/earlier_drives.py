"""Live detection of what has changed since earlier drives: the stage ``earlier``, scan by scan.

A scan's image is cleaned by the stage itself, as that of a stored run. What stands still on the
vehicle is known from the earlier drive at first and from the mean of the scans before later, where
a stored run has the median over all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flgpr.clutter import subtract_standing
from flgpr.clutter.causal import LEAST_WARM_UP
from flgpr.health.findings import Finding
from flgpr.health.of_run import health_of_run, without
from flgpr.stages.earlier import EarlierRuns, before_names, check_earlier
from flgpr.stages.earlier_ground import explained
from flgpr.store import open_run
from flgpr.types import Arrays, ComplexArray, FloatArray, PathLike


def open_earlier(paths: Sequence[PathLike]) -> tuple[dict[str, xr.Dataset], list[Finding]]:
    """Open earlier runs of the road, and return them by name with what is wrong with them.

    Pairs and tones that are faulty are left out.

    Raises
    ------
    ValueError
        If a run is not valid, or has too few scans to tell what stood still.
    """
    runs = {}
    findings: list[Finding] = []
    for name, path in zip(before_names(len(paths)), paths, strict=True):
        run = open_run(path)
        check_earlier(run, path)
        health = health_of_run(run)
        runs[name] = without(run, health.left_out, silent_tones=True)
        findings += [finding.of_run(name) for finding in health.findings]
    return runs, findings


class EarlierDrives:
    """Subtracts from images of scans, as they come, what earlier drives predict.

    Parameters
    ----------
    stage : EarlierRuns
        The recipe's stage.
    subbands : sequence of int
        Those of the images' sub-bands that are wanted.
    rows : int
        Nearest rows of the images that are wanted.
    span : int, optional
        Scans with which the mean of what stands still fades; by default it is over all.
    """

    def __init__(
        self, stage: EarlierRuns, subbands: Sequence[int], rows: int, span: int | None = None
    ) -> None:
        self.stage = stage
        self._subbands = subbands
        self._rows = rows
        self._span = span
        stage.estimate_alone()
        self._then = stage.stood_still
        self.begin()

    def begin(self) -> None:
        """Begin with nothing learnt and nothing counted."""
        self._learnt = 0  # scans in the means
        # Of today's data without ground, and of their power in each polarization.
        self._mean: ComplexArray = np.zeros((1, 1, 1), np.complex128)
        self._mean_power = np.zeros(1)
        self._power = np.zeros(2)  # of all images, before and after
        self.scans = 0  #: scans whose images were cleaned
        self.alone = 0  #: those of them that no earlier scan lies near
        self.is_alone = False  #: whether the last one is such
        #: (polarization, pair, frequency) of the ground in the scan whose image was cleaned last
        self._echo: ComplexArray | None = None

    @property
    def is_ready(self) -> bool:
        """Whether enough is known of what stands still."""
        return self._then is not None or self._learnt >= LEAST_WARM_UP

    def learn(self, data: ComplexArray, pose: FloatArray) -> None:
        """Take the imaged data (polarization, pair, frequency) of a scan into the mean.

        The ground that earlier drives predict is taken out first: of few scans it is a large part.
        """
        ground = None
        if self._echo is not None:
            ground = explained(self.clean(data), self._echo)
        elif self.stage.settings.iterations:
            ground = self.stage.ground_in(self.clean(data), pose)
        if ground is not None:
            data = data - ground
        self._learnt += 1
        weight = 1 / self._counted
        self._mean = self._mean + weight * (data - self._mean)
        self._mean_power = self._mean_power + weight * (_power(data) - self._mean_power)

    @property
    def _counted(self) -> int:
        """Scans that the means are worth."""
        return min(self._learnt, self._span or self._learnt)

    def clean(self, data: ComplexArray) -> ComplexArray:
        """Return the imaged data of a scan without what stands still, once that is known."""
        return subtract_standing(data, self.standing(data)) if self.is_ready else data

    def standing(self, data: ComplexArray) -> ComplexArray:
        """Return what stands still in a scan (polarization, pair, frequency), as far as is known.

        It is the mean of today's scans, drawn towards the earlier drive's field, as far as the two
        differ no more than by what is left of the ground in so few scans (the positive part of
        James & Stein 1961, for each polarization). The field of another vehicle, or of antennas
        that were moved, is soon left out so.
        """
        if self._then is None:
            return self._mean
        then = explained(self._mean if self._learnt else data, self._then)
        if self._learnt < 2:
            return then
        scatter = self._mean_power - _power(self._mean)
        of_mean = scatter / (self._counted - 1)
        differ = _power(self._mean - then)
        share = of_mean / np.maximum(np.maximum(differ, of_mean), np.finfo(float).tiny)
        return self._mean + share[:, None, None] * (then - self._mean)

    def of_image(self, image: ComplexArray, pose: FloatArray) -> ComplexArray:
        """Return what is wanted of the image of cleaned data less what is predicted.

        Parameters
        ----------
        image : (polarization, subband, y, x) ndarray of complex
            Image of all sub-bands.
        pose : (6,) ndarray
            The scan's pose.
        """
        part = image[:, self._subbands, : self._rows]
        self._echo = None
        if not self.is_ready:
            return part
        prediction = self.stage.predict(image, pose, self._subbands, self._rows)
        left: ComplexArray = part - prediction.image.reshape(part.shape)
        self._echo = prediction.echo
        self.scans += 1
        self.is_alone = self.stage.is_alone(pose)
        self.alone += self.is_alone
        if not self.is_alone:
            self._power += [np.vdot(part, part).real, np.vdot(left, left).real]
        return left

    def sentences(self) -> list[str]:
        """Return how well the drives fit so far; nothing before an image was cleaned."""
        if not self.scans:
            return []
        return self.stage.sentences_of(self.alone, self.scans, self._power)

    def state(self) -> Arrays:
        """Return what was learnt and counted, for :meth:`restore`; later scans do not change it."""
        counts = np.array([self._learnt, self.scans, self.alone, self.is_alone])
        return {
            "counts": counts,
            "mean": self._mean,
            "mean_power": self._mean_power,
            "power": self._power.copy(),
        }

    def restore(self, state: Arrays) -> None:
        """Continue from a :meth:`state`."""
        self._learnt, self.scans, self.alone, is_alone = (int(one) for one in state["counts"])
        self.is_alone = bool(is_alone)
        self._mean = np.asarray(state["mean"])
        self._mean_power = np.asarray(state["mean_power"])
        self._power = np.array(state["power"])


def _power(data: ComplexArray) -> FloatArray:
    """Return the mean power of data (polarization, pair, frequency) in each polarization."""
    return np.mean(np.abs(data) ** 2, axis=(1, 2), dtype=np.float64)

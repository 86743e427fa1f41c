"""The gain background, in units of which images are cleaned (Wang et al. 2007, Eq. 3 and 4)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flgpr.clutter import Background, shared_level
from flgpr.method.cache_key import background_key
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.imaged_scan import ImagedScan
from flgpr.method.passes.signature import background_estimator
from flgpr.method.passes.traversal import Pass
from flgpr.types import AnyArray, Arrays, FloatArray


class _GainBackground(Pass):
    """What the methods of estimating a gain background have in common.

    The result holds the fields of :class:`flgpr.clutter.Background` and ``gains`` (scan,
    polarization, subband).
    """

    name = "gain"
    title = "gain background"
    needs = ("signature",)
    all_scans = True
    cache_key = staticmethod(background_key)


class SmoothGain(_GainBackground):
    """The mean magnitude of all scans, each smoothed by a median and a mean (Eq. 3 and 4).

    Of every scan the self-signature is subtracted first.
    """

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        self._rows = lane.background_rows
        signature = lane.results["signature"]
        self._gains = signature["gains"]
        self._estimator = background_estimator(lane)
        scans = slice(None) if block is None else slice(block.start, block.stop)
        self._estimator.continue_from(signature, scans)

    def add(self, scan: ImagedScan) -> None:
        """Add a scan's smoothed magnitude, the self-signature subtracted."""
        self._estimator.add_gain(self.lane.scan_image(scan.index, self._rows).values)

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return the sum of the smoothed magnitudes."""
        return self._estimator.second_sums()

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Merge the sum of the block that follows."""
        self._estimator.take_second(dict(state))

    def result(self) -> Arrays:
        """Return the background."""
        return {"gains": self._gains} | vars(self._estimator.result())


class RowGain(_GainBackground):
    """The median magnitude of every row near the middle, mean over the scans.

    It depends on the distance alone (Fuse et al. 2018).
    """

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        self._rows = lane.background_rows
        self._first = lane.results["signature"]
        within = lane.recipe.background.within or np.inf
        self._near = np.abs(lane.imager.grid.x) <= within
        self._total = np.zeros((*self._first["signature"].shape[:3], 1))
        self._count = np.zeros(1)

    def add(self, scan: ImagedScan) -> None:
        """Add the medians of a scan's rows."""
        image = self.lane.scan_image(scan.index, self._rows).values[..., : self._rows, :]
        gain = self._first["gains"][scan.index][..., None, None]
        magnitude = np.abs(image / gain - self._first["signature"])
        self._total += np.median(magnitude[..., self._near], axis=-1, keepdims=True)
        self._count += 1

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return the sum of the medians."""
        return {"total": self._total, "count": self._count}

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Merge the sum of the block that follows."""
        self._total += state["total"]
        self._count += state["count"]

    def result(self) -> Arrays:
        """Return the background, the same in all columns."""
        return _background(self._first, self._total / np.maximum(self._count, 1))


class NoGain(_GainBackground):
    """A gain background of one: images stay in the units of their scan's gain."""

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        self._first = lane.results["signature"]

    def result(self) -> Arrays:
        """Return the background."""
        return _background(self._first, np.ones(1))


GAIN_BACKGROUND: dict[str, type[Pass]] = {"smooth": SmoothGain, "rows": RowGain, "none": NoGain}
"""The methods of estimating a gain background, by the name that a recipe gives them."""


def _background(first: Mapping[str, AnyArray], level: FloatArray) -> Arrays:
    """Return the result of the pass for a level that is broadcast over the image."""
    gain = np.broadcast_to(level, first["signature"].shape).astype(np.float32)
    if not (gain > 0).all():
        raise ValueError(
            "gain background must be positive everywhere, got zero: "
            "the images equal their self-signature"
        )
    shared = shared_level(gain, first["gains"])
    background = Background(first["signature"], gain, first["shared"], shared)
    return {"gains": first["gains"]} | vars(background)

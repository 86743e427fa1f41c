"""The background of the images: self-signature and gain, and what the clutter of a lane is.

The self-signature, and the gain of every scan, are those of Wang et al. 2007, Eq. 2. The gain
background, in units of which images are cleaned, is that of Eq. 3 and 4. The clutter is a lane's as
the learnt map sees it, to be compared with that of the training lanes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flgpr.clutter import Background, BackgroundEstimator, shared_level
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.passes.traversal import ImagedScan, Pass, background_key
from flgpr.method.unlike import MEASURED, SIZES, chosen_scans, size_number
from flgpr.types import AnyArray, Arrays, FloatArray


class SelfSignaturePass(Pass):
    """The self-signature: what looks the same in all scans because it belongs to the vehicle.

    It is the clipped mean of all images, each over its gain (Eq. 2), their median, or zero, as the
    recipe has it. The sums are those of :class:`flgpr.clutter.BackgroundEstimator`
    (``clutter/estimator.py``): ``measure`` gives the gain, ``add_signature`` the sum and
    ``signature`` the mean.

    The result holds ``gains`` (scan, polarization, subband), and ``signature`` and ``shared``
    (polarization, subband, y, x), the latter with gains that the polarizations share.
    """

    name = "signature"
    title = "self-signature"
    all_scans = True
    cache_key = staticmethod(background_key)

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        self._estimator = background_estimator(lane)

    def add(self, scan: ImagedScan) -> None:
        """Add a scan's whole image: its gain is that of all of it."""
        self._estimator.add_signature(self.lane.scan_image(scan.index).values)

    def state(self, exact: bool) -> Arrays:
        """Return the totals of Eq. 2 and the gains of the scans so far."""
        return self._estimator.first_sums(exact)

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Merge the totals and gains of the block that follows."""
        self._estimator.take_first(dict(state))

    def result(self) -> Arrays:
        """Return the signature and all gains."""
        return self._estimator.first_result()


def background_estimator(lane: ImagedRun) -> BackgroundEstimator:
    """Make the estimator of a recipe's background, as far ahead as counts."""
    method = lane.recipe.background.self_signature
    return BackgroundEstimator(*lane.recipe.smoothing, method, lane.background_rows)


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


class LaneClutter(Pass):
    """Sums of the clutter of some scans of a lane.

    The result holds the arrays of the map's ``clutter_of`` with a first axis: its sums up to a
    number are those of the first ``SIZES`` scans that are looked at. ``scans`` is their number.
    """

    name = MEASURED
    title = "clutter compared with the training"
    needs = ("gain",)
    all_scans = True

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block, {})
        chosen = chosen_scans(len(lane)).tolist()
        self._places = {index: place for place, index in enumerate(chosen)}

    def add(self, scan: ImagedScan) -> None:
        """Add the clutter of a scan, if it is one of those that are looked at."""
        place = self._places.get(scan.index)
        if place is None:
            return
        of_scan = self.lane.mapper.clutter_of(scan.coherent)
        arrays = {}
        for name, array in of_scan.items():
            arrays[name] = np.zeros((len(SIZES), *array.shape), array.dtype)
            arrays[name][size_number(place)] = array
        self.merge(arrays)

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return the sums; none where no scan of the block is looked at."""
        return dict(self._sums)

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Add the sums of the block that follows, or of a scan."""
        for name, array in state.items():
            self._sums[name] = self._sums[name] + array if name in self._sums else np.array(array)

    def result(self) -> Arrays:
        """Return the sums."""
        return self._sums | {"scans": np.array(len(self._places))}

"""The self-signature, and the gain of every scan (Wang et al. 2007, Eq. 2)."""

from __future__ import annotations

from collections.abc import Mapping

from flgpr.clutter import BackgroundEstimator
from flgpr.method.cache_key import background_key
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.imaged_scan import ImagedScan
from flgpr.method.passes.traversal import Pass
from flgpr.types import AnyArray, Arrays


class SelfSignaturePass(Pass):
    """The self-signature: what looks the same in all scans because it belongs to the vehicle.

    It is the clipped mean of all images, each over its gain (Eq. 2), their median, or zero, as the
    recipe has it. The sums are those of :class:`flgpr.clutter.BackgroundEstimator`
    (``clutter/streaming.py``): ``measure`` gives the gain, ``add_signature`` the sum and
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

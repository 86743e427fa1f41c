"""From images to alarms: the run-view and the prescreeners."""

from flgpr.screen.clusters import (
    ClusterThresholds,
    Ellipse,
    energy_ratio,
    find_clusters,
    fit_ellipse,
    fuse_clusters,
    learn_thresholds,
    prescreen_clusters,
)
from flgpr.screen.prescreen import prescreen
from flgpr.screen.run_view import run_view, sample_scan, select

__all__ = [
    "ClusterThresholds",
    "Ellipse",
    "energy_ratio",
    "find_clusters",
    "fit_ellipse",
    "fuse_clusters",
    "learn_thresholds",
    "prescreen",
    "prescreen_clusters",
    "run_view",
    "sample_scan",
    "select",
]

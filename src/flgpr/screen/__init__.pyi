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
from flgpr.screen.labels import label_alarms
from flgpr.screen.maxima import counts, density_threshold, local_maxima, prescreen, view_threshold
from flgpr.screen.views import (
    MeanViewSums,
    RangeViewSums,
    RunViewSums,
    look_weight,
    run_view,
    sample_scan,
    seen_along,
    select,
    view_array,
)

__all__ = [
    "ClusterThresholds",
    "Ellipse",
    "MeanViewSums",
    "RangeViewSums",
    "RunViewSums",
    "counts",
    "density_threshold",
    "energy_ratio",
    "find_clusters",
    "fit_ellipse",
    "fuse_clusters",
    "label_alarms",
    "learn_thresholds",
    "local_maxima",
    "look_weight",
    "prescreen",
    "prescreen_clusters",
    "run_view",
    "sample_scan",
    "seen_along",
    "select",
    "view_array",
    "view_threshold",
]

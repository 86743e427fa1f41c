"""From images to alarms: the run-view and the prescreener."""

from flgpr.screen.labels import label_alarms
from flgpr.screen.prescreen import prescreen
from flgpr.screen.run_view import RunViewSums, run_view, sample_scan, select, view_array

__all__ = ["RunViewSums", "label_alarms", "prescreen", "run_view", "sample_scan", "select", "view_array"]

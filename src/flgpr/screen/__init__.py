"""From images to alarms: the run-view and the prescreener."""

from flgpr.screen.prescreen import prescreen
from flgpr.screen.run_view import run_view, sample_scan, select

__all__ = ["prescreen", "run_view", "sample_scan", "select"]

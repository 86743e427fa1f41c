"""Alarms, truth and lanes for programs of maps."""

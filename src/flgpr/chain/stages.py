"""Stages by their former place; they stand in :mod:`flgpr.stages`."""

from flgpr.stages import (
    ClutterStage,
    FeatureStage,
    MapStage,
    ScreenStage,
    Setup,
    Stage,
    Table,
    TrainingView,
)
from flgpr.stages.named import find_stage

__all__ = [
    "ClutterStage",
    "FeatureStage",
    "MapStage",
    "ScreenStage",
    "Setup",
    "Stage",
    "Table",
    "TrainingView",
    "find_stage",
]

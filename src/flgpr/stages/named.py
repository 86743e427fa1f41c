"""The stages that a recipe names, found by kind and name and made with their entries.

They come with the package or from another distribution, which offers them by entry points of the
group "flgpr.stages"; their names are those that recipes use.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, SerializeAsAny, ValidationError

from flgpr.detect.scorers.checks import Checked
from flgpr.model.faults import describe_fault, listed_faults
from flgpr.stages import ClutterStage, Setup, Stage, Table
from flgpr.types import Arrays, ComplexArray

GROUP = "flgpr.stages"
"""Group of the entry points of stages."""
PACKAGED = {
    "clutter": {
        "standing": "standing:StandingField",
        "early": "early:EarlyEchoes",
        "earlier": "earlier:EarlierRuns",
        "masks": "masks:MaskedSuppression",
        "roadside": "roadside:RoadsideSuppression",
    },
    "map": {
        "deflection": "forms:DeflectionMap",
        "neyman-pearson": "forms:NeymanPearsonMap",
        "whitening": "forms:WhiteningMap",
        "magnitude": "forms:MagnitudeMap",
        "likelihood": "likelihood:LikelihoodMap",
    },
    "screen": {"clusters": "clusters:ClusterScreen"},
    "features": {
        "height": "height:Height",
        "templates": "clusters:TemplateFeatures",
        "tracking": "tracking:Tracking",
        "roadside": "roadside:RoadsideShare",
    },
}


class Named(BaseModel):
    """A stage that a recipe names, with its entries."""

    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True)
    stage: str
    settings: SerializeAsAny[Table]
    stage_class: type[Stage] = Field(exclude=True)


def _reader_of(kind: str) -> Callable[[Any], Any]:
    """Return what turns a table of a recipe into a stage of a kind."""

    def read(table: Any) -> Any:
        if isinstance(table, Named):
            return table
        if not isinstance(table, dict) or not isinstance(table.get("stage"), str):
            raise ValueError(
                f'must be a table with the entry stage = "...", got {repr(table)[:80]}'
            )
        stage_class = find_stage(kind, table["stage"])
        entries = {name: value for name, value in table.items() if name != "stage"}
        try:
            settings = stage_class.Settings.model_validate(entries)
        except ValidationError as error:
            faults = listed_faults(
                error, lambda fault: describe_fault(fault, stage_class.Settings, table["stage"])
            )
            raise ValueError("; ".join(faults)) from None
        return Named(stage=table["stage"], settings=settings, stage_class=stage_class)

    return read


def make_stage(name: str, entry: Named, setup: Setup, learnt: Arrays | None) -> Any:
    """Return a stage that a recipe names.

    Parameters
    ----------
    name : str
        Its name with its kind, such as "clutter.masks".
    entry : Named
        Its class and the entries of its table.
    setup : Setup
        The chain it belongs to.
    learnt : dict of str to ndarray, optional
        What a model holds for it.

    Raises
    ------
    ValueError
        If its ``fit`` cannot have returned these arrays.
    """
    if learnt is not None:
        checked = Checked({}, learnt)
        try:
            entry.stage_class.check_learnt(entry.settings, setup, checked)
            checked.done()
        except ValueError as error:
            raise ValueError(f"model's stage {name} does not fit this recipe: {error}") from None
    return entry.stage_class(entry.settings, setup, learnt)


def make_stages(
    entries: Mapping[str, Named], setup: Setup, learnt: Mapping[str, Arrays]
) -> dict[str, Stage]:
    """Return the stages that a recipe names, but for the clutter stages, by their names.

    Parameters
    ----------
    entries : mapping of str to Named
        Class and settings of all stages of the recipe, by name.
    setup : Setup
        The chain they belong to.
    learnt : mapping of str to dict of ndarray
        What a model holds for stages that have learnt.

    Raises
    ------
    ValueError
        As of :func:`make_stage`.
    """
    stages: dict[str, Stage] = {}
    for name, entry in entries.items():
        if not issubclass(entry.stage_class, ClutterStage):
            stages[name] = make_stage(name, entry, setup, learnt.get(name))
    return stages


def make_clutter_stages(
    entries: Mapping[str, Named],
    setup: Setup,
    learnt: Mapping[str, Arrays],
    measured: Callable[[int, int], ComplexArray],
) -> dict[str, ClutterStage]:
    """Return the clutter stages that a recipe names, each reading what the one before it leaves.

    Parameters
    ----------
    entries : mapping of str to Named
        Class and settings of all stages of the recipe, by name.
    setup : Setup
        The chain they belong to.
    learnt : mapping of str to dict of ndarray
        What a model holds for stages that have learnt.
    measured : callable
        Returns the measured data of the last scans up to an index: ``measured(index, count)``.

    Raises
    ------
    ValueError
        As of :func:`make_stage`.
    """
    stages: dict[str, ClutterStage] = {}
    before = measured
    for name, entry in entries.items():
        if not issubclass(entry.stage_class, ClutterStage):
            continue
        stage = make_stage(name, entry, setup, learnt.get(name))
        stage.before = before
        stages[name] = stage
        before = stage.data
        if entry.stage_class.learns and name not in learnt:
            # In training the stages after it work on what it will leave once it has learnt.
            break
    return stages


ClutterNamed = Annotated[Named, BeforeValidator(_reader_of("clutter"))]
MapNamed = Annotated[Named, BeforeValidator(_reader_of("map"))]
ScreenNamed = Annotated[Named, BeforeValidator(_reader_of("screen"))]
FeaturesNamed = Annotated[Named, BeforeValidator(_reader_of("features"))]


def find_stage(kind: str, name: str) -> type[Stage]:
    """Find a stage by its kind and name.

    Parameters
    ----------
    kind : {"clutter", "map", "screen", "features"}
        Its kind.
    name : str
        Name of a packaged stage, or of an entry point of the group "flgpr.stages".

    Returns
    -------
    type
        Its class.

    Raises
    ------
    ValueError
        If there is no such stage, or it is of another kind.
    """
    if name in PACKAGED[kind]:
        module, _, class_name = PACKAGED[kind][name].partition(":")
        packaged: type[Stage] = getattr(import_module(f"flgpr.stages.{module}"), class_name)
        return packaged
    offered = {entry_point.name: entry_point for entry_point in entry_points(group=GROUP)}
    if name not in offered:
        raise ValueError(f"stage must be one of {', '.join(stage_names(kind))}, got {name!r}")
    loaded = offered[name].load()
    if not _is_stage(loaded, kind):
        raise ValueError(
            f"stage {name!r} of {offered[name].value} must be a class of the kind {kind}, "
            f"got {loaded!r}"
        )
    stage_class: type[Stage] = loaded
    return stage_class


def stage_names(kind: str) -> list[str]:
    """Return the names of all stages of a kind: those of the package, then those offered."""
    names = list(PACKAGED[kind])
    for entry_point in entry_points(group=GROUP):
        if _is_stage(entry_point.load(), kind):
            names.append(entry_point.name)
    return names


def _is_stage(loaded: Any, kind: str) -> bool:
    """Return whether what an entry point names is a stage of a kind."""
    return isinstance(loaded, type) and issubclass(loaded, Stage) and loaded.kind == kind

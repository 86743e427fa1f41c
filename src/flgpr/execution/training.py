"""The course of a training: every stage of a recipe that learns, in order, then its detector."""

from __future__ import annotations

import glob
import re
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.chain.alarm_steps import count_alarm_steps
from flgpr.chain.classifier import CLASSIFIER_B, make_training_set, train
from flgpr.chain.detection import rank_alarms
from flgpr.chain.engine import Arrays
from flgpr.chain.estimators import train_estimator
from flgpr.chain.lane_setup import LaneSetup
from flgpr.chain.model import MODEL_FILE, Model, check_free_model, load_model, save_model
from flgpr.chain.recipe import RANKS, Recipe, parse_recipe
from flgpr.chain.recipe_fit import area_of
from flgpr.chain.recipe_tables import DetectorTable
from flgpr.chain.stages import TrainingView
from flgpr.chain.too_few import (
    TooFewExamplesError,
    cannot_be_trained,
    count_in_views,
    count_targets,
    share_changes,
)
from flgpr.door import read_named
from flgpr.execution.driver import passes_of_lane
from flgpr.execution.job import code_versions, make_job, report
from flgpr.execution.survey import RunOptions
from flgpr.execution.workers import Executor
from flgpr.live import forecast
from flgpr.live.detector import LiveDetector, LiveSettings
from flgpr.model import Lane
from flgpr.store import (
    canonical_json,
    describe_for_live,
    open_run,
    read_lane,
    read_manifest,
    read_table,
    sha256,
)
from flgpr.store.files import replaced_by
from flgpr.store.outputs import OVERWRITE, other_output, tell_finished, whole_output

PathLike = str | Path


def learns_detector(recipe: Recipe, features: Sequence[str]) -> bool:
    """Return whether training a recipe makes a detector, beside what its stages learn."""
    # Without one of these a column of a stage ranks the alarms.
    wanted = recipe.confidence in RANKS or recipe.detector is not None or bool(features)
    has_columns = recipe.features is not None or bool(recipe.columns)
    return wanted and (has_columns or recipe.detector is not None)


def training_lanes(
    recipe: Recipe,
    runs: Sequence[PathLike],
    truths: Sequence[PathLike],
    borders: Sequence[PathLike] | None,
    others: Sequence[Mapping[str, PathLike]],
    max_memory: int,
) -> list[TrainingLane]:
    """Return the lanes of a training; a run that the recipe does not fit is a ValueError."""
    tables = [read_table(truth, "truth") for truth in truths]
    lanes = []
    for number, run in enumerate(runs):
        given = None if borders is None else read_lane(borders[number])
        area = area_of(open_run(run, max_memory), recipe, given)
        lanes.append(TrainingLane(run, truths[number], tables[number], area, others[number]))
    return lanes


def train_on_lanes(
    text: str,
    lanes: Sequence[TrainingLane],
    output: Path,
    features: Sequence[str],
    label_radius: float,
    how: RunOptions,
    overwrite: bool,
) -> Model:
    """Train the recipe of a text on lanes and write its model, or return the one that is there."""
    recipe = parse_recipe(text)
    check_free_model(output).parent.mkdir(parents=True, exist_ok=True)
    notes = {
        "recipe": recipe.name,
        "recipe_sha256": sha256(text.encode()),
        "runs": [read_manifest(lane.run)["sha256"] for lane in lanes],
        "made_of": _inputs_digest(lanes, features, label_radius),
    }
    if not overwrite and _holds_model(output, notes):
        _clear_work_folders(output, how)
        tell_finished(output, OVERWRITE)
        return load_model(output)
    # The output is held open for one training at a time.
    with whole_output(output, replace=True) as partial, how.executor() as executor:
        course = _Course(recipe, text, lanes, output, executor, how)
        course.learn_stages()
        if learns_detector(recipe, features):
            course.train_detector(features, label_radius)
            course.learn_forecast()
        save_model(course.model, partial, notes)
    _clear_work_folders(output, how)
    return course.model


def _inputs_digest(
    lanes: Sequence[TrainingLane], features: Sequence[str], label_radius: float
) -> str:
    """Return a digest of what a model depends on beside the recipe and the runs."""
    inputs = [
        {
            "truth": sha256(read_named(lane.truth)),
            "lane": asdict(lane.area),
            "others": {name: read_manifest(run)["sha256"] for name, run in lane.others.items()},
        }
        for lane in lanes
    ]
    return sha256(canonical_json([inputs, list(features), label_radius, code_versions()]))


def _holds_model(folder: Path, notes: Mapping[str, Any]) -> bool:
    """Tell whether a model of these notes is there, whole; another one is a FileExistsError."""
    if not (folder / MODEL_FILE).is_file():
        return False
    try:
        there = load_model(folder).notes
    except ValueError:
        there = {}
    if any(there.get(name) != value for name, value in notes.items()):
        raise other_output(folder, f"{OVERWRITE}, or choose another output")
    return True


def _clear_work_folders(output: Path, how: RunOptions) -> None:
    """Delete what a training kept beside its model, which is written."""
    for work in output.parent.glob(f"{glob.escape(output.name)}-*-*.work*"):
        if re.fullmatch(r"-\d+-\d+\.work(\.done)?", work.name.removeprefix(output.name)):
            shutil.rmtree(work, ignore_errors=True)
    shared = [] if how.pass_cache is not None else [_work_folder(output, "images")]
    for left in (_work_folder(output, "training"), replaced_by(output), *shared):
        shutil.rmtree(left, ignore_errors=True)


def _work_folder(output: Path, kind: str) -> Path:
    return output.with_name(f"{output.name}.{kind}")


@dataclass(frozen=True)
class TrainingLane:
    """A training lane: its run, the file of its targets and what stands in it, its borders, the runs beside it."""

    run: PathLike
    truth: PathLike
    targets: pd.DataFrame
    area: Lane
    others: Mapping[str, PathLike]


class _Course:
    """A training: its lanes, and what has been learnt so far."""

    def __init__(
        self,
        recipe: Recipe,
        text: str,
        lanes: Sequence[TrainingLane],
        output: Path,
        executor: Executor,
        how: RunOptions,
    ) -> None:
        self.recipe = recipe
        self.text = text
        self.output = output
        self.model = Model()
        self.lanes = lanes
        self._executor = executor
        self._how = how
        self._views: list[TrainingView] = []
        self._step = 0

    @property
    def _pass_cache(self) -> PathLike | None:
        """Folder of images that the steps share, if there are several."""
        several = bool(self.recipe.learning())
        return self._how.pass_cache or (_work_folder(self.output, "images") if several else None)

    @property
    def _learnt(self) -> Path:
        """Folder of what the stages have learnt so far."""
        return _work_folder(self.output, "training")

    def learn_stages(self) -> None:
        """Fit all learning stages, each with what those before it have learnt."""
        named = self.recipe.named()
        for name in self.recipe.learning():
            if named[name].stage_class.kind in ("screen", "features"):
                self._views = self._views or self._training_views()
                examples: list[Any] = self._views
            else:
                examples = []
                for setup, _ in self._lane_setups(truth=True):
                    examples.append(dict(setup.results[f"learn.{name}"]))
            with self._counted(name):
                arrays, notes = self._fit(name, examples)
            self.model = replace(
                self.model,
                stages=self.model.stages | {name: arrays},
                notes=self.model.notes | {name: notes},
            )

    def _training_views(self) -> list[TrainingView]:
        """Return the run-views of all lanes, with their targets."""
        views = []
        for setup, lane in self._lane_setups(truth=True):
            views.append(TrainingView(setup.view(), lane.targets, lane.area))
        return views

    def _fit(self, name: str, examples: list[Any]) -> tuple[Arrays, dict[str, Any]]:
        """Fit a stage; where the examples do not suffice, tell how many targets each step left."""
        stage = self.recipe.named()[name]
        try:
            return stage.stage_class.fit(stage.settings, examples)
        except ValueError as error:
            counts = [count_targets([lane.targets for lane in self.lanes])]
            if stage.stage_class.kind in ("screen", "features"):
                used = stage.stage_class.targets_used_for_training(stage.settings, self._views)
                counts += count_in_views(self._views, used)
            if isinstance(error, TooFewExamplesError):
                raise error.of_stage(name, counts) from None
            changes = share_changes(stage.settings, name)
            raise cannot_be_trained(name, str(error), counts, changes) from None

    def train_detector(self, features: Sequence[str], label_radius: float) -> None:
        """Train the detector on the alarms of all lanes."""
        alarms = []
        raised = 0
        for number, (setup, lane) in enumerate(self._lane_setups(truth=False), 1):
            name = f"{number}:{Path(lane.run).stem}"
            ranked = rank_alarms(setup)
            alarms.append((name, ranked.alarms, ranked.features, lane.targets, lane.area))
            raised += len(setup.alarms())
        table = self.recipe.detector or DetectorTable(features=CLASSIFIER_B)
        wanted = _matching(list(features) or list(table.features), list(alarms[0][2].columns))
        with self._counted("detector"):
            spent = self._spent()
            together = [pd.concat(rows) for rows in zip(*spent.values(), strict=True)]
            examples = make_training_set(alarms, label_radius, wanted, together)
            try:
                detector = (
                    train(examples, wanted)
                    if table.estimator == "fisher"
                    else train_estimator(examples, table, wanted)
                )
            except TooFewExamplesError as error:
                steps = count_alarm_steps(alarms, raised, spent, wanted, label_radius)
                raise steps.error(error, self.recipe, table.on) from None
        self.model = replace(self.model, detector=detector)

    def learn_forecast(self) -> None:
        """Learn what becomes of the alarms, hits and false ones alike, that live detection raises on the lanes."""
        if not forecast.foresees(self.recipe, self.model):
            return
        settings = LiveSettings(looks=2)  # so that looks two to three tell, too
        with self._counted(forecast.NAME):
            followed: list[forecast.Followed] = []
            for lane in self.lanes:
                run = open_run(lane.run, self._how.max_memory)
                detector = LiveDetector(
                    describe_for_live(run), self.recipe, lane.area, self.model, settings
                )
                followed.extend(forecast.follow(detector, run))
            arrays, notes = forecast.learn(followed)
        self.model = replace(
            self.model,
            stages=self.model.stages | ({forecast.NAME: arrays} if arrays else {}),
            notes=self.model.notes | {forecast.NAME: notes},
        )

    @contextmanager
    def _counted(self, name: str) -> Iterator[None]:
        """Report what learning itself takes."""
        begun = time.perf_counter(), time.process_time()
        yield
        self._how.note(report(self.output.name, name, -1, begun, 0))

    def _spent(self) -> dict[str, list[pd.DataFrame]]:
        """Give, by stage, the rows of every lane's truth that made what it has learnt."""
        parts = {
            name: stage.stage_class.targets_used_for_training(stage.settings, self._views)
            for name, stage in self.recipe.named().items()
            if name in self.recipe.learning()
        }
        return {name: rows for name, rows in parts.items() if rows}

    def _lane_setups(self, truth: bool) -> Iterator[tuple[LaneSetup, TrainingLane]]:
        """Go through the lanes as far as the model allows, and yield what their passes gave."""
        self._step += 1
        model = save_model(self.model, self._learnt) if self.model.stages else None
        for number, lane in enumerate(self.lanes, 1):
            beside = self.output.with_name(f"{self.output.name}-{number}-{self._step}")
            job = make_job(
                lane.run, self.text, lane.area, beside, False, model, self._how.max_memory, lane.others,
                lane.truth if truth else None, self._pass_cache,
            )  # fmt: skip
            name = f"{Path(lane.run).stem}: "
            with passes_of_lane(
                job, self._executor, self._how.track, self._how.note, name
            ) as setup:
                yield setup, lane


def _matching(wanted: list[str], columns: list[str]) -> list[str]:
    matching = [name for pattern in wanted for name in columns if fnmatchcase(name, pattern)]
    missing = [
        pattern for pattern in wanted if not any(fnmatchcase(name, pattern) for name in columns)
    ]
    if missing or not matching:
        raise ValueError(
            f"features must be columns of the feature table, got {', '.join(missing) or 'none'}"
        )
    return list(dict.fromkeys(matching))

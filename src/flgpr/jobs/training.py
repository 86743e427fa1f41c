"""Training: every stage of a recipe that learns, in order, and then its detector."""

from __future__ import annotations

import glob
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.door import refuse_links
from flgpr.jit.threads import blas_on_one_thread
from flgpr.jobs.driver import passes_of_lane
from flgpr.jobs.job import LaneJob, absolute, code_versions, model_digest
from flgpr.jobs.pieces import other_runs, report
from flgpr.jobs.workers import Executor, RunOptions
from flgpr.live import forecast
from flgpr.live.detector import LiveDetector, LiveSettings
from flgpr.method.alarm_steps import count_alarm_steps
from flgpr.method.classifier import CLASSIFIER_B, LaneOfAlarms, make_training_set, train
from flgpr.method.detection import rank_alarms
from flgpr.method.estimators import train_estimator
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.model import (
    MODEL_FILE,
    Detector,
    Model,
    array_of,
    check_free_model,
    load_model,
    save_model,
)
from flgpr.method.stands_out import free_ground
from flgpr.method.unlike import (
    LEAST_LANES,
    MEASURED,
    FreeGround,
    TrainingGround,
    chosen_scans,
    learn_clutter,
    learn_levels,
)
from flgpr.model import Lane
from flgpr.recipe.schema import RANKS, Recipe, parse_recipe
from flgpr.recipe.tables import DetectorTable
from flgpr.stages import TrainingView
from flgpr.stages.too_few import (
    TooFewExamplesError,
    cannot_be_trained,
    count_in_views,
    count_targets,
    share_changes,
)
from flgpr.store import (
    canonical_json,
    describe_for_live,
    open_run,
    read_table,
    sha256,
)
from flgpr.store.files import replaced_by
from flgpr.store.outputs import OVERWRITE, atomic_output, log_finished, output_exists_error
from flgpr.types import Arrays, FloatArray, PathLike

FOLDS = 10
"""Most detectors that are trained on some of the lanes, for thresholds on the others."""


def learns_detector(recipe: Recipe, features: Sequence[str]) -> bool:
    """Return whether training a recipe makes a detector, beside what its stages learn."""
    if recipe.detector is not None:
        return True
    if features:
        return recipe.features is not None or bool(recipe.columns)
    # The detector that is trained by default reads some of the ten features. With any other rank
    # a column of a stage ranks the alarms.
    return recipe.confidence in RANKS and recipe.features is not None


def train_on_lanes(
    jobs: Sequence[LaneJob],
    output: Path,
    features: Sequence[str],
    label_radius: float,
    options: RunOptions,
    overwrite: bool,
) -> Model:
    """Train a recipe on lanes and write its model.

    Parameters
    ----------
    jobs : sequence of LaneJob
        The training lanes, as detections of the recipe that have a truth.
    output : Path
        Folder of the model.
    features : sequence of str
        Columns that the detector reads in place of the recipe's.
    label_radius : float
        r_label, m.
    options : RunOptions
        Who does the work.
    overwrite : bool
        Whether another model is overwritten. Otherwise a model of the same inputs is left as it is.

    Returns
    -------
    Model
        What was learnt, or the model that is there.

    Raises
    ------
    ValueError
        If there are too few examples.
    FileExistsError
        If the output holds something else and is not to be overwritten.
    """
    text = jobs[0].recipe
    recipe = parse_recipe(text)
    lanes = [TrainingLane(job, read_table(job.truth[0], "truth")) for job in jobs]
    refuse_links(_work_folder(output, "training"), _work_folder(output, "images"))
    check_free_model(output).parent.mkdir(parents=True, exist_ok=True)
    inputs = []
    for job in jobs:
        others = {name: digest for name, _, digest in job.others}
        inputs.append({"truth": job.truth[1], "lane": asdict(Lane(*job.lane)), "others": others})
    notes = {
        "recipe": recipe.name,
        "recipe_sha256": sha256(text.encode()),
        "runs": [job.store_sha256 for job in jobs],
        "array": array_of(open_run(jobs[0].run)),
        "made_of": sha256(canonical_json([inputs, list(features), label_radius, code_versions()])),
    }
    if not overwrite and _holds_model(output, notes):
        _clear_work_folders(output, options)
        log_finished(output, OVERWRITE)
        return load_model(output)
    # The output is held open for one training at a time.
    with atomic_output(output, replace=True) as partial, options.executor() as executor:
        training = _Training(recipe, lanes, output, executor, options)
        training.learn_stages()
        if learns_detector(recipe, features):
            training.train_detector(features, label_radius)
            training.learn_forecast()
        training.learn_ground()
        save_model(training.model, partial, notes)
    _clear_work_folders(output, options)
    return training.model


def _holds_model(folder: Path, notes: Mapping[str, Any]) -> bool:
    """Return whether a whole model of these notes is there; another one is a FileExistsError."""
    if not (folder / MODEL_FILE).is_file():
        return False
    try:
        present = load_model(folder).notes
    except ValueError:
        present = {}
    if any(present.get(name) != value for name, value in notes.items()):
        raise output_exists_error(folder, f"{OVERWRITE}, or choose another output")
    return True


def _clear_work_folders(output: Path, options: RunOptions) -> None:
    """Delete the work folders beside a model that is written."""
    for work in output.parent.glob(f"{glob.escape(output.name)}-*-*.work*"):
        if re.fullmatch(r"-\d+-\d+\.work(\.done)?", work.name.removeprefix(output.name)):
            shutil.rmtree(work, ignore_errors=True)
    folders = [_work_folder(output, "training"), replaced_by(output)]
    if options.pass_cache is None:
        folders.append(_work_folder(output, "images"))
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)


def _work_folder(output: Path, kind: str) -> Path:
    """Return the path of a folder beside a model that is being trained."""
    return output.with_name(f"{output.name}.{kind}")


@dataclass(frozen=True)
class TrainingLane:
    """A training lane."""

    job: LaneJob  #: what is done on it, with its truth
    targets: pd.DataFrame  #: what the truth holds

    @property
    def area(self) -> Lane:
        """Its borders."""
        return Lane(*self.job.lane)

    @property
    def name(self) -> str:
        """Name of its run."""
        return Path(self.job.run).stem


class _Training:
    """A training: its lanes, and what has been learnt so far."""

    def __init__(
        self,
        recipe: Recipe,
        lanes: Sequence[TrainingLane],
        output: Path,
        executor: Executor,
        options: RunOptions,
    ) -> None:
        self.recipe = recipe
        self.output = output
        self.model = Model()
        self.lanes = lanes
        self._executor = executor
        self._options = options
        self._views: list[TrainingView] = []
        self._examples: dict[str, list[Any]] = {}  # of maps that measure clutter, by stage
        self._profiles: list[FloatArray] = []  # level of the images, by lane
        self._free: list[FreeGround] = []  # alarms at no target, by lane
        self._step = 0

    @property
    def _pass_cache(self) -> PathLike | None:
        """Folder of images that the steps share, if there are several."""
        if self._options.pass_cache:
            return self._options.pass_cache
        has_several_steps = bool(self.recipe.learning())
        return _work_folder(self.output, "images") if has_several_steps else None

    def learn_stages(self) -> None:
        """Fit all learning stages, each with what those before it have learnt."""
        stages = self.recipe.named()
        for name in self.recipe.learning():
            if stages[name].stage_class.kind in ("screen", "features"):
                self._views = self._views or self._training_views()
                examples: list[Any] = self._views
            else:
                examples = []
                for setup, _ in self._imaged_lanes(truth=True):
                    examples.append(dict(setup.results[f"learn.{name}"]))
            if getattr(stages[name].stage_class, "measures_clutter", False):
                self._examples[name] = examples
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
        for setup, lane in self._imaged_lanes(truth=True):
            views.append(TrainingView(setup.view(), lane.targets, lane.area))
        return views

    def _fit(self, name: str, examples: list[Any]) -> tuple[Arrays, dict[str, Any]]:
        """Fit a stage; the error of too few examples counts what each step left."""
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
        table = self.recipe.detector or DetectorTable(features=CLASSIFIER_B)
        patterns = list(features) or list(table.features)
        lanes: list[LaneOfAlarms] = []
        raised = 0
        for number, (setup, lane) in enumerate(self._imaged_lanes(truth=False), 1):
            name = f"{number}:{lane.name}"
            ranked = rank_alarms(setup)
            of_alarms = ranked.features
            if "magnitude" in patterns:  # of the alarm, which is read where it is named
                of_alarms = of_alarms.assign(magnitude=ranked.alarms["magnitude"])
            lanes.append((name, ranked.alarms, of_alarms, lane.targets, lane.area))
            self._profiles.append(setup.level_profile())
            raised += len(setup.alarms())
        table = table.model_copy(update={"features": tuple(patterns)})
        columns = _matching(patterns, list(lanes[0][2].columns))
        with self._counted("detector"):
            spent = self._spent()
            spent_by_lane = [pd.concat(rows) for rows in zip(*spent.values(), strict=True)]

            def fit(chosen: Sequence[int]) -> Detector:
                """Train the detector on some lanes, by their numbers."""
                examples = make_training_set(
                    [lanes[number] for number in chosen],
                    label_radius,
                    columns,
                    [spent_by_lane[number] for number in chosen] if spent_by_lane else [],
                )
                if table.estimator == "fisher":
                    return train(examples, columns)
                return train_estimator(examples, table, columns)

            try:
                detector = fit(range(len(lanes)))
            except TooFewExamplesError as error:
                steps = count_alarm_steps(lanes, raised, spent, columns, label_radius)
                raise steps.error(error, self.recipe, table.on) from None
            self.model = replace(self.model, detector=detector)
            if len(lanes) >= LEAST_LANES:
                self._free = _free_ground(lanes, label_radius, fit)

    def learn_forecast(self) -> None:
        """Learn what becomes of the alarms that live detection raises on the lanes.

        Hits and false alarms count alike.
        """
        if not forecast.foresees(self.recipe, self.model):
            return
        settings = LiveSettings(looks=2)  # so that the step from two looks to three counts, too
        with self._counted(forecast.NAME):
            followed: list[forecast.Followed] = []
            for lane in self.lanes:
                run = open_run(lane.job.run, lane.job.max_memory)
                detector = LiveDetector(
                    describe_for_live(run),
                    self.recipe,
                    lane.area,
                    self.model,
                    settings,
                    other_runs(lane.job),
                )
                followed.extend(forecast.follow(detector, run))
            arrays, notes = forecast.learn(followed)
        stages = dict(self.model.stages)
        if arrays:
            stages[forecast.NAME] = arrays
        notes_of_stages = self.model.notes | {forecast.NAME: notes}
        self.model = replace(self.model, stages=stages, notes=notes_of_stages)

    def learn_ground(self) -> None:
        """Learn what tells whether other ground is unlike that of the lanes (``method/unlike.py``).

        The clutter of a lane is compared with what was learnt without it.
        """
        known: dict[str, Any] = {"lanes": len(self.lanes)}
        if len(self.lanes) >= LEAST_LANES:
            name = next(iter(self._examples), "")
            if name or not self._profiles:
                known |= self._measured_clutter(name)
            known["level"], known["profile"] = learn_levels(self._profiles)
            known["free"] = self._free
        self.model = replace(self.model, ground=TrainingGround(**known))

    def _measured_clutter(self, name: str) -> dict[str, Any]:
        """Return what is known of the clutter of all lanes, by the map of a name; "" for none."""
        whole = self.model
        stage = self.recipe.named()[name] if name else None
        measured: list[Any] = []
        whiteners = []
        apart = []
        profiles = []

        def without(number: int) -> Model:
            """Return the model without the clutter of a lane."""
            if stage is None:
                return whole
            mapper: Any = stage.stage_class
            learnt = mapper.without_lane(
                stage.settings, whole.stages[name], self._examples[name], number
            )
            return replace(whole, stages=whole.stages | {name: learnt})

        for setup, _ in self._imaged_lanes(truth=False, model_of=without, only_measures=True):
            profiles.append(setup.level_profile())
            if stage is not None:
                measured.append(
                    {key: np.array(array) for key, array in setup.results[MEASURED].items()}
                )
                whiteners.append(setup.learnt_clutter)
                apart.append(_metres_apart(setup))
        self._profiles = profiles
        if stage is None:
            return {}
        sizes, tail = learn_clutter(measured, whiteners)
        return {"sizes": sizes, "tail": tail, "apart": float(np.mean(apart))}

    @contextmanager
    def _counted(self, name: str) -> Iterator[None]:
        """Report what learning itself costs, without the passes.

        Linear algebra has one thread meanwhile, on which its last bits depend.
        """
        begun = time.perf_counter(), time.process_time()
        with blas_on_one_thread():
            yield
        self._options.note(report(self.output.name, name, -1, begun, 0))

    def _spent(self) -> dict[str, list[pd.DataFrame]]:
        """Return, by stage, the rows of every lane's truth that it has learnt from."""
        spent = {}
        for name, stage in self.recipe.named().items():
            if stage.stage_class.learns:
                rows = stage.stage_class.targets_used_for_training(stage.settings, self._views)
                if rows:
                    spent[name] = rows
        return spent

    def _imaged_lanes(
        self,
        truth: bool,
        model_of: Callable[[int], Model] | None = None,
        only_measures: bool = False,
    ) -> Iterator[tuple[ImagedRun, TrainingLane]]:
        """Do the passes of the lanes as far as the model allows, and yield lane after lane.

        ``model_of`` returns the model that a lane is taken with, by its number from 0.
        """
        self._step += 1
        learnt = None
        if self.model.stages and model_of is None:
            learnt = save_model(self.model, _work_folder(self.output, "training"))
        options = self._options
        cache = self._pass_cache
        for number, lane in enumerate(self.lanes, 1):
            if model_of is not None:
                learnt = save_model(model_of(number - 1), _work_folder(self.output, "training"))
            output = self.output.with_name(f"{self.output.name}-{number}-{self._step}")
            refuse_links(output)
            job = replace(
                lane.job,
                output=absolute(output),
                model=None if learnt is None else absolute(learnt),
                model_sha256="" if learnt is None else model_digest(learnt),
                truth=lane.job.truth if truth else ("", ""),
                pass_cache="" if cache is None else absolute(cache),
                trust=replace(lane.job.trust, only_measures=only_measures),
            )
            label = f"{lane.name}: "
            with passes_of_lane(job, self._executor, options, label) as setup:
                yield setup, lane


def _free_ground(
    lanes: Sequence[LaneOfAlarms], label_radius: float, fit: Callable[[Sequence[int]], Detector]
) -> list[FreeGround]:
    """Return the confidences of the alarms at no target of every lane.

    They are by detectors that were trained without their lane, one for each of ``FOLDS`` groups of
    lanes. Lanes are left out of which the others do not suffice to train one.
    """
    free = []
    folds = min(FOLDS, len(lanes))
    for fold in range(folds):
        inside = range(fold, len(lanes), folds)
        try:
            detector = fit([number for number in range(len(lanes)) if number not in inside])
        except ValueError:
            continue
        for number in inside:
            _, alarms, features, truth, lane = lanes[number]
            off = _to_nearest(alarms, truth)
            counts = lane.contains(alarms["x"], alarms["y"]) & (off > label_radius)
            confidence = np.asarray(detector.confidence(features), dtype=float)[counts]
            area = _area_without(truth, lane, label_radius)
            if area > 0:
                free.append(free_ground(confidence, area))
    return free


def _area_without(truth: pd.DataFrame, lane: Lane, radius: float) -> float:
    """Return the area of a lane farther than a radius from all targets, m², on a lattice of 0.1 m."""
    x = np.arange(lane.x_min + 0.05, lane.x_max, 0.1)
    y = np.arange(lane.y_min + 0.05, lane.y_max, 0.1)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    off = _to_nearest(pd.DataFrame(points, columns=["x", "y"]), truth)
    return float(lane.area * (off > radius).mean())


def _to_nearest(alarms: pd.DataFrame, truth: pd.DataFrame) -> FloatArray:
    """Return the distance of every alarm to the target next to it, m."""
    places = alarms[["x", "y"]].to_numpy(dtype=float)
    targets = truth[["x", "y"]].to_numpy(dtype=float)
    distances = np.linalg.norm(places[:, None] - targets, axis=-1)
    return np.asarray(distances.min(axis=1, initial=np.inf))


def _metres_apart(lane: ImagedRun) -> float:
    """Return how far apart the scans of a lane are that its clutter was measured on, m."""
    chosen = chosen_scans(len(lane))
    if len(chosen) < 2:
        return 0.0
    first, last = lane.setup.pose(int(chosen[0])), lane.setup.pose(int(chosen[-1]))
    return float(np.hypot(*(last - first)[:2])) / (len(chosen) - 1)


def _matching(patterns: list[str], columns: list[str]) -> list[str]:
    """Return the columns that match patterns; refuse a pattern that none matches."""
    matching: list[str] = []
    missing = []
    for pattern in patterns:
        names = [name for name in columns if fnmatchcase(name, pattern)]
        matching += names
        if not names:
            missing.append(pattern)
    if missing or not matching:
        raise ValueError(
            f"features must be columns of the feature table, got {', '.join(missing) or 'none'}"
        )
    return list(dict.fromkeys(matching))

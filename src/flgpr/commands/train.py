"""``flgpr train``: train a recipe on runs with truth."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flgpr.commands.options import (
    LANE,
    REQUIRED,
    OptionalOutput,
    Overwrite,
    PathLike,
    Paths,
    Progress,
    Scheduler,
    ShellType,
    With,
    runs_by_name,
)
from flgpr.commands.runs import run_options
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr.method.model import Model


def _train_lines(model: Model, call: Arguments) -> Iterator[Any]:
    """Yield what was written, from how much it was learnt, and what the check found."""
    from flgpr.method.model_check import check_sentences

    yield call.output
    notes = model.notes
    if "hits" in notes:
        learnt = (
            f"learnt from {notes['hits']} alarms at targets and {notes['false_alarms']} elsewhere"
        )
        yield f"{learnt}, on {len(notes['lanes'])} lane{'s' if len(notes['lanes']) != 1 else ''}"
    yield from check_sentences(Path(call.output))


@command(
    lines=_train_lines,
    resumes=True,
    compiles_kernels=True,
)
def train(
    runs: Paths,
    truths: Annotated[Paths, Option("--truth")],
    recipe: Annotated[PathLike, ShellType(str)] = "wang2007",
    output: Annotated[OptionalOutput, REQUIRED] = None,
    features: Annotated[tuple[str, ...] | list[str], Option("--feature")] = (),
    lanes: Annotated[Paths | None, LANE] = None,
    others: With = (),
    workers: Annotated[int | None, Option(min=1)] = None,
    scheduler: Scheduler = None,
    max_memory: str | int = "2GB",
    overwrite: Overwrite = True,
    check: Annotated[bool, Option("--check/--no-check")] = True,
    *,
    label_radius: float = 1.0,
    track: Progress = None,
    note: Any = None,
    pass_cache: PathLike | None = None,
) -> Model:
    """Train a recipe on runs with truth. An interrupted training resumes.

    A recipe that ``flgpr recipe for --like fused`` fitted to the array is then tried on simulated
    lanes of this array, whose truth is known. What it finds there, and what the contrast finds, is
    printed and stands beside the model, for ``flgpr info`` to show.

    Parameters
    ----------
    runs
        Run stores, one lane each.
    label_radius
        Largest distance of an alarm from the target that it hits, m.
    note
        Takes a report of every piece of work that was done.
    pass_cache
        Folder of backgrounds and run-views that other recipes share.
    output
        folder of the model

    Recipe and lanes
    ----------------
    truths
        CSV of the targets of each run, in the same order.
    recipe
        Recipe with features, or with stages that learn.
    features
        Feature in place of the recipe's; once per feature.
    lanes
        once per run
    others
    check
        Whether a recipe fitted to the array is compared with the contrast on simulated
        lanes.

    Work
    ----
    workers
        Processes; the model is the same.
    scheduler
    max_memory
        Memory of each process; a lane that takes more is refused.

    Returns
    -------
    Model
        What the recipe's stages and its detector have learnt. Until the model is written, the
        detections on the runs are beside the output. Without an output the model is in memory only.

    Raises
    ------
    ValueError
        If an input is not valid, nothing in the recipe learns, or the examples do not suffice.
    FileExistsError
        If another model is there and is not to be overwritten.
    """
    from flgpr.jobs.check_on_twins import check_model
    from flgpr.jobs.job import make_job
    from flgpr.jobs.training import learns_detector, train_on_lanes
    from flgpr.recipe.schema import parse_recipe, recipe_text
    from flgpr.store import open_run

    if len(runs) != len(truths) or not runs:
        raise ValueError(
            f"train needs one truth per run, got {len(runs)} runs and {len(truths)} truths"
        )
    if lanes is not None and len(lanes) != len(runs):
        raise ValueError(f"lane must be given once per run, got {len(lanes)} for {len(runs)} runs")
    options = run_options(workers, scheduler, max_memory, track, note, pass_cache)
    other_runs = runs_by_name(others, len(runs))
    text = recipe_text(recipe)
    parsed = parse_recipe(text, str(recipe))
    if not learns_detector(parsed, features) and not parsed.learning():
        raise ValueError(f"recipe must have features or a stage that learns to train, got {recipe}")
    borders: Sequence[PathLike | None] = lanes or [None] * len(runs)

    def train_at(target: Path) -> Model:
        """Train on the lanes, and write the model."""
        jobs = []
        for run, truth, lane, others_of_run in zip(runs, truths, borders, other_runs, strict=True):
            jobs.append(
                make_job(
                    run,
                    text,
                    lane,
                    target,
                    False,
                    others=others_of_run,
                    truth=truth,
                    options=options,
                )
            )
        return train_on_lanes(jobs, target, features, label_radius, options, overwrite)

    if output is not None:
        target = Path(output)
        model = train_at(target)
        if check:
            run = open_run(runs[0], options.max_memory)
            check_model(target, run, parsed, model, options.track)
        return model
    # Without an output nothing can resume: what is written on the way is temporary.
    with tempfile.TemporaryDirectory(prefix="flgpr-") as folder:
        return train_at(Path(folder) / "model")

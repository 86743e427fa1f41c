"""``flgpr demo``: process the packaged lane."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flgpr.commands.compared_recipes import DEMO_COMPARISONS, detect_compared
from flgpr.commands.options import Output, Overwrite, Progress
from flgpr.commands.score_text import score_lines, score_summary
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr.results.result import Result
    from flgpr.scoring import Score

VIEW = Annotated[bool, Option("--view", help="Open the result in the browser.")]


def _lines(returned: tuple[Result, list[Score]], _: Arguments) -> Iterator[Any]:
    """Yield what became of each target, and the report."""
    result, scores = returned
    yield from score_lines(scores)
    yield f"report: {(result.folder / 'report.html').resolve()}"


def _as_json(returned: tuple[Result, list[Score]], _: Arguments) -> dict[str, Any]:
    """Return the figures of the score."""
    result, scores = returned
    return score_summary(result.folder, scores)


@contextmanager
def _page(call: Arguments) -> Iterator[None]:
    """Show the result in the browser after the command."""
    yield
    if call.view:
        import typer

        from flgpr import viewer
        from flgpr.commands.exporting import map_bytes

        viewer.serve(Path(call.output), announce=typer.echo, make_map=map_bytes)


@command(
    lines=_lines,
    as_json=_as_json,
    context=_page,
    shell_options={"view": (VIEW, False)},
    compiles_kernels=True,
)
def demo(
    output: Output = "demo-result", overwrite: Overwrite = True, *, track: Progress = None
) -> tuple[Result, list[Score]]:
    """Process the packaged lane: image, detect, score, report.

    Returns
    -------
    result, scores
        The result, and a score for each of its detections.

    Raises
    ------
    FileExistsError
        If something that is no result lies at the output, or another result that is not to be
        overwritten.
    """
    from flgpr.chain.method import detect
    from flgpr.chain.progress import silent
    from flgpr.chain.recipe import parse_recipe, recipe_text
    from flgpr.chain.recipe_fit import area_of
    from flgpr.commands.scoring import score_result
    from flgpr.results.description import describe_run
    from flgpr.results.result import check_free, write_result
    from flgpr.store import open_run, sample_lane
    from flgpr.store.outputs import OVERWRITE, log_finished

    track = track or silent
    lane_folder = sample_lane()
    store = lane_folder / "run.zarr"
    folder = check_free(output)

    text = recipe_text("demo")
    compared = {name: recipe_text(f"demo-{name}") for name in DEMO_COMPARISONS}

    run = open_run(store)
    recipe = parse_recipe(text)
    description = describe_run(run, store, recipe.motion)

    # The same recipes on the same run: there is nothing to do but to score.
    if not overwrite and _holds_demo(folder, description, text, compared):
        log_finished(folder, OVERWRITE)
    else:
        lane = area_of(run, recipe)
        detections = [detect(run, recipe, lane, track)]
        for name, compared_text in compared.items():
            detections.append(detect_compared(run, name, compared_text, lane, track))
        write_result(folder, detections, text, lane, description)

    truth = lane_folder / "truth.csv"
    objects = lane_folder / "objects.csv"
    return score_result(folder, truth, objects, track=track, overwrite=overwrite)


def _holds_demo(
    folder: Path, description: dict[str, Any], text: str, compared: dict[str, str]
) -> bool:
    """Return whether a folder holds this result of the packaged lane.

    Another result is a FileExistsError.
    """
    import flgpr
    from flgpr.results.errors import ResultError
    from flgpr.results.result import read_result
    from flgpr.results.sections import SECTIONS
    from flgpr.store.outputs import OVERWRITE, output_exists_error

    if not any((folder / name).is_file() for name in ("manifest.json", SECTIONS)):
        return False

    refusal = output_exists_error(folder, f"{OVERWRITE}, or choose another output")
    try:
        result = read_result(folder)
    except ResultError:
        raise refusal from None

    recipes = {detection.name: detection.recipe_text for detection in result.detections[1:]}
    same_run = result.manifest["run"].get("store_sha256") == description["store_sha256"]
    same_version = result.manifest["flgpr"] == flgpr.__version__
    same_recipes = (result.recipe_text, recipes) == (text, compared)

    if not (same_run and same_version and same_recipes):
        raise refusal
    return True

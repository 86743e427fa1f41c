"""``flgpr info``: tell what a run, a file or a model holds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from flgpr.commands.info_words import info_lines, model_lines
from flgpr.commands.options import OneOrMorePaths, PathLike, ShellType, one_or_more
from flgpr.commands.shell import Arguments, command


def _is_model(path: Path) -> bool:
    return (path / "model.bundle").is_file() or (path / "manifest.json").is_file()


def _lines(returned: Any, call: Arguments) -> Iterator[str]:
    first = call.paths[0]
    if len(call.paths) > 1 or first.is_file():
        yield from _file_lines(returned, call)
    elif _is_model(first):
        yield from model_lines(returned)
    else:
        yield from info_lines(returned)
        if call.plot is not None:
            yield f"plot: {call.plot.resolve()}"


def _file_lines(described: Any, call: Arguments) -> Iterator[str]:
    several = len(call.paths) > 1
    yield described.kind if several else f"{described.path}: {described.kind}"
    for line in described.lines:
        yield f"  {line}"
    if call.mapping is not None:
        guesses = described.mapping.count('?"')
        yield f"wrote {call.mapping}, with {guesses} question mark{'s' * (guesses != 1)}"
    elif described.mapping:
        yield f"\nA mapping to begin with (flgpr import mapped):\n\n{described.mapping}"


def _as_json(returned: Any, call: Arguments) -> Any:
    if len(call.paths) > 1 or call.paths[0].is_file():
        return {"kind": returned.kind, "lines": returned.lines, "mapping": returned.mapping}
    return returned


@command(lines=_lines, as_json=_as_json, quiet=False)
def info(
    paths: Annotated[
        OneOrMorePaths,
        Argument(
            help="Run store, file to import, model, or result whose model is meant; or all files of one measurement."
        ),
    ],
    recipe: Annotated[
        PathLike | None,
        Option(help="Recipe whose images and lane decide what is covered; tells whether it fits."),
        ShellType(str),
    ] = None,
    recipes: Annotated[
        bool, Option("--recipes", help="Tell of every packaged recipe whether it fits.")
    ] = False,
    plot: Annotated[
        PathLike | None, Option(help="PNG to write: plan, coverage and side view.")
    ] = None,
    mapping: Annotated[
        PathLike | None, Option(help="TOML to write: the draft of the files' mapping.")
    ] = None,
) -> Any:
    """Tell what a run, a file or a model holds, in plain words and units; a model is not loaded for it.

    Several files of one measurement are told together, with one draft of their mapping.

    Returns
    -------
    dict or Explanation
        Of a run :func:`flgpr.commands.run_report.run_info`, of a model or a result
        :func:`flgpr.commands.run_report.model_info`, of files their kind, lines and mapping.

    Raises
    ------
    ValueError
        If a file or a store cannot be read, or a mapping is asked for that no import needs.
    """
    listed = [Path(path) for path in one_or_more(paths)]
    first = listed[0]
    if len(listed) > 1 or first.is_file():
        return _explain(listed, None if mapping is None else Path(mapping))
    if mapping is not None:
        raise ValueError(f"a mapping is drafted for files, got {first}")
    from flgpr.commands.run_report import model_info, run_info

    if _is_model(first):
        return model_info(first)
    return run_info(first, recipe, plot, recipes)


def _explain(paths: list[Path], mapping: Path | None) -> Any:
    """Describe files that are no run yet, and write the draft of their mapping if it is wanted."""
    from flgpr.formats.drafting import explain_files
    from flgpr.formats.explain import explain_file

    several = len(paths) > 1
    described = explain_files(paths, beside=mapping) if several else explain_file(paths[0])
    if mapping is None:
        return described
    if not described.mapping:
        raise ValueError(
            f"{paths[0]}: a {described.kind} needs no mapping, none is written to {mapping}"
        )
    if not mapping.parent.is_dir():
        raise FileNotFoundError(f"the folder of the output must exist, got {mapping.parent}")
    from flgpr.store.outputs import write_new

    write_new(mapping, described.mapping)
    return described

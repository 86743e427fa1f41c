"""``flgpr info``: show what a run, a file or a model holds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from flgpr.commands.info_text import info_lines, model_lines
from flgpr.commands.options import OneOrMorePaths, PathLike, ShellType, one_or_more
from flgpr.commands.shell import Arguments, command


def _is_model(path: Path) -> bool:
    """Return whether a folder is a model, or a result that may have one."""
    return (path / "model.bundle").is_file() or (path / "manifest.json").is_file()


def _lines(returned: Any, call: Arguments) -> Iterator[str]:
    """Yield the text about files, a model or a run."""
    first = call.paths[0]
    if len(call.paths) > 1 or first.is_file():
        yield from _file_lines(returned, call)
    elif _is_model(first):
        yield from model_lines(returned)
    else:
        yield from info_lines(returned)
        yield f"`flgpr check {first}` says whether it is right: signs, orders, heading, units"
        if call.plot is not None:
            yield f"plot: {call.plot.resolve()}"


def _file_lines(described: Any, call: Arguments) -> Iterator[str]:
    """Yield kind and content of files, then the draft of their mapping or where it is."""
    if len(call.paths) > 1:
        yield described.kind
    else:
        yield f"{described.path}: {described.kind}"
    for line in described.lines:
        yield f"  {line}"
    if call.mapping is not None:
        guesses = described.mapping.count('?"')
        plural = "" if guesses == 1 else "s"
        yield f"wrote {call.mapping}, with {guesses} question mark{plural}"
    elif described.mapping:
        yield f"\nA mapping to begin with (flgpr import mapped):\n\n{described.mapping}"


def _as_json(returned: Any, call: Arguments) -> Any:
    """Return the report of a run or a model, or kind, content and mapping of files."""
    if len(call.paths) > 1 or call.paths[0].is_file():
        return {"kind": returned.kind, "lines": returned.lines, "mapping": returned.mapping}
    return returned


@command(lines=_lines, as_json=_as_json, quiet=False)
def info(
    paths: OneOrMorePaths,
    recipe: Annotated[PathLike | None, ShellType(str)] = None,
    recipes: bool = False,
    plot: PathLike | None = None,
    mapping: PathLike | None = None,
) -> Any:
    """Show what a run, a file or a model holds. A model is not loaded for it.

    Several files of one measurement are described together, with one draft of their mapping.

    Parameters
    ----------
    paths
        Run store, file to import, model, or result with a model; or all files of one measurement.
    recipe
        Recipe whose images and lane decide what is covered; it is checked, too.
    recipes
        Check every packaged recipe.
    plot
        PNG to write: plan, coverage and side view.
    mapping
        TOML to write: the draft of the files' mapping.

    Returns
    -------
    dict or Explanation
        For a run :func:`flgpr.commands.run_report.run_info`, for a model or a result
        :func:`flgpr.commands.run_report.model_info`, for files their kind, lines and mapping.

    Raises
    ------
    ValueError
        If a file or a store cannot be read, or a mapping is asked for that no import needs.
    """
    path_list = [Path(path) for path in one_or_more(paths)]
    first = path_list[0]
    if len(path_list) > 1 or first.is_file():
        return _explain(path_list, None if mapping is None else Path(mapping))
    if mapping is not None:
        raise ValueError(f"a mapping is drafted for files, got {first}")
    from flgpr.commands.run_report import model_info, run_info

    if _is_model(first):
        return model_info(first)
    return run_info(first, recipe, plot, recipes)


def _explain(paths: list[Path], mapping: Path | None) -> Any:
    """Describe files that are no run yet, and write the draft of their mapping to a path."""
    from flgpr.formats.explain import explain_file, explain_files

    is_group = len(paths) > 1
    described = explain_files(paths, mapping=mapping) if is_group else explain_file(paths[0])
    if mapping is None:
        return described
    if not described.mapping:
        raise ValueError(
            f"{paths[0]}: a {described.kind} needs no mapping, none is written to {mapping}"
        )
    from flgpr.commands.importing import check_parent_folder
    from flgpr.store.outputs import write_new

    write_new(check_parent_folder(mapping), described.mapping)
    return described

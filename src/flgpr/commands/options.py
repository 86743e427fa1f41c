"""Options that several commands have, and the types that their functions take.

A command's function describes its parameters once: their types in its signature, what they are in
its docstring. An ``Argument`` or ``Option`` beside the type says more of a parameter of the command
line, such as its bounds; a :class:`SharedOption` begins a help that the docstring ends. What the
command line parses for each type is in :func:`flgpr.commands.signatures.shell_type`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional, Union

from typer import Option

if TYPE_CHECKING:
    import pandas
    import xarray

    from flgpr.model import Lane
    from flgpr.progress import Track
    from flgpr.results.result import Result

PathLike = str | Path
Paths = Sequence[str | Path]
OneOrMorePaths = str | Path | Sequence[str | Path]
RunLike = Union[str, Path, "xarray.Dataset"]
"""A run store, or a run in memory."""
RunsLike = Union[str, Path, "xarray.Dataset", Sequence[Union[str, Path, "xarray.Dataset"]]]
LanesLike = Union[str, Path, "Lane", Sequence[Union[str, Path, "Lane"]]]
"""Files of lanes, or lanes in memory."""
ResultsLike = Union[str, Path, "Result", Sequence[Union[str, Path, "Result"]]]
"""Folders of results or files of alarm lists, or results that were read."""
TruthLike = Union[str, Path, "pandas.DataFrame"]
"""A file of targets, or a table of them in memory."""
Limits = tuple[float, float]
Point = tuple[float, float, float]


@dataclass(frozen=True)
class ShellDefault:
    """Default of an option on the command line, where that of the function is another one."""

    value: Any


@dataclass(frozen=True)
class ShellType:
    """Type that the command line parses, where it does not follow from that of the parameter."""

    type: Any


REQUIRED = ShellDefault(...)
"""Marks an option that must be given on the command line and may be left out in Python."""

OVERWRITE_HELP = "Make it anew, whatever the output holds of an earlier run."


@dataclass(frozen=True)
class SharedOption:
    """An option that several commands have; what each says of it stands in its docstring."""

    names: tuple[str, ...]
    help: str
    sign: str = "; "  #: between this help and what a command adds to it

    def option(self, more: str = "") -> Any:
        """Return the option with what a command says of it in a few words."""
        return Option(*self.names, help=f"{self.help}{more and self.sign + more}.")


OUTPUT = SharedOption(("-o", "--output"), "What to write", ": ")
LANE = SharedOption(("--lane",), "TOML of the lane: x_min, x_max, y_min, y_max, m")
ANCHOR = SharedOption(("--anchor",), "TOML that ties the lane to the Earth")
Output = Annotated[PathLike, OUTPUT]
OptionalOutput = Annotated[PathLike | None, OUTPUT]
LaneOption = Annotated[PathLike | None, LANE]
AnchorOption = Annotated[PathLike | None, ANCHOR]
Overwrite = Annotated[
    bool,
    OVERWRITE_HELP,
    ShellDefault(False),  # a command that is typed again must not destroy earlier work
]
Scheduler = Annotated[str | None, "Dask scheduler (tcp://host:8786) whose workers do the work."]
With = Annotated[
    Sequence[str] | Sequence[Mapping[str, RunLike]] | Mapping[str, RunLike],
    Option(
        "--with",
        help="NAME=RUN: another run of the lane, such as a second band; once per name and run.",
    ),
]
RunArgument = Annotated[PathLike, "Run store."]
Progress = Annotated[Optional["Track"], "Shows progress; silent by default."]


def one_or_more(value: Any) -> list[Any]:
    """Return the members of a sequence, or a list of the one value; of None an empty list."""
    if value is None:
        return []
    if isinstance(value, str | Path) or not isinstance(value, Sequence):
        return [value]
    return list(value)


def size_in_bytes(size: str | int) -> int:
    """Return a size in bytes of a text such as "2GB", or of a number of bytes."""
    if isinstance(size, int):
        return size
    from flgpr.method.memory import parse_size

    return parse_size(size)


def runs_by_name(others: Any, count: int) -> list[dict[str, Any]]:
    """Return, for each of a number of runs, the runs that are taken together with it by name.

    ``others`` are texts NAME=RUN, of which the first of a name belongs to the first run, and so on;
    or a mapping of names to runs, or such a mapping for each run. A name that does not occur once
    for each run is a ValueError.
    """
    items: list[Any] = [others] if isinstance(others, Mapping) else list(others or ())
    if not items:
        return [{} for _ in range(count)]
    if not any(isinstance(item, str) for item in items):
        return [dict(item) for item in items]
    runs: dict[str, list[Path]] = {}
    for text in items:
        name, equals, path = text.partition("=")
        if not (name and equals and path):
            raise ValueError(f"with must be NAME=RUN, got {text!r}")
        runs.setdefault(name, []).append(Path(path))
    for name, paths in runs.items():
        if len(paths) != count:
            raise ValueError(
                f"with must give {name} once per run, got {len(paths)} for {count} runs"
            )
    return [{name: paths[number] for name, paths in runs.items()} for number in range(count)]

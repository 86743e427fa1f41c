"""``flgpr prepare``: prepare raw data step by step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flgpr.commands.options import Limits, Output, PathLike, RunArgument, ShellType, size_in_bytes
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    import xarray as xr


def _lines(_: xr.Dataset, call: Arguments) -> Iterator[Path]:
    """Yield the store that was written."""
    yield call.output


@command(lines=_lines)
def prepare(
    run: RunArgument,
    output: Output,
    subtract: PathLike | None = None,
    time_zero: float | None = None,
    dewow: float | None = None,
    gate: Limits | None = None,
    background: bool = False,
    background_scans: int | None = None,
    band: Limits | None = None,
    power: float | None = None,
    agc: float | None = None,
    steps: Annotated[PathLike | Sequence[Mapping[str, Any]] | None, ShellType(Path)] = None,
    max_memory: str | int = "2GB",
) -> xr.Dataset:
    """Prepare raw data, in the order of the options. The new run's history holds the steps.

    Parameters
    ----------
    subtract
        Run to subtract, such as one without the target.
    time_zero
        Shift of time zero to a later time, ns.
    dewow
        Subtract a running mean over this time, ns, from each trace.
    gate
        Set to zero what arrives before and after, ns: the direct wave.
    background
        Subtract what is the same in all scans.
    background_scans
        The same, over this number of scans around each.
    band
        Band to keep, GHz.
    power
        Amplify by this power of time.
    agc
        Bring all times to one level, over a window of this time, ns.
    steps
        TOML of steps in any order, in place of all these.
    max_memory
        Largest memory that is used.

    Returns
    -------
    xarray.Dataset
        The run that was stored, with the steps in its attribute ``history``.

    Raises
    ------
    ValueError
        If there is no step, a step does not fit the run, or the run takes more memory than allowed.
    FileExistsError
        If another run is at the output.
    """
    from flgpr.commands.preparing import check_steps, prepare_run, read_steps

    # The order is that of usual processing: geometry and noise first, amplitudes last.
    in_order: dict[str, dict[str, Any] | None] = {
        "subtract": _entry(subtract, run=str(subtract)),
        "time-zero": _entry(time_zero, delay_ns=time_zero),
        "dewow": _entry(dewow, length_ns=dewow),
        "gate": _limits_entry(gate, "start_ns", "stop_ns"),
        "background": _entry(background or background_scans, scans=background_scans),
        "band": _limits_entry(band, "low_ghz", "high_ghz"),
        "power": _entry(power, exponent=power),
        "agc": _entry(agc, window_ns=agc),
    }

    entries: list[dict[str, Any]] = []
    for name, values in in_order.items():
        if values is not None:
            entries.append({"do": name, **values})

    if steps is None:
        listed = check_steps(entries)
    elif not isinstance(steps, str | Path):
        listed = check_steps(steps)
    elif entries:
        names = ", ".join(entry["do"] for entry in entries)
        raise ValueError(f"steps must stand alone, got {steps} and {names}")
    else:
        listed = read_steps(steps)
    return prepare_run(run, listed, output, size_in_bytes(max_memory))


def _entry(option: Any, **values: Any) -> dict[str, Any] | None:
    """Return the entries of a step, or none where its option was not given."""
    return None if option is None or option is False else values


def _limits_entry(option: Limits | None, first: str, second: str) -> dict[str, Any] | None:
    """Return the entries of a step that has two limits."""
    return None if option is None else {first: option[0], second: option[1]}

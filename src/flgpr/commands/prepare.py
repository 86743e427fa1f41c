"""``flgpr prepare``: prepare raw data step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flgpr.commands.options import Limits, Output, PathLike, RunArgument, ShellType, size_in_bytes
from flgpr.commands.shell import command, options_given

if TYPE_CHECKING:
    import xarray as xr


@command()
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
    options = options_given(prepare, locals())
    from flgpr.commands.preparing import check_steps, prepare_run, read_steps

    # The order is that of usual processing: geometry and noise first, amplitudes last.
    in_order: dict[str, dict[str, Any]] = {
        "subtract": {"run": str(subtract)},
        "time_zero": {"delay_ns": time_zero},
        "dewow": {"length_ns": dewow},
        "gate": dict(zip(("start_ns", "stop_ns"), gate or (), strict=False)),
        "background": {"scans": background_scans},
        "band": dict(zip(("low_ghz", "high_ghz"), band or (), strict=False)),
        "power": {"exponent": power},
        "agc": {"window_ns": agc},
    }
    if background_scans is not None:
        options.append("background")
    entries = [
        {"do": name.replace("_", "-"), **values}
        for name, values in in_order.items()
        if name in options
    ]
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

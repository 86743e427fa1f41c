"""Raw data prepared step by step; what was done stands in the new run's attribute ``history``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import xarray as xr
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from flgpr.clutter import (
    band_pass,
    dewow,
    gate,
    remove_standing,
    shift_time,
    subtract_run,
    time_gain,
)
from flgpr.door import read_named
from flgpr.model.faults import first_fault, parse_entries
from flgpr.store import MAX_MEMORY, open_run, save_run
from flgpr.store.files import existing

PathLike = str | Path
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_COPIES = 4  # of the signal, while a step is at work


class _Step(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    def apply(self, run: xr.Dataset) -> xr.Dataset:
        """Take a run to a new one."""
        raise NotImplementedError


class Subtract(_Step):
    """Subtract another run, such as one without the target: :func:`flgpr.clutter.subtract_run`."""

    do: Literal["subtract"] = "subtract"
    run: str

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return subtract_run(run, open_run(self.run).compute())


class TimeZero(_Step):
    """Put time zero later: :func:`flgpr.clutter.shift_time`."""

    do: Literal["time-zero"] = "time-zero"
    delay_ns: Annotated[float, Field(allow_inf_nan=False)]

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return shift_time(run, self.delay_ns * 1e-9)


class Dewow(_Step):
    """Take the running mean of a trace off it: :func:`flgpr.clutter.dewow`."""

    do: Literal["dewow"] = "dewow"
    length_ns: Positive

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return dewow(run, self.length_ns * 1e-9)


class Gate(_Step):
    """Silence what comes before, such as the direct wave, and after: :func:`flgpr.clutter.gate`."""

    do: Literal["gate"] = "gate"
    start_ns: Annotated[float, Field(allow_inf_nan=False)]
    stop_ns: float = math.inf
    ramp_ns: NotNegative = 0.5

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return gate(run, self.start_ns * 1e-9, self.stop_ns * 1e-9, self.ramp_ns * 1e-9)


class Background(_Step):
    """Take off what stands still over all scans, or over so many: :func:`flgpr.clutter.remove_standing`."""

    do: Literal["background"] = "background"
    scans: Annotated[int, Field(ge=3)] | None = None

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return remove_standing(run, self.scans)


class Band(_Step):
    """Keep a band: :func:`flgpr.clutter.band_pass`."""

    do: Literal["band"] = "band"
    low_ghz: NotNegative
    high_ghz: Positive
    taper: Annotated[float, Field(ge=0, le=1)] = 0.1

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return band_pass(run, self.low_ghz * 1e9, self.high_ghz * 1e9, self.taper)


class Power(_Step):
    """Amplify by a power of time: :func:`flgpr.clutter.time_gain`."""

    do: Literal["power"] = "power"
    exponent: Positive

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return time_gain(run, "power", self.exponent)


class Agc(_Step):
    """Bring all times to one level: :func:`flgpr.clutter.time_gain`."""

    do: Literal["agc"] = "agc"
    window_ns: Positive

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return time_gain(run, "agc", self.window_ns * 1e-9)


Step = Subtract | TimeZero | Dewow | Gate | Background | Band | Power | Agc


class _Steps(BaseModel):
    model_config = ConfigDict(extra="forbid")
    step: list[Annotated[Step, Field(discriminator="do")]] = Field(min_length=1)


def read_steps(path: PathLike) -> list[Step]:
    """Read steps from TOML, a table ``[[step]]`` each, with its name in ``do``; a fault is a ValueError."""
    return parse_entries(_Steps, read_named(existing(path, "file of steps")), str(path)).step


def check_steps(entries: Sequence[Mapping[str, Any]]) -> list[Step]:
    """Make steps of their entries; what breaks a rule is a ValueError that names it."""
    try:
        return _Steps.model_validate({"step": list(entries)}).step if entries else []
    except ValidationError as error:
        raise ValueError(first_fault(error, _Steps)) from None


def prepare_run(
    run: PathLike, steps: Sequence[Step], output: PathLike, max_memory: int = MAX_MEMORY
) -> xr.Dataset:
    """Apply steps to a stored run, in their order, and store what they give as a new run.

    Each stands in the attribute ``history`` after those of the run that was read. No step, a step that does not fit,
    or a run that takes more than ``max_memory`` bytes is a ValueError.
    """
    if not steps:
        raise ValueError("prepare needs at least one step, got none")
    held = open_run(run)
    size = _COPIES * held["signal"].nbytes
    if size > max_memory:
        raise ValueError(
            f"run must fit into max-memory = {max_memory / 1e9:.3g} GB, it takes {size / 1e9:.3g} GB"
        )
    made = held.compute()
    for number, step in enumerate(steps, 1):
        try:
            made = step.apply(made)
        except ValueError as error:
            raise ValueError(f"step {number}, {step.do}: {error}") from None
    done: list[dict[str, Any]] = [step.model_dump(exclude_none=True, mode="json") for step in steps]
    made = made.assign_attrs(held.attrs, history=[*held.attrs.get("history", []), *done])
    save_run(made, output, resume=True)
    return made

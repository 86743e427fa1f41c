"""Raw data prepared step by step; the new run's attribute ``history`` holds the steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
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
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.faults import first_fault, parse_entries
from flgpr.store import MAX_MEMORY, open_run, save_run
from flgpr.store.files import existing
from flgpr.store.notes import log_note
from flgpr.types import PathLike

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_SAME_PLACE = 0.1  # of the shortest wavelength; assumed
_COPIES = 4  # of the signal, while a step is at work


class _Step(BaseModel):
    """A step; its fields are the entries of ``[[step]]`` in a file of steps."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    def apply(self, run: xr.Dataset) -> xr.Dataset:
        """Return the run after the step."""
        raise NotImplementedError


class Subtract(_Step):
    """Subtract another run, such as one without the target: :func:`flgpr.clutter.subtract_run`."""

    do: Literal["subtract"] = "subtract"
    run: str

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        other = open_run(self.run).compute()
        difference = subtract_run(run, other)
        if run.sizes["scan"] != other.sizes["scan"]:
            log_note(
                f"{self.run} has {other.sizes['scan']} scans beside {run.sizes['scan']}: the mean of "
                "its complete ones is subtracted from all"
            )
            return difference
        apart = np.linalg.norm((run["pose"].values - other["pose"].values)[:, :3], axis=1)
        elsewhere = apart > _SAME_PLACE * SPEED_OF_LIGHT / float(run["frequency"].values[-1])
        if elsewhere.any():
            log_note(
                f"{self.run}: {elsewhere.sum()} of {apart.size} scans were taken elsewhere, up to "
                f"{np.nanmax(apart):.3g} m from those that they are subtracted from"
            )
        return difference


class TimeZero(_Step):
    """Put time zero later: :func:`flgpr.clutter.shift_time`."""

    do: Literal["time-zero"] = "time-zero"
    delay_ns: Annotated[float, Field(allow_inf_nan=False)]

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return shift_time(run, self.delay_ns * 1e-9)


class Dewow(_Step):
    """Subtract the running mean from each trace: :func:`flgpr.clutter.dewow`."""

    do: Literal["dewow"] = "dewow"
    length_ns: Positive

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return dewow(run, self.length_ns * 1e-9)


class Gate(_Step):
    """Set to zero what arrives before and after: :func:`flgpr.clutter.gate`."""

    do: Literal["gate"] = "gate"
    start_ns: Annotated[float, Field(allow_inf_nan=False)]
    stop_ns: Annotated[float, Field(allow_inf_nan=False)] | None = None
    ramp_ns: NotNegative = 0.5

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        stop = math.inf if self.stop_ns is None else self.stop_ns * 1e-9
        return gate(run, self.start_ns * 1e-9, stop, self.ramp_ns * 1e-9)


class RemoveBackground(_Step):
    """Subtract what is the same in all scans, or in this number of scans around each.

    See :func:`flgpr.clutter.remove_standing`.
    """

    do: Literal["background"] = "background"
    scans: Annotated[int, Field(ge=3)] | None = None

    def apply(self, run: xr.Dataset) -> xr.Dataset:  # noqa: D102
        return remove_standing(run, self.scans)


class KeepBand(_Step):
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


Step = Subtract | TimeZero | Dewow | Gate | RemoveBackground | KeepBand | Power | Agc


class _Steps(BaseModel):
    """A file of steps."""

    model_config = ConfigDict(extra="forbid")
    step: list[Annotated[Step, Field(discriminator="do")]] = Field(min_length=1)


def read_steps(path: PathLike) -> list[Step]:
    """Read steps from TOML, a table ``[[step]]`` each, with its name in ``do``.

    A fault is a ValueError.
    """
    return parse_entries(_Steps, read_named(existing(path, "file of steps")), str(path)).step


def check_steps(entries: Sequence[Mapping[str, Any]]) -> list[Step]:
    """Return steps for their entries; a broken rule is a ValueError that names it."""
    if not entries:
        return []
    try:
        return _Steps.model_validate({"step": list(entries)}).step
    except ValidationError as error:
        raise ValueError(first_fault(error, _Steps)) from None


def apply_steps(
    run: xr.Dataset,
    steps: Sequence[Step],
    check: Callable[[Step, xr.Dataset], None] = lambda *_: None,
) -> xr.Dataset:
    """Return a run after steps; an error names the step, as does one of the check before each."""
    for number, step in enumerate(steps, 1):
        try:
            check(step, run)
            run = step.apply(run)
        except ValueError as error:
            raise ValueError(f"step {number}, {step.do}: {error}") from None
    return run


def prepare_run(
    run: PathLike, steps: Sequence[Step], output: PathLike, max_memory: int = MAX_MEMORY
) -> xr.Dataset:
    """Apply steps to a stored run, in their order, and store the new run.

    Parameters
    ----------
    run : path
        Run store.
    steps : sequence of Step
        At least one.
    output : path
        Run store to make. Its attribute ``history`` has the steps after those of the run.
    max_memory : int
        Largest memory, bytes.

    Returns
    -------
    xarray.Dataset
        The run that was stored.

    Raises
    ------
    ValueError
        If there is no step, a step does not fit the run, or the run takes more memory.
    FileExistsError
        If another run is at the output.
    """
    if not steps:
        raise ValueError("prepare needs at least one step, got none")
    stored = open_run(run)
    size = _COPIES * stored["signal"].nbytes
    if size > max_memory:
        raise ValueError(
            f"run must fit into max-memory = {max_memory / 1e9:.3g} GB, "
            f"it takes {size / 1e9:.3g} GB"
        )

    prepared = apply_steps(stored.compute(), steps)
    history = list(stored.attrs.get("history", []))
    for step in steps:
        history.append(step.model_dump(exclude_none=True, mode="json"))
    prepared = prepared.assign_attrs(stored.attrs, history=history)
    save_run(prepared, output, resume=True, share_files=True)
    return prepared

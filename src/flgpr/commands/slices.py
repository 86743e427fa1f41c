"""Depth slices of a run: focused images of level planes below the ground, beside one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from flgpr.chain.progress import Track, silent
from flgpr.imaging.focus import focus
from flgpr.imaging.view_axes import View
from flgpr.store import open_run
from flgpr.store.outputs import whole_output

PathLike = str | Path
ENDINGS = (".png", ".npz")
_MOST = 24  # slices of one picture
_PIXELS = 60_000  # of a slice, where the spacing is ours to choose
_ALL_OF_IT = View()
_MARGIN = 0.25  # m of ground around the antennas' ways


@dataclass(frozen=True)
class Slices:
    """Depth slices of a run."""

    image: xr.DataArray  #: complex64 (polarization, z, y, x); z is minus the depth below z = 0, m
    spacing: float  #: of pixels, m
    scans: int


def make_slices(
    run: PathLike,
    depths: Sequence[float],
    view: View = _ALL_OF_IT,
    output: Sequence[PathLike] = (),
    track: Track = silent,
) -> Slices:
    """Focus level planes at ``depths``, m below z = 0, of a stored run, and write them as PNG or NumPy (.npz).

    ``view`` is as for :func:`flgpr.commands.picture.make_picture`, without z; x and y are by
    default all that the antennas went over. Depths that do not increase, more than 24 of them, or
    an output of another ending are a ValueError.
    """
    files = [Path(one) for one in output]
    for path in files:
        if path.suffix.lower() not in ENDINGS:
            raise ValueError(
                f"output of depth slices must end in {', '.join(ENDINGS)}, got {path.name!r}"
            )
    wanted = np.asarray(depths, dtype=np.float64)
    rising = wanted.size > 0 and bool((np.diff(wanted) > 0).all())
    if not rising or wanted.size > _MOST or not np.isfinite(wanted).all() or wanted[0] < 0:
        raise ValueError(
            f"depth must be up to {_MOST} depths from 0 on that increase, m, got {list(map(float, wanted))}"
        )
    if view.z is not None:
        raise ValueError("depth and z both say how deep: give one")
    held = open_run(run)
    pose = held["pose"].values
    around = {
        axis: (float(pose[:, column].min()) - _MARGIN, float(pose[:, column].max()) + _MARGIN)
        for column, axis in enumerate("xy")
    }
    x = around["x"] if view.x is None else view.x
    y = around["y"] if view.y is None else view.y
    parts = []
    for depth in track(wanted.tolist(), "depth slices", wanted.size):
        here = replace(view, x=x, y=y, z=-depth)
        parts.append(focus(held, here, title=Path(run).name, pixels=_PIXELS))
    image = xr.concat(
        [part.image for part in parts], dim="z", combine_attrs="override", join="exact"
    )
    made = Slices(image, parts[0].spacing, parts[0].scans)
    for path in files:
        _write(made, pose, path)
    return made


def _write(made: Slices, pose: np.ndarray, path: Path) -> None:
    with whole_output(path) as partial:
        if path.suffix.lower() == ".png":
            from flgpr.report import figure_png  # loads what draws
            from flgpr.report.slices import slices_figure

            figure = slices_figure(made.image, pose)
            partial.write_bytes(figure_png(figure))
        else:
            axes = {str(name): axis.values for name, axis in made.image.coords.items()}
            np.savez(partial, image=made.image.values, **axes)

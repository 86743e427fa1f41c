"""Files of what is drawn: the endings that are allowed, and a picture or its arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flgpr.store.outputs import atomic_output

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

PathLike = str | Path


def files_to_write(output: Sequence[PathLike], endings: Sequence[str], of: str = "") -> list[Path]:
    """Return files whose names must have one of some endings; ``of`` says what is written."""
    files = [Path(name) for name in output]
    for path in files:
        if path.suffix.lower() not in endings:
            raise ValueError(f"output{of} must end in {', '.join(endings)}, got {path.name!r}")
    return files


def write_drawing(
    path: Path, figure: Callable[[], Figure], arrays: Callable[[], Mapping[str, Any]]
) -> None:
    """Write what was drawn as PNG, or its arrays as NumPy archive, by the ending."""
    with atomic_output(path) as partial:
        if path.suffix.lower() == ".png":
            from flgpr.report import figure_png  # loads Matplotlib

            partial.write_bytes(figure_png(figure()))
        else:
            np.savez(partial, **arrays())


def image_arrays(image: xr.DataArray) -> dict[str, Any]:
    """Return the arrays of an image and its axes by name."""
    axes = {str(name): axis.values for name, axis in image.coords.items()}
    return {"image": image.values, **axes}

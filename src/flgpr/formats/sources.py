"""The values that a mapping's entries stand for: variables of the files it names, and numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flgpr.formats.array_file import ArrayFile
from flgpr.formats.arrays import open_arrays
from flgpr.formats.mapping import EntryValue, Index, Positions, Quantity, Variable, factor
from flgpr.model.faults import faults_of
from flgpr.types import AnyArray, FloatArray, IntArray, Notes, floats

if TYPE_CHECKING:
    from flgpr.geo.anchor import Anchor

_LARGEST = 1e30
_SMALLEST = 1e-30


@dataclass
class Sources:
    """The files of a mapping.

    Whatever is wrong with a value is a ValueError that names its file and its entry.
    """

    files: dict[str, list[Path]]
    join: str  #: dimension along which several files continue
    limit: int  #: largest array, and largest sum over the files that are joined, bytes
    grid: tuple[int, ...] = ()  #: lengths of the scan axes of a raster
    notes: Notes = field(default_factory=list)
    anchor_from_track: bool = False  #: whether fixes without an anchor make their own
    anchor: Anchor | None = None  #: what they made
    _open: dict[Path, ArrayFile] = field(default_factory=dict)

    @contextmanager
    def entry(self, where: str, file: str | None) -> Iterator[None]:
        """Name the entry and its file in a ValueError that does not name them yet."""
        try:
            yield
        except ValueError as error:
            message = str(error)
            paths = self.files.get(file or "", [])
            if not re.search(rf"(^|: ){re.escape(where)}\b", message):
                message = f"{where}: {message}"
            if paths and not any(str(path) in message for path in paths):
                more_files = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
                message = f"{paths[0]}{more_files}: {message}"
            raise ValueError(message) from None

    def arrays(self, file: str, variable: str, where: str) -> list[AnyArray]:
        """Read a variable of every file of that name."""
        if file not in self.files:
            raise ValueError(f"{where}: file must be one of {', '.join(self.files)}, got {file!r}")
        blocks = []
        total = 0
        for path in self.files[file]:
            if path not in self._open:
                self._open[path] = open_arrays(path, self.limit)
            opened = self._open[path]
            with faults_of(where):
                values = opened.read(variable)
            self.notes += [note for note in opened.notes if note not in self.notes]
            if values.dtype.kind not in "fciu":
                raise ValueError(
                    f"{where}: {path}: {variable} must hold numbers, got {values.dtype}"
                )
            total += values.nbytes
            if total > self.limit:
                raise ValueError(
                    f"{where}: {variable} of {len(self.files[file])} files must hold at most "
                    f"{self.limit / 1e9:g} GB, got more up to {path}"
                )
            blocks.append(values)
        return blocks

    def assembled(self, blocks: list[AnyArray], along: str, where: str) -> FloatArray:
        """Return the real numbers of several files as one array.

        Those along the joined dimension follow one another. Fixes of a track ("fix") follow one
        another unless every file holds them all. All others must be the same in all files.
        """
        first = blocks[0]
        are_equal = all(np.array_equal(block, first) for block in blocks[1:])
        is_joined = along == self.join.split()[-1]
        is_split_track = along == "fix" and not are_equal
        if len(blocks) > 1 and (is_joined or is_split_track):
            with self.entry(where, None):
                first = np.concatenate([np.atleast_1d(block) for block in blocks])
        elif not are_equal:
            raise ValueError(f"{where} must be the same in all {len(blocks)} files, it is not")
        return real(first, where)

    def vector(
        self, spec: Quantity, kind: str, where: str, along: str = "", count: int | None = None
    ) -> FloatArray:
        """Return the values of a quantity in SI units.

        Parameters
        ----------
        spec : Quantity
            The entry.
        kind : str
            Kind of its unit, such as "time".
        where : str
            Name of the entry in an error.
        along : str
            Dimension of its values: "scan", "pair", "fix", or none.
        count : int, optional
            How many values a span stands for.

        Returns
        -------
        (n,) ndarray
            The values.
        """
        scale = factor(spec.unit, kind, f"{where}.unit")
        with self.entry(where, spec.file if spec.variable is not None else None):
            if spec.span is not None:
                if count is None:
                    raise ValueError(
                        f"{where} must be a variable or values, "
                        "its length follows from nothing else"
                    )
                values = np.linspace(*spec.span, count)
            elif spec.values is not None:
                values = floats(spec.values)
            else:
                values = self._column(spec.file, str(spec.variable), spec.column, along, where)
                if len(self.grid) > 1 and along == "scan":
                    values = self._on_grid(values, None, where)
            values = np.atleast_1d(values).ravel() * scale
            plausible(values, where)
        return values - values[0] if spec.zero_first else values

    def component(
        self,
        entry: EntryValue,
        file: str,
        where: str,
        count: int | None = None,
        along: str = "scan",
    ) -> FloatArray:
        """Return the values of an entry.

        Parameters
        ----------
        entry : float, str or Variable
            The entry.
        file : str
            Where its variable lies, unless the entry names a file.
        where : str
            Name of the entry in an error.
        count : int, optional
            How many values there must be; by default as many as there are.
        along : str
            Their dimension; "scan" is laid out on the raster of scans where there is one.

        Returns
        -------
        (count,) ndarray
            The values, in the unit of the file.
        """
        if not isinstance(entry, Variable):
            try:
                # A checked draft may hold a number as a text.
                return np.full(1 if count is None else count, float(entry))
            except ValueError:
                entry = Variable(variable=str(entry))
        file = entry.file or file
        with self.entry(where, file):
            values = self._column(file, entry.variable, entry.column, along, where)
            plausible(values, where)
            if count is None:
                return values.ravel()
            if len(self.grid) > 1 and along == "scan":
                values = self._on_grid(values, entry.axis, where)
            elif entry.axis is not None:
                raise ValueError(
                    f"{where}.axis is for rasters, whose signal.dims hold scan more than once"
                )
            if values.shape != (count,):
                raise ValueError(f"{where} must have {count} values, got shape {values.shape}")
        return values

    def _column(
        self, file: str, variable: str, column: int | None, along: str, where: str
    ) -> FloatArray:
        """Return a variable, or one column of it, over all files of a name."""
        blocks = []
        for values in self.arrays(file, variable, where):
            if column is None:
                # MATLAB has no vectors: a column of numbers has two axes.
                blocks.append(np.atleast_1d(values.squeeze()))
            elif values.ndim == 2 and 0 <= column < values.shape[1]:
                blocks.append(values[:, column])
            else:
                raise ValueError(
                    f"{where}.column must be a column of the variable, "
                    f"got {column} for shape {values.shape}"
                )
        return self.assembled(blocks, along, where)

    def _on_grid(self, values: FloatArray, axis: int | None, where: str) -> FloatArray:
        """Lay values out over the raster of scans.

        They are one per scan, on the grid or flat, or a vector along one of its axes.
        """
        grid = self.grid
        axes = [number for number, size in enumerate(grid) if values.shape == (size,)]
        if axis is not None:
            if axis not in axes:
                raise ValueError(
                    f"{where}.axis must be a scan axis of {grid} as long as the values, got {axis}"
                )
            axes = [axis]
        if len(axes) > 1:
            raise ValueError(
                f"{where} fits scan axes {axes} of {grid}: say which by axis = {axes[0]} or so"
            )
        if axes:
            along = tuple(-1 if number == axes[0] else 1 for number in range(len(grid)))
            return np.broadcast_to(values.reshape(along), grid).ravel()
        if values.ndim > 1 and values.shape != tuple(size for size in grid if size > 1):
            raise ValueError(
                f"{where} must have the shape {grid} of the scan axes, got {values.shape}"
            )
        return values.ravel()

    def points(
        self, spec: Positions, where: str, along: str, count: int | None = None
    ) -> FloatArray:
        """Return positions.

        Parameters
        ----------
        spec : Positions
            The entry.
        where : str
            Its name in an error.
        along : str
            Dimension of the positions: "scan", "pair" or "fix".
        count : int, optional
            How many there must be, one per scan or fix.

        Returns
        -------
        (..., 3) ndarray
            Positions, m; with ``count`` (count, 3), or with angles in the unit of the file
            (count, 6).
        """
        scale = factor(spec.unit, "length", f"{where}.unit")
        widths = (3,) if count is None else (3, 6)
        with self.entry(where, None if spec.values is not None else spec.file):
            points = self._triples(spec, where, along, count)
            if points.ndim < 2 or points.shape[-1] not in widths:
                raise ValueError(
                    f"{where} must have x, y and z along its last axis, got shape {points.shape}"
                )
            if count is not None:
                if points.ndim > 2 and along == "scan" and points.shape[:-1] != self.grid:
                    raise ValueError(
                        f"{where} must have the shape {self.grid} of the scan axes, "
                        f"got {points.shape}"
                    )
                points = points.reshape(-1, points.shape[-1])
                if len(points) != count:
                    raise ValueError(f"{where} must have {count} positions, got {len(points)}")
            positions = points[..., :3] * scale
            points = np.concatenate([positions, points[..., 3:]], axis=-1)
            plausible(points, where)
            if spec.index is not None:
                rows = self._index(spec.index, points.shape[-2], f"{where}.index")
                points = points[..., rows, :]
        return points

    def _triples(self, spec: Positions, where: str, along: str, count: int | None) -> FloatArray:
        """Return positions of any form that a mapping has, with x, y, z along the last axis."""
        if spec.values is not None:
            return floats(spec.values)
        if spec.variable is None:
            sides = [
                self.component(entry, spec.file, f"{where}.{name}", count, along)
                for name, entry in zip("xyz", (spec.x, spec.y, spec.z), strict=True)
                if entry is not None
            ]
            try:
                return np.stack(np.broadcast_arrays(*sides), axis=-1)
            except ValueError:
                sizes = ", ".join(str(side.size) for side in sides)
                raise ValueError(f"{where} must have as many x as y and z, got {sizes}") from None
        blocks = self.arrays(spec.file, spec.variable, where)
        points = self.assembled(blocks, along, where)
        has_three_rows = points.ndim == 2 and points.shape[0] == 3
        if has_three_rows and points.shape[1] not in (2, 3, 6):
            points = points.T  # a column per position, as is the custom in MATLAB
        elif points.shape == (3, 3) and spec.z is None:
            self.notes.append(
                f"{where} is 3 x 3: a row is taken for a position; where a column is one, name its "
                "rows as x, y and z"
            )
        if spec.z is None:
            return points
        if points.ndim < 2 or points.shape[-1] != 2:
            raise ValueError(
                f"{where} must have x and y alone with z beside it, got shape {points.shape}"
            )
        height = self.component(spec.z, spec.file, f"{where}.z", points[..., 0].size, along)
        return np.concatenate([points, height.reshape(*points.shape[:-1], 1)], axis=-1)

    def _index(self, spec: Index, count: int, where: str) -> IntArray:
        """Return which of so many antennas each pair uses, from 0."""
        with self.entry(where, spec.file):
            values = self._column(spec.file, spec.variable, spec.column, "pair", where).ravel()
            rows = values - spec.first
            are_whole = np.isfinite(rows).all() and not (rows != np.round(rows)).any()
            if not are_whole or rows.min() < 0 or rows.max() >= count:
                raise ValueError(
                    f"{where} must hold whole numbers from {spec.first} to "
                    f"{count - 1 + spec.first}, got {values.min():g} to {values.max():g}"
                )
        return rows.astype(np.int64)


def real(values: AnyArray, where: str) -> FloatArray:
    """Return numbers as float64.

    Parameters
    ----------
    values : (...) ndarray
        The numbers.
    where : str
        Name of the entry, for the error.

    Returns
    -------
    (...) ndarray of float
        The numbers.

    Raises
    ------
    ValueError
        If they are complex.
    """
    if np.iscomplexobj(values):
        raise ValueError(f"{where} must be real numbers, got {values.dtype}")
    return floats(values)


def plausible(values: AnyArray, where: str) -> None:
    """Refuse magnitudes that no instrument records but a wrong byte order makes.

    Parameters
    ----------
    values : (...) ndarray
        The numbers; those that are not finite are passed over.
    where : str
        Name of the entry, for the error.

    Raises
    ------
    ValueError
        If the largest magnitude is beyond 1e30, or not 0 and below 1e-30.
    """
    size = np.abs(values[np.isfinite(values)])
    largest = float(size.max(initial=0.0))
    if largest > _LARGEST or 0 < largest < _SMALLEST:
        raise ValueError(
            f"{where} must lie between {_SMALLEST:g} and {_LARGEST:g} in magnitude, "
            f"got up to {largest:g}: is the byte order wrong?"
        )

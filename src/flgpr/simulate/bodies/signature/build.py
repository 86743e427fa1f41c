"""Making tables of signatures: resumable, on several processes."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from flgpr.archive import array_bytes, npy_header
from flgpr.door import Folder
from flgpr.simulate.bodies.signature import table as nodes
from flgpr.simulate.bodies.signature.body import Body
from flgpr.simulate.bodies.signature.dipoles import solve_box
from flgpr.simulate.bodies.signature.revolution import solve_round
from flgpr.simulate.bodies.signature.table import SignatureTable

_FINE = 60e9  # cells per wavelength times frequency times refractive index
_CELLS = (8, 40)  # per wavelength, at least and at most
# dipoles at most: of an M19 6.4 mm, coarse at the top of the band and in wet soil
_BOX_CELLS = 40_000
_HALF_TURN = 10  # aspects from 0 to 45 degrees


class _Piece(NamedTuple):
    """One frequency and soil of a body."""

    soil: int
    frequency: int

    @property
    def file(self) -> str:
        """Name of its file in the work folder."""
        return "-".join(map(str, self)) + ".npy"


def build_table(
    body: Body, work: Path, workers: int = 1, progress: Callable[[int, int], None] | None = None
) -> SignatureTable:
    """Compute a body's table, going on where an earlier call stopped; a box with metal is a ValueError.

    ``work`` keeps what is done, a file per soil and tone; of another body or for other nodes it
    starts anew. ``workers`` counts processes, ``progress`` is told the number of pieces done and of
    all.
    """
    if body.shape == "box" and body.metal:
        raise ValueError(
            f"body {body.name}: a box must be without metal; only round bodies may hold it"
        )
    asked = {"body": body.model_dump(mode="json"), "nodes": nodes.table_nodes()}
    folder = work / sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:12]
    folder.mkdir(parents=True, exist_ok=True)
    shape = (nodes.PERMITTIVITY.size, nodes.FREQUENCY.size)
    pieces = [_Piece(*place) for place in np.ndindex(shape)]
    missing = [piece for piece in pieces if not (folder / piece.file).is_file()]
    done = len(pieces) - len(missing)
    for _ in _worked(body, folder, missing, workers):
        done += 1
        if progress is not None:
            progress(done, len(pieces))
    values = np.stack([_read_piece(folder, piece) for piece in pieces])
    return SignatureTable(body, values.reshape(*shape, *values.shape[1:]).astype(np.complex64))


def _read_piece(folder: Path, piece: _Piece) -> NDArray[np.complex64]:
    """Read a piece that was kept; one that holds something else is a ValueError."""
    data = Folder(folder).read(piece.file)
    shape, dtype, head = npy_header(io.BytesIO(data))
    if dtype != np.complex64 or head + array_bytes(shape, dtype) != len(data):
        raise ValueError(
            f"{folder / piece.file} must hold a piece of a table, got {shape} {dtype}: take it away"
        )
    return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))


def _worked(body: Body, folder: Path, pieces: Iterable[_Piece], workers: int) -> Iterator[None]:
    """Work on pieces, dear ones first, each kept as soon as it is there."""
    ordered = sorted(pieces, key=lambda p: -p.frequency)
    if workers == 1:
        for piece in ordered:
            _work(body, folder, piece)
            yield
        return
    with ProcessPoolExecutor(workers) as pool:
        for one in as_completed([pool.submit(_work, body, folder, piece) for piece in ordered]):
            one.result()
            yield


def _work(body: Body, folder: Path, piece: _Piece) -> None:
    """Solve a piece and write it whole."""
    with threadpool_limits(1):
        found = solve_piece(body, *piece)
    part = folder / (piece.file + ".part")
    with part.open("wb") as file:
        np.save(file, found, allow_pickle=False)
    part.rename(folder / piece.file)


def solve_piece(body: Body, soil: int, frequency: int) -> NDArray[np.complex64]:
    """Solve a body at one node of soil and tone: (depth, aspect, sine, separation, 4), m."""
    eps = nodes.PERMITTIVITY[soil] * (1 - 1j * nodes.LOSS[soil])
    f = float(nodes.FREQUENCY[frequency])
    if body.shape == "box":
        aspects = nodes.ASPECT[:_HALF_TURN] if body.elongation == 1 else nodes.ASPECT
        hh, hv, vh, vv = np.moveaxis(
            solve_box(body, f, eps, nodes.SINE, aspects, nodes.SEPARATION, most_cells=_BOX_CELLS),
            -1,
            0,
        )
        found = np.stack(
            [hh, vv, (hv + vh) / 2, (hv - vh) / 2], axis=-1
        )  # (sine, aspect, separation, 4)
        return np.moveaxis(found, 0, 1)[None].astype(np.complex64)
    found = solve_round(
        body, f, eps, nodes.SINE, nodes.SEPARATION, nodes.DEPTH, cells_for(f, eps.real)
    )
    return found[:, None].astype(np.complex64)


def cells_for(frequency: float, permittivity: float) -> float:
    """Cells per wavelength for a tone (Hz) in a soil: edges need as many in all at low tones as at high ones."""
    return float(np.clip(_FINE / (frequency * math.sqrt(permittivity)), *_CELLS))

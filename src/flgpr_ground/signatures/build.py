"""Making tables of signatures: resumable, on several processes."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from flgpr.archive import array_bytes, npy_header
from flgpr.door import Folder, open_own, refuse_links
from flgpr.jobs.workers import InProcess, Processes, Report
from flgpr.simulate.bodies.signature import table as nodes
from flgpr.simulate.bodies.signature.body import Body
from flgpr.simulate.bodies.signature.table import SignatureTable
from flgpr.types import ComplexArray
from flgpr_ground.signatures.dipoles import solve_box
from flgpr_ground.signatures.revolution import solve_round

_CELL_DENSITY = 60e9  # cells per wavelength times frequency times refractive index
_CELLS = (8, 40)  # per wavelength, at least and at most
# Dipoles at most: of an M19 6.4 mm, coarse at the top of the band and in wet soil.
_BOX_CELLS = 40_000
_EIGHTH_OF_TURN = 10  # aspects from 0 to 45 degrees


def build_table(
    body: Body, work: Path, workers: int = 1, progress: Callable[[int, int], None] | None = None
) -> SignatureTable:
    """Compute a body's table; an interrupted call resumes.

    Parameters
    ----------
    body : Body
        The body.
    work : Path
        Folder of intermediate results, a file per soil and tone; another body, or other nodes, have
        a folder of their own in it.
    workers : int
        Number of processes.
    progress : callable, optional
        Called with the number of pieces done and of all.

    Raises
    ------
    ValueError
        If the body is a box with metal, or a file of the work folder holds something else.
    """
    if body.shape == "box" and body.metal:
        raise ValueError(
            f"body {body.name}: a box must be without metal; only round bodies may hold it"
        )
    request = {"body": body.model_dump(mode="json"), "nodes": nodes.table_nodes()}
    digest = sha256(json.dumps(request, sort_keys=True).encode()).hexdigest()
    folder = work / digest[:12]
    refuse_links(folder)
    folder.mkdir(parents=True, exist_ok=True)
    shape = (nodes.PERMITTIVITY.size, nodes.FREQUENCY.size)
    files = {piece: folder / f"{piece[0]}-{piece[1]}.npy" for piece in np.ndindex(shape)}
    missing = [(body, *piece, str(file)) for piece, file in files.items() if not file.is_file()]
    missing.sort(key=lambda of_piece: -of_piece[2])  # high tones take longest
    done = len(files) - len(missing)
    with Processes(workers) if workers > 1 else InProcess() as executor:
        for _ in executor.run(_solve_and_store, missing):
            done += 1
            if progress is not None:
                progress(done, len(files))
    values = np.stack([_read_piece(file) for file in files.values()])
    return SignatureTable(body, values.reshape(*shape, *values.shape[1:]).astype(np.complex64))


def _read_piece(file: Path) -> ComplexArray:
    """Return a stored piece; a file that holds something else is a ValueError."""
    data = Folder(file.parent).read(file.name)
    shape, dtype, head = npy_header(io.BytesIO(data))
    if dtype != np.complex64 or head + array_bytes(shape, dtype) != len(data):
        raise ValueError(f"{file} must hold a piece of a table, got {shape} {dtype}: take it away")
    return np.load(io.BytesIO(data), allow_pickle=False)


def _solve_and_store(body: Body, soil: int, frequency: int, file: str) -> Report:
    """Solve a piece and store it; its file is complete as soon as it has its name."""
    with threadpool_limits(1):
        amplitudes = solve_piece(body, soil, frequency)
    incomplete = Path(f"{file}.part")
    refuse_links(incomplete, Path(file))
    with open(incomplete, "wb", opener=open_own) as stream:
        np.save(stream, amplitudes, allow_pickle=False)
    incomplete.rename(file)
    return {}


def solve_piece(body: Body, soil: int, frequency: int) -> ComplexArray:
    """Solve a body at one node of soil and tone.

    Parameters
    ----------
    body : Body
        The body.
    soil, frequency : int
        Numbers of the nodes.

    Returns
    -------
    ndarray (depth, aspect, sine, separation, 4) of complex64
        Scattering amplitudes, m, as in :class:`SignatureTable`.
    """
    eps = nodes.PERMITTIVITY[soil] * (1 - 1j * nodes.LOSS[soil])
    f = float(nodes.FREQUENCY[frequency])
    if body.shape == "box":
        # The mirror planes of a square box leave an eighth of a turn.
        aspects = nodes.ASPECT[:_EIGHTH_OF_TURN] if body.elongation == 1 else nodes.ASPECT
        matrix = solve_box(
            body, f, eps, nodes.SINE, aspects, nodes.SEPARATION, most_cells=_BOX_CELLS
        )
        hh, hv, vh, vv = np.moveaxis(matrix, -1, 0)
        amplitudes = np.stack([hh, vv, (hv + vh) / 2, (hv - vh) / 2], axis=-1)
        # From (sine, aspect, separation, 4) to the order of the table.
        return np.moveaxis(amplitudes, 0, 1)[None].astype(np.complex64)
    cells = cells_for(f, eps.real)
    amplitudes = solve_round(body, f, eps, nodes.SINE, nodes.SEPARATION, nodes.DEPTH, cells)
    return amplitudes[:, None].astype(np.complex64)


def cells_for(frequency: float, permittivity: float) -> float:
    """Return the cells per wavelength for a tone (Hz) in a soil.

    A body's edges need as many cells in all at low tones as at high ones.
    """
    cells = _CELL_DENSITY / (frequency * math.sqrt(permittivity))
    return float(np.clip(cells, *_CELLS))

"""What the compiler says of the CUDA kernels, and what follows for their speed; no device is needed.

    pip install numba-cuda nvidia-nvvm nvidia-cuda-nvrtc nvidia-cuda-runtime nvidia-cuda-nvcc
    nvidia-cuda-nvdisasm python benchmarks/cuda_kernels.py

Registers, spills and shared memory are those that ``ptxas`` reports, instructions those of the
machine code's loop over the pairs (``nvdisasm``), cache lines per load those of the benchmark's
scan (``make bench``). An update is one pixel, pair and image. The rates are bounds of
single units at the boost clock, calculated, not measured:

- issue: four instructions a clock and multiprocessor, of 32 threads each;
- fp32: 64 (A100) or 128 lanes a clock and multiprocessor;
- L1: one cache line a clock and multiprocessor. A load of 64 bits by a warp takes each half of it
  at a time
  ("halves"), or all of it at once ("whole"): which of them holds where threads share what they
  load, we do not know.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numba.cuda.dispatcher
import numpy as np
from cuda.pathfinder import find_nvidia_binary_utility
from numba import types
from numba.cuda import compile_ptx

from flgpr.imaging import ImagingOperator
from flgpr.imaging.cuda import _groups
from flgpr.kernels import gpu
from flgpr.model import SPEED_OF_LIGHT
from imaging_speed.cases import SUBBANDS, sri_scan

# name, compute capability, multiprocessors, boost clock (GHz), fp32 lanes and most threads of each
CARDS = (
    ("H100/H200 SXM", (9, 0), 132, 1.98, 128, 2048),
    ("A100", (8, 0), 108, 1.41, 64, 2048),
    ("RTX 4090", (8, 9), 128, 2.52, 128, 1536),
)

SUMS = ("FFMA", "FMUL", "FADD")


def _array(kind: Any, rank: int) -> Any:
    return types.Array(kind, rank, "C")


_C = types.complex64
_F = types.float32
_W = types.uint64
_I = types.int64
_D = types.float64
_PLACES = (_array(_W, 1), _array(_W, 1), _array(types.uint32, 1), _array(_W, 1), _I, _I, _F)
ADJOINT = (_array(_W, 1), _I, *_PLACES, _array(_F, 2), _array(_C, 2))
_SORTED = (_array(types.int32, 2), _array(types.int32, 2), _I, _I)
FORWARD = (_array(_W, 2), *_PLACES, *_SORTED, _array(_F, 2), _array(_C, 3))
_TONES = (
    _array(_C, 3),
    _array(_F, 2),
    _array(_W, 1),
    _array(_W, 1),
    _array(_F, 1),
    _array(_C, 2),
    _array(_F, 1),
)
COMPRESS = (*_TONES, _array(_C, 1), _I, _I, _array(_C, 2), _array(_C, 3))
EXPAND = (_array(_C, 3), _array(_F, 1), _array(_C, 1), _array(_C, 2))
LOCATE = (
    _array(_D, 2),
    _array(_D, 2),
    _array(_D, 1),
    _D,
    _D,
    _array(_F, 2),
    _array(types.uint32, 2),
    _array(_C, 2),
)


@dataclass(frozen=True)
class Code:
    """What a kernel became."""

    registers: int
    spilled: int  #: bytes
    shared: int  #: bytes per block
    loop: Counter[str]  #: instructions of the longest loop that holds no other, by name


def kernels(width: int, stride: int, size: int) -> dict[str, tuple[Any, tuple[Any, ...], bool]]:
    """Kernels with the types of their arguments, and whether they are compiled with fast arithmetic."""
    return {
        "interpolation, 15 channels": (
            gpu.adjoint_kernel(width, _groups(15)[0], stride),
            ADJOINT,
            True,
        ),
        "interpolation, one channel": (gpu.adjoint_kernel(width, 1, stride), ADJOINT, True),
        "range compression": (gpu.compress_kernel(size), COMPRESS, False),
        "forward, one channel": (gpu.forward_kernel(width, 1), FORWARD, True),
        "its transform": (gpu.expand_kernel(size), EXPAND, False),
        "delays and phasors": (gpu.locate, LOCATE, False),
    }


def ptx_of(kernel: Any, arguments: tuple[Any, ...], fast: bool, capability: tuple[int, int]) -> str:
    """Compile a kernel for a compute capability, with no device here."""
    device = SimpleNamespace(compute_capability=capability)
    with mock.patch.object(numba.cuda.dispatcher, "get_current_device", return_value=device):
        return str(
            compile_ptx(kernel.py_func, types.void(*arguments), cc=capability, fastmath=fast)[0]
        )


def assemble(ptx: str, capability: tuple[int, int], stem: Path) -> Code:
    """Assemble a kernel and read what the assembler and the machine code tell."""
    stem.with_suffix(".ptx").write_text(ptx)
    options = [
        "-v",
        f"-arch=sm_{capability[0]}{capability[1]}",
        f"{stem}.ptx",
        "-o",
        f"{stem}.cubin",
    ]
    told = subprocess.run(
        [_tool("ptxas"), *options], capture_output=True, text=True, check=True
    ).stderr
    code = subprocess.run(
        [_tool("nvdisasm"), "-c", f"{stem}.cubin"], capture_output=True, text=True, check=True
    ).stdout
    found = [
        re.search(text, told)
        for text in (r"(\d+) registers", r"(\d+) bytes spill stores", r"(\d+) bytes smem")
    ]
    return Code(*(int(one[1]) if one else 0 for one in found), _loop(code))


def _tool(name: str) -> str:
    path = find_nvidia_binary_utility(name)
    if path is None:
        raise SystemExit(
            f"{name} must be installed (pip install nvidia-cuda-nvcc nvidia-cuda-nvdisasm), got none"
        )
    Path(path).chmod(0o755)  # some wheels leave it without the right to run
    return str(path)


def _loop(code: str) -> Counter[str]:
    labels = {}
    names = []
    loops = []
    for line in code.splitlines():
        if label := re.match(r"\s*(\.L_\w+):", line):
            labels[label[1]] = len(names)
        elif one := re.match(r"\s*/\*[0-9a-f]+\*/\s+(?:@!?U?P\d+ )?\s*([A-Z][\w.]*)(.*?);", line):
            names.append(one[1])
            back = re.search(r"\.L_\w+", one[2])
            if one[1].startswith("BRA") and back and back[0] in labels:
                loops.append((labels[back[0]], len(names)))
    inner = [a for a in loops if not any(b != a and a[0] <= b[0] and b[1] <= a[1] for b in loops)]
    start, stop = max(inner, key=lambda a: a[1] - a[0])
    return Counter(names[start:stop])


def lines_per_load() -> tuple[ImagingOperator, float, float]:
    """Make the benchmark's operator; count the cache lines that a tap of all threads of half and whole warps takes."""
    scan = sri_scan()
    operator = ImagingOperator(scan.frequency, scan.tx, scan.rx, scan.pixels, SUBBANDS, 5e-4)
    size = operator.backend._spectrum.size
    step = scan.frequency[1] - scan.frequency[0]
    distance = [np.linalg.norm(scan.pixels - place, axis=1) for place in (*scan.tx, *scan.rx)]
    path = np.array(distance[: len(scan.tx)]) + np.array(distance[len(scan.tx) :])
    byte = 8 * np.floor(path * step / SPEED_OF_LIGHT * size).astype(np.int64)
    found = []
    for lanes in (16, 32):
        warps = byte[:, : byte.shape[1] // lanes * lanes].reshape(-1, lanes)
        counts = [
            (np.diff(np.sort((warps + 8 * tap) // 128), axis=1) > 0).sum(axis=1) + 1
            for tap in range(16)
        ]
        found.append(float(np.mean(counts)))
    return operator, found[0], found[1]


def main() -> None:
    """Compile, count and print."""
    operator, half, whole = lines_per_load()
    backend = operator.backend
    size = backend._spectrum.size
    stride = 1 << max(5, (backend._bins - 1).bit_length())
    print(
        f"window of {backend.width} taps, {size} slots, {stride} bins kept; {half:.2f} and {whole:.2f} lines per load"
    )
    with tempfile.TemporaryDirectory() as home:
        for card, capability, processors, clock, lanes, most in CARDS:
            name_of = "{}.{}".format(*capability)
            print(f"\n{card} (compute capability {name_of}, {processors} x {clock} GHz)")
            for name, (kernel, arguments, fast) in kernels(backend.width, stride, size).items():
                ptx = ptx_of(kernel, arguments, fast, capability)
                code = assemble(ptx, capability, Path(home) / "kernel")
                held = min(65536 // (-(-code.registers // 8) * 8 * gpu.THREADS) * gpu.THREADS, most)
                memory = f"{code.spilled} bytes spilled, {code.shared} shared"
                print(f"  {name}: {code.registers} registers ({held} threads held), {memory}")
                if name.startswith("interpolation"):
                    channels = 15 if "15" in name else 1
                    counts = [
                        _count(code.loop, *names) / channels for names in (("",), SUMS, ("LDG",))
                    ]
                    clocks = _clocks(code.loop, channels * backend.width, lanes, half, whole)
                    rates = {
                        unit: 32 * channels / one * processors * clock * 1e9
                        for unit, one in clocks.items()
                    }
                    print(
                        "    {:.1f} instructions an update: {:.1f} sums, {:.1f} loads".format(
                            *counts
                        )
                    )
                    print(
                        "    updates/s at most: "
                        + ", ".join(f"{unit} {rate:.2e}" for unit, rate in rates.items())
                    )


def _count(loop: Counter[str], *names: str) -> int:
    """Count the instructions whose names begin like this."""
    return sum(loop[one] for one in loop if one.startswith(names))


def _clocks(
    loop: Counter[str], taps: int, lanes: int, half: float, whole: float
) -> dict[str, float]:
    """Clocks that each unit takes at least for one turn of the loop by one warp."""
    others = _count(loop, "LDG") - taps
    return {
        "issue": loop.total() / 4,
        "fp32": _count(loop, *SUMS) * 32 / lanes,
        "L1 halves": 2 * half * taps + 2 * others,
        "L1 whole": whole * taps + others,
    }


if __name__ == "__main__":
    main()

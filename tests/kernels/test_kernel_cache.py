"""Compiled kernels are found by every copy of the same sources and give the bits of a fresh compilation."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import flgpr
from flgpr.kernels import compiled

PROGRAM = """
import hashlib
import numpy as np
from flgpr.imaging import ImagingOperator
from flgpr.kernels.focus import focus
rng = np.random.default_rng(0)
signal = (rng.normal(size=(3, 8, 48)) + 1j * rng.normal(size=(3, 8, 48))).astype(np.complex64)
path, kernel = rng.uniform(8, 20, (9, 8)), rng.normal(size=(2, 48, 61)).astype(np.float32)
out = np.empty((9, 3, 61), np.float32)
focus(signal, np.linspace(2.5, 6, 48), path, kernel, out)
ends, ground = rng.uniform(-1, 1, (2, 8, 3)) + [0, 0, 2], np.zeros((40, 30, 3))
ground[..., :2] = np.stack(np.meshgrid(np.linspace(-2, 2, 30), np.linspace(4, 9, 40)), axis=-1)
operator = ImagingOperator(np.linspace(0.8e9, 1.8e9, 48), *ends, ground, [(0.8e9, 1.8e9), (0.8e9, 1.3e9)])
images = operator.adjoint(signal)
data = operator.forward(images)
print(*(hashlib.sha256(np.ascontiguousarray(one).tobytes()).hexdigest() for one in (out, images, data)))
"""


def test_a_copy_of_the_sources_loads_what_was_compiled_and_gives_the_same_bits(tmp_path):
    package = Path(flgpr.__file__).parent
    copy = shutil.copytree(package, tmp_path / "copy" / "flgpr", ignore=shutil.ignore_patterns("static", "__pycache__"))
    told, kept = [], []
    for source in (package, copy):
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "PYTHONPATH": str(source.parent)}
        ran = subprocess.run(
            [sys.executable, "-c", PROGRAM], env=environment, text=True, check=True, capture_output=True
        )
        told.append(ran.stdout.split())
        kept.append({path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nb[ci]")})
    assert kept[0]
    assert kept[0] == kept[1], "nothing was compiled again"
    assert told[0] == told[1]
    assert len(set(told[0])) == 3


def test_what_was_compiled_is_named_by_what_the_module_and_those_behind_it_say(tmp_path):
    folders = []
    for home, inlined, other in (("here", "a = 1", ""), ("there", "a = 1", "b = 2"), ("later", "a = 2", "")):
        folder = tmp_path / home / "kernels"
        folder.mkdir(parents=True)
        (folder / "loop.py").write_text("from flgpr.kernels.between import a\n")
        (folder / "between.py").write_text("from flgpr.kernels.inlined import a\nfrom flgpr.kernels.loop import b\n")
        (folder / "inlined.py").write_text(inlined)
        (folder / "other.py").write_text(other)
        folders.append(compiled._cache_folder(folder / "loop.py"))
    assert folders[0] == folders[1] != folders[2]


def test_without_a_place_to_keep_it_a_kernel_is_compiled_all_the_same(tmp_path, monkeypatch):
    def twice(x):
        return 2 * x

    twice.__module__ = "flgpr.kernels.twice"
    (tmp_path / "file").touch()
    monkeypatch.setattr(compiled.config, "CACHE_DIR", str(tmp_path / "file" / "no-folder"))
    assert compiled._BySource.from_function(twice, str(shutil.copy(__file__, tmp_path))) is None
    monkeypatch.setattr(compiled._implementation, "_locator_classes", [])
    assert compiled.njit(cache=True)(twice)(21) == 42

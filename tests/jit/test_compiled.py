"""Compiled kernels are found by every copy of the same sources and give the bits of a fresh compilation."""

import fcntl
import importlib.util
import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import flgpr
from flgpr.jit import compiled

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


@pytest.mark.slow("compiles in processes of its own")
def test_a_copy_of_the_sources_loads_what_was_compiled_and_gives_the_same_bits(tmp_path):
    package = Path(flgpr.__file__).parent
    copy = shutil.copytree(
        package, tmp_path / "copy" / "flgpr", ignore=shutil.ignore_patterns("static", "__pycache__")
    )
    told = []
    kept = []
    for source in (package, copy):
        environment = os.environ | {
            "NUMBA_CACHE_DIR": str(tmp_path / "kernels"),
            "PYTHONPATH": str(source.parent),
        }
        ran = subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env=environment,
            text=True,
            check=True,
            capture_output=True,
        )
        told.append(ran.stdout.split())
        kept.append({path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nb[ci]")})
    assert kept[0]
    assert kept[0] == kept[1], "nothing was compiled again"
    assert told[0] == told[1]
    assert len(set(told[0])) == 3


def test_what_was_compiled_is_named_by_what_the_module_and_those_behind_it_say(tmp_path):
    folders = []
    for home, inlined, other in (
        ("here", "a = 1", ""),
        ("there", "a = 1", "b = 2"),
        ("later", "a = 2", ""),
    ):
        folder = tmp_path / home / "kernels"
        folder.mkdir(parents=True)
        (folder / "loop.py").write_text("from flgpr.kernels.between import a\n")
        (folder / "between.py").write_text(
            "from flgpr.kernels.inlined import a\nfrom flgpr.kernels.loop import b\n"
        )
        (folder / "inlined.py").write_text(inlined)
        (folder / "other.py").write_text(other)
        folders.append(compiled.cache_folder(folder / "loop.py"))
    assert folders[0] == folders[1] != folders[2]


def test_a_module_that_moved_is_compiled_anew(tmp_path):
    """Compiled code names the modules it was made of: under a former name they are not found."""
    text = "from flgpr.kernels.between import a\n"
    folders = []
    for place in ("simulate", "simulate/radar"):
        folder = tmp_path / "flgpr" / place
        folder.mkdir(parents=True)
        (folder / "loop.py").write_text(text)
        folders.append(compiled.cache_folder(folder / "loop.py"))
    assert folders[0] != folders[1]


def test_kernels_behind_a_module_of_another_room_are_part_of_its_name(tmp_path):
    folders = []
    for home, inlined in (("here", "a = 1"), ("later", "a = 2")):
        package = tmp_path / home / "flgpr"
        (package / "kernels").mkdir(parents=True)
        (package / "simulate" / "radar").mkdir(parents=True)
        (package / "kernels" / "between.py").write_text(inlined)
        module = package / "simulate" / "radar" / "loop.py"
        module.write_text("from flgpr.kernels.between import a\n")
        folders.append(compiled.cache_folder(module))
    assert folders[0] != folders[1]


def test_without_a_place_to_keep_it_a_kernel_is_compiled_all_the_same(tmp_path, monkeypatch):
    def twice(x):
        return 2 * x

    twice.__module__ = "flgpr.kernels.twice"
    (tmp_path / "file").touch()
    monkeypatch.setattr(compiled.config, "CACHE_DIR", str(tmp_path / "file" / "no-folder"))
    assert compiled._BySource.from_function(twice, str(shutil.copy(__file__, tmp_path))) is None
    monkeypatch.setattr(compiled._implementation, "_locator_classes", [])
    assert compiled.njit(cache=True)(twice)(21) == 42


def test_one_process_compiles_and_the_others_wait_but_not_for_ever(tmp_path, monkeypatch):
    path = tmp_path / "kernel.lock"
    order = []
    compile_once = compiled._once(order.append, path)
    with path.open(
        "w"
    ) as other:  # a lock belongs to an opened file, so that this stands for another process
        fcntl.flock(other, fcntl.LOCK_EX)
        waiting = threading.Thread(target=compile_once, args=("waited",))
        waiting.start()
        waiting.join(0.2)
        order.append("the other is done")
        fcntl.flock(other, fcntl.LOCK_UN)
        waiting.join()
        assert order == ["the other is done", "waited"]
        fcntl.flock(other, fcntl.LOCK_EX)
        monkeypatch.setattr(compiled, "_PATIENCE", 0.1)
        compile_once("the other was stopped")
    compiled._once(order.append, tmp_path / "no-folder" / "kernel.lock")("without a lock")
    assert order[2:] == ["the other was stopped", "without a lock"]


@pytest.mark.slow("compiles in processes of its own")
def test_kernels_are_plain_functions_where_compiling_is_switched_off(tmp_path):
    program = "from flgpr.kernels.layout import row_size as one; print(hasattr(one, 'nopython_signatures'))"
    said = subprocess.run([sys.executable, "-c", program], env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, text=True,
                          check=True, capture_output=True)  # fmt: skip
    assert said.stdout == "False\n"


def test_what_is_kept_lies_in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setattr(compiled.config, "CACHE_DIR", str(tmp_path))
    assert compiled.cache_folder.__wrapped__(Path(compiled.__file__)).parent == tmp_path / "flgpr"


def test_folders_that_nobody_used_for_long_are_removed_when_another_is_made(tmp_path):
    mine, old, recent = (tmp_path / f"{name}-{'0a' * 10}" for name in ("mine", "old", "recent"))
    foreign = tmp_path / "kernels_0123456789abcdef0123"
    (dangling := tmp_path / f"link-{'0b' * 10}").symlink_to(tmp_path / "nowhere")
    for folder in (old, recent, foreign):
        folder.mkdir()
        (folder / "code.nbc").touch()
        os.utime(folder, 2 * (time.time() - (30 if folder is recent else 90) * 86400,))
    compiled._use.__wrapped__(mine)
    assert sorted(tmp_path.iterdir()) == sorted([recent, foreign, dangling])
    compiled._use.__wrapped__(recent)
    assert time.time() - recent.stat().st_mtime < 86400, "it is in use"


@pytest.mark.slow("compiles in processes of its own")
def test_two_processes_never_write_one_file_of_code(tmp_path, monkeypatch):
    monkeypatch.setattr(compiled, "cache_folder", lambda _: tmp_path / "kernels")
    source = tmp_path / "twice.py"
    source.write_text("def twice(x):\n    return 2 * x\n")
    spec = importlib.util.spec_from_file_location("flgpr.kernels.twice", source)
    spec.loader.exec_module(module := importlib.util.module_from_spec(spec))
    kernel = compiled.njit(cache=True)(module.twice)
    for value in (3, 3.5):
        if not (
            child := os.fork()
        ):  # as workers are forked, with kernels that nothing has called yet
            os._exit(kernel(value) != 2 * value)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        (
            tmp_path / "kernels" / kernel._cache._cache_file._index_name
        ).unlink()  # neither saw the other's entry
    assert len(list((tmp_path / "kernels").glob("*.nbc"))) == 2

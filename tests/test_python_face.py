"""The face of the package: what Python users see of every verb, and what type checkers make of it."""

import inspect
import pydoc
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import flgpr

SOURCE = Path(__file__).parents[1] / "src"
WIDTH = 100
VERBS = [
    name
    for name in flgpr.__all__
    if callable(getattr(flgpr, name)) and not inspect.isclass(getattr(flgpr, name))
]


@pytest.mark.parametrize("name", VERBS)
def test_the_help_of_a_verb_fits_a_screen(name):
    shown = pydoc.plain(pydoc.render_doc(getattr(flgpr, name)))
    rows = [row for line in shown.splitlines() for row in textwrap.wrap(line, WIDTH) or [""]]
    assert len(rows) <= 40
    assert f"{name}(" in shown  # how it is called


@pytest.mark.slow("type checkers read the whole package")
def test_a_file_of_a_user_is_typed(tmp_path):
    file = tmp_path / "user.py"
    file.write_text(
        "import flgpr\n"
        "run = flgpr.open_run('run.zarr')\n"
        "result = flgpr.detect(run)\n"
        "print(result.alarms['x'], result.score('truth.csv').folder, result.view().url)\n"
        "survey = flgpr.detect(['a.zarr', 'b.zarr'], output='survey')\n"
        "print([one.alarms for one in survey], flgpr.detect(runs='a.zarr', far=0.05).alarms)\n"
        "print(flgpr.compare([result, *survey], 'truth.csv'), flgpr.train(['a'], ['b']).stages)\n"
    )
    options = ["--strict", "--follow-imports=silent", "--config-file", "", "--cache-dir", tmp_path]
    ran = subprocess.run(
        [sys.executable, "-m", "mypy", *options, file],
        capture_output=True, text=True, env={"MYPYPATH": str(SOURCE)}, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert ran.stdout.startswith("Success"), ran.stdout + ran.stderr

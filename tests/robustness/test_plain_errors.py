"""What the user can mend is one line that names file and rule: no traceback, no Python, and nothing half-written."""

import ast
import errno
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import flgpr
from every_command import COMMANDS, make_inputs
from flgpr.commands.app import app

SOURCE = Path(__file__).parents[2] / "src"
DEEP = 20_000
PYTHON = re.compile(
    r"\[Errno|\w+Error\(|\w*Path\(|\b\w+=(True|False|None)\b|\bNoneType\b|Traceback|\bnp\.\w+\("
)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    home = tmp_path_factory.mktemp("inputs")
    make_inputs(home)
    (home / "deep.toml").write_text("a = " + "[" * DEEP + "]" * DEEP + "\n")
    (home / "deep.json").write_text("[" * DEEP + "]" * DEEP)
    (home / "deep.csv").write_text("[" * DEEP + "]" * DEEP)
    (home / "folder.toml").mkdir()
    (home / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    return home


def call(words, inputs, output):
    text = words.replace("{in}", str(inputs)).replace("{out}", str(output))
    return CliRunner().invoke(app, text.split(), input="")


def is_plain(done):
    """Tell that a command ended with one plain line."""
    assert done.exit_code == 2, (done.exit_code, done.output, done.exception)
    lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1, done.stderr
    assert not PYTHON.search(lines[0]), lines[0]
    return lines[0]


READ = (
    "detect {in}/lane.zarr --recipe {in}/small.toml --lane {bad} -o {out}/a",
    "detect {in}/lane.zarr --recipe {bad} -o {out}/a",
    "train {in}/lane.zarr --truth {in}/truth.csv --recipe {in}/small.toml --lane {bad} -o {out}/a",
    "score {in}/alarms.csv --truth {in}/truth.csv --lane {bad} -o {out}/a",
    "export {in}/result --to csv --anchor {bad} -o {out}/a",
    "anchor {bad} --lane {in}/lane.toml",
    "anchor {in}/anchor.toml --lane {bad} --outline {out}/a",
    "import mapped {bad} -o {out}/a",
    "import cphd {in}/a.cphd --anchor {bad} -o {out}/a",
    "simulate {bad} -o {out}/a",
    "simulate {in}/scene.toml --sensor {bad} -o {out}/a",
    "simulate signature {bad} -o {out}/a",
    "design {bad} -o {out}/a",
    "prepare {in}/run.zarr --steps {bad} -o {out}/a",
    "recipe check {bad}",
    "plan lane {bad} {in}/sorts.csv -o {out}/a.csv",
    "live {in}/incoming --recipe {in}/small.toml --lane {bad} -o {out}/a",
    "live {in}/incoming --recipe {in}/small.toml --anchor {bad} -o {out}/a",
    "benchmark run --ground {bad} -o {out}/a",
    "benchmark list --ground {bad}",
    "benchmark make --ground {bad} -o {out}/a",
    "benchmark validate {in}/submission --ground {bad}",
    "benchmark enter {in}/submission --ground {bad} -o {out}/a",
)
TABLES = (
    "score {in}/alarms.csv --truth {bad} --lane {in}/lane.toml -o {out}/a",
    "score {bad} --truth {in}/truth.csv --lane {in}/lane.toml -o {out}/a",
    "score {in}/result --truth {in}/truth.csv --objects {bad} -o {out}/a",
    "plan lane {in}/lane.toml {bad} -o {out}/a.csv",
    "plan survey {in}/plan.csv {bad} -o {out}/a.csv",
    "anchor {bad} --crs EPSG:4326 --accuracy 1 --write {out}/a",
    "import mapped {in}/mapped.toml --track {bad} -o {out}/a",
    "import mapped {in}/mapped.toml --survey {bad} -o {out}/a",
    "calibrate range-bias {in}/posed.zarr --reflectors {bad} -o {out}/a",
    "calibrate clock {in}/rail.zarr --track {bad} --area 0 1 5 6 --offsets 0 1 -o {out}/a",
)


@pytest.mark.slow("calls many commands")
@pytest.mark.parametrize("words", READ)
@pytest.mark.parametrize("bad", ["deep.toml", "folder.toml", "bytes.toml"])
def test_a_file_of_settings_that_cannot_be_read_is_named(words, bad, inputs, tmp_path):
    line = is_plain(call(words.replace("{bad}", f"{{in}}/{bad}"), inputs, tmp_path))
    assert bad in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow("reads brackets that are nested 20,000 deep")
@pytest.mark.parametrize("words", TABLES)
def test_a_table_that_cannot_be_read_is_named(words, inputs, tmp_path):
    line = is_plain(call(words.replace("{bad}", "{in}/deep.csv"), inputs, tmp_path))
    assert "deep.csv" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow("calls many commands")
@pytest.mark.parametrize(
    "words", ["score --agreement {bad} {bad}", "view {in}/result --no-browser --verdicts {bad}"]
)
def test_a_file_of_verdicts_that_cannot_be_read_is_named(words, inputs, tmp_path):
    words = words.replace("{bad}", "{in}/deep.json", 1).replace("{bad}", "{in}/bytes.toml")
    assert "deep.json" in is_plain(call(words, inputs, tmp_path))


QUICK = [
    one for one in COMMANDS
    if one.other and one.name.startswith(("export", "recipe", "import mapped", "score a list", "anchor", "plan lane"))
]  # fmt: skip


@pytest.mark.slow("calls many commands")
@pytest.mark.parametrize(
    "command", [one for one in QUICK if "score" not in one.name], ids=lambda one: one.name
)
def test_a_name_that_is_too_long_is_refused_and_leaves_nothing(command, inputs, tmp_path):
    words = re.sub(r"\{out\}/a\b", "{out}/" + "n" * 245, command.words)
    line = is_plain(call(words, inputs, tmp_path))
    assert "names must be shorter" in line
    assert "n" * 245 in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow("calls many commands")
@pytest.mark.parametrize("command", QUICK, ids=lambda one: one.name)
@pytest.mark.parametrize(
    ("number", "rule"),
    [
        (errno.ENOSPC, "must have room"),
        (errno.EROFS, "must not be read-only"),
        (errno.EACCES, "must be allowed"),
        (errno.EIO, "the disk must work"),
    ],
)
def test_a_disk_that_cannot_be_written_is_told(
    command, number, rule, inputs, tmp_path, monkeypatch
):
    """Root may write where others may not, so that what the system would say is put in its mouth."""
    output = str(tmp_path)
    real = os.mkdir
    real_open = os.open

    def refuse(path):
        raise OSError(number, os.strerror(number), str(path))

    def mkdir(path, *rest, **more):
        return refuse(path) if str(path).startswith(output) else real(path, *rest, **more)

    def open_(path, flags, *rest, **more):
        writes = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        return (
            refuse(path)
            if writes and str(path).startswith(output)
            else real_open(path, flags, *rest, **more)
        )

    monkeypatch.setattr(os, "mkdir", mkdir)
    monkeypatch.setattr(os, "open", open_)
    line = is_plain(call(command.words, inputs, tmp_path))
    assert rule in line
    assert str(tmp_path) in line
    assert list(tmp_path.iterdir()) == []


SMALL_DISK = """
import resource, sys
from flgpr.commands.app import app
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
app(sys.argv[2:])
"""


@pytest.mark.slow("runs in processes of its own")
@pytest.mark.parametrize("name", ["export qgis", "export gpkg", "export geotiff", "import mapped"])
def test_a_file_that_may_not_grow_so_large_is_told_and_nothing_is_left(name, inputs, tmp_path):
    command = next(one for one in COMMANDS if one.name == name)
    words = command.words.replace("{in}", str(inputs)).replace("{out}", str(tmp_path)).split()
    limit = str(2**9)
    done = subprocess.run(  # a limit of its own
        [sys.executable, "-c", SMALL_DISK, limit, *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1, done.stderr
    assert not PYTHON.search(done.stderr), done.stderr
    goes_on = {"a.zarr.partial", "a-track.csv"}  # of an import
    assert {path.name for path in tmp_path.iterdir()} <= goes_on


RAISED = ("warn", "log_note", "log_finished", "output_exists_error", "ValueError")
SPOKEN = (*RAISED, "echo", "Option", "Argument")


def messages(tree, names=SPOKEN):
    """Give every text in what is raised, printed, warned of or told as help."""
    for node in ast.walk(tree):
        name = ""
        if isinstance(node, ast.Call):
            name = (
                node.func.attr
                if isinstance(node.func, ast.Attribute)
                else getattr(node.func, "id", "")
            )
        if isinstance(node, ast.Raise) or name in names or name.endswith("Error"):
            for part in ast.walk(node):
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    yield part.lineno, part.value


@pytest.mark.slow("makes every message")
def test_messages_are_free_of_python():
    words = re.compile(
        r"\b[a-z_]+=(True|False|None)\b|\bNone\b|\w+Error\b|Path\(|\[Errno|\bkwargs?\b|\bself\."
    )
    bad = [
        f"{path.relative_to(SOURCE)}:{line}: {text}"
        for path in sorted(SOURCE.rglob("*.py"))
        for line, text in messages(ast.parse(path.read_text(encoding="utf-8")))
        if words.search(text)
    ]
    assert bad == []


OF_THE_SHELL = re.compile(rf"(?<![\w-])--[a-z]|\bflgpr (?:{'|'.join(flgpr.__all__)})\b")
"""Options, and commands that have a verb in Python: a message has `name` and `flgpr.verb` for them."""
ONLY_IN_THE_SHELL = {
    "flgpr/commands/design.py": "--json, of which Python has no twin: it is checked before the function is called",
    "flgpr/commands/live.py": "--view and --no-browser, of which Python has no twins: a page is the shell's",
}


@pytest.mark.slow("reads every message")
def test_messages_advise_python_and_the_shell_alike():
    bad = {
        path.relative_to(SOURCE).as_posix(): text
        for path in sorted(SOURCE.rglob("*.py"))
        for _, text in messages(ast.parse(path.read_text(encoding="utf-8")), RAISED)
        if OF_THE_SHELL.search(text)
    }
    assert bad.keys() == ONLY_IN_THE_SHELL.keys(), bad

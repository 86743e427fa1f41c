"""How two checkouts are timed side by side: medians, turns, and whether they write the same."""

import importlib.util
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "old_and_new.py"
PROGRAM = """import sys
from pathlib import Path

words = sys.argv[1:]
if words[0] == "fail":
    sys.exit(2)
output = Path(words[words.index("-o") + 1])
output.mkdir()
(output / "alarms.csv").write_text("{alarms}")
(output / "manifest.json").write_text("{version}")
"""


@pytest.fixture(scope="module")
def speed():
    spec = importlib.util.spec_from_file_location("old_and_new", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where its data classes look for themselves
    spec.loader.exec_module(module)
    return module


def checkout(folder, alarms, version):
    """Make a checkout whose program writes alarms and a version."""
    package = folder / "src" / "flgpr"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "__main__.py").write_text(PROGRAM.format(alarms=alarms, version=version))
    return folder


def test_ratios_are_new_to_old_and_medians_of_rounds(speed):
    found = speed.compare([1.0, 2.0, 4.0], [1.1, 2.2, 3.0])
    assert (found.old, found.new) == (2.0, 2.2)
    assert found.ratio == pytest.approx(1.1)
    assert (found.least, found.largest) == (0.75, pytest.approx(1.1))
    with pytest.raises(ValueError, match="zip"):
        speed.compare([1.0], [1.0, 2.0])


def test_each_side_begins_every_other_round(speed):
    assert [speed.order_of(number)[0] for number in range(4)] == ["old", "new", "old", "new"]
    assert all(sorted(speed.order_of(number)) == ["new", "old"] for number in range(4))


@pytest.mark.parametrize(
    ("alarms", "differing"), [("the same", []), ("others", ["made/alarms.csv"])]
)
def test_what_both_sides_write_is_compared_but_for_versions(speed, alarms, differing, tmp_path):
    sides = {
        "old": checkout(tmp_path / "old", "the same", 1),
        "new": checkout(tmp_path / "new", alarms, 2),
    }
    seconds, differ = speed.measure(["detect", "-o", speed.OUTPUT], sides, tmp_path, rounds=2)
    assert differ == differing
    assert [len(seconds[side]) for side in ("old", "new")] == [2, 2]
    assert not (tmp_path / "output").exists()


def test_a_command_that_fails_ends_all(speed, tmp_path):
    with pytest.raises(SystemExit, match="flgpr fail failed"):
        speed.run(checkout(tmp_path / "old", "", 1), ["fail"])

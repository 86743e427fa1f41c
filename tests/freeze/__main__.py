"""Write frozen tables anew: results, files, commands, calls and names, or those parts that are named.

Usage, in the root of the repository::

    PYTHONPATH=src:tests python -m freeze [recipes] [formats] [commands] [calls] [names]
    PYTHONPATH=src:tests python -m freeze machine

What is written anew is a change that must be meant: read the difference before it is committed. The
first form drops the digests of other machines, whose results may have changed as well. ``machine``
adds the digests of this machine and leaves all tables as they are; it refuses if the results are
not those of the tables.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

import pandas as pd
import pytest

from freeze import calls, commands, formats, frozen, names, recipes
from freeze.lanes import make_lanes


def write_recipes(check: bool) -> None:
    """Run every recipe; write its tables, or compare them, and keep its digests."""
    digests = {}
    put = frozen.check_table if check else lambda table, path: frozen.write_table(path, table)
    with tempfile.TemporaryDirectory() as home:
        lanes = Path(home)
        make_lanes(lanes)
        for name in recipes.RECIPES:
            case = recipes.Case(name, lanes)
            case.folder.mkdir()
            case.train()
            folder = case.detect("result")
            for table, values in recipes.result_tables(folder).items():
                put(values, recipes.frozen_table(name, table))
            digests[name] = recipes.result_digests(folder)
            folder = case.detect("sections", "--section", recipes.SECTION[name])
            digests[f"{name} in sections"] = recipes.section_digests(folder)
            if name in recipes.CAUSAL:
                recipes.flgpr(*case.live("live"))
                table = pd.read_csv(case.folder / "live" / "alarms.csv")
                put(table, recipes.frozen_table(name, "live"))
                digests[f"{name} live"] = recipes.live_digests(case.folder / "live")
    frozen.write_digests(digests, others=check)


def write_formats() -> None:
    """Write files of every format, and the table of what is in them."""
    # Manifests hold where a run lay: a place that every Linux has says nothing about this machine.
    with tempfile.TemporaryDirectory(dir="/dev/shm", prefix="lane-") as home:
        formats.make_formats(Path(home))
        files = formats.file_table(Path(home))
        formats.copy_formats(Path(home), formats.FILES)
    table = {"files": files, "values": formats.values(formats.FILES)}
    frozen.write_json(formats.TABLE, table)


def write_commands() -> None:
    """Write the tables of the command line."""
    with tempfile.TemporaryDirectory() as home:
        frozen.write_json(commands.TABLE, commands.command_table(Path(home)))
    with tempfile.TemporaryDirectory() as home:
        inputs = Path(home) / "inputs"
        inputs.mkdir()
        commands.make_inputs(inputs)
        keys = {}
        for name in commands.PRINTED:
            output = Path(home) / "out"
            output.mkdir()
            keys[name] = commands.printed(name, inputs, output)
            shutil.rmtree(output)
        frozen.write_json(commands.KEYS, keys)


def write_calls() -> None:
    """Write the table of one call of every command."""
    table = {}
    with tempfile.TemporaryDirectory() as home:
        inputs = Path(home) / "inputs"
        inputs.mkdir()
        calls.make_inputs(inputs)
        for name in calls.CALLS:
            output = Path(home) / "out"
            with pytest.MonkeyPatch.context() as patch:
                table[name] = calls.call(name, inputs, output, patch.setattr)
            shutil.rmtree(output)
    frozen.write_json(calls.TABLE, calls.call_table(table))


def write_names() -> None:
    """Write the tables of public names and of what a user may set."""
    frozen.write_json(names.TABLE, names.name_table())
    frozen.write_json(names.SETTINGS, names.settings())
    frozen.write_json(names.RECIPES, names.packaged_recipes())


PARTS = {
    "recipes": lambda: write_recipes(check=False),
    "formats": write_formats,
    "commands": write_commands,
    "calls": write_calls,
    "names": write_names,
}


def main() -> None:
    """Write the parts that are asked for."""
    parser = argparse.ArgumentParser(prog="python -m freeze", description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", choices=[*PARTS, "machine", []])
    wanted = parser.parse_args().parts
    if "machine" in wanted:
        write_recipes(check=True)
        return
    for part in wanted or PARTS:
        PARTS[part]()


if __name__ == "__main__":
    main()

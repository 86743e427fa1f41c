"""Files of a release: what they name exists."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
GITHUB = sorted([*(ROOT / ".github").rglob("*.yml"), ROOT / "CITATION.cff"])


@pytest.mark.parametrize("file", GITHUB, ids=lambda file: file.name)
def test_yaml_files_are_valid(file):
    assert isinstance(yaml.safe_load(file.read_text(encoding="utf-8")), dict)


WORKFLOW = yaml.safe_load((ROOT / ".github" / "workflows" / "test.yml").read_text())
MAKEFILE = (ROOT / "Makefile").read_text()


def steps():
    for job in WORKFLOW["jobs"].values():
        for step in job["steps"]:
            yield step.get("run", "")


def test_workflows_run_the_checks_that_contributors_run():
    commands = "\n".join(steps())
    assert ".ci/run" in commands
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o100
    assert "flgpr demo" in commands
    ci = (ROOT / ".ci" / "run").read_text()
    targets = re.findall(r"^(?:- run: )?make ([a-z-]+)", f"{commands}\n{ci}", re.MULTILINE)
    assert {"test", "docs", "wheel-check"} <= set(targets)
    for target in targets:
        assert re.search(rf"^{target}:", MAKEFILE, re.MULTILINE), target


def test_the_oldest_and_newest_versions_are_tried_on_the_oldest_and_newest_python():
    versions = WORKFLOW["jobs"]["versions"]
    assert any("make ${{ matrix.target }}" in step.get("run", "") for step in versions["steps"])
    tried = {}
    for environment in versions["strategy"]["matrix"]["include"]:
        assert re.search(rf"^{environment['target']}:", MAKEFILE, re.MULTILINE)
        tried[environment["target"]] = environment["python"]
    pythons = WORKFLOW["jobs"]["demo"]["strategy"]["matrix"]["python"]
    assert tried == {"oldest": pythons[0], "newest": pythons[-1]}
    assert f"OLDEST_PYTHON ?= python{pythons[0]}" in MAKEFILE


def test_the_tests_that_make_names_exist():
    for name in ("QUICK", "SLOW", "ROBUSTNESS", "VERSIONS", "NOT_VERSIONS"):
        (value,) = re.findall(rf"^{name} := ((?:.*\\\n)*.*)$", MAKEFILE, re.MULTILINE)
        (prefix, listed) = ("commands/test_", r"\$\(addprefix commands/test_,([^)]*)\)")
        files = [prefix + file for group in re.findall(listed, value) for file in group.split()]
        files += re.sub(listed, "", value).replace("\\\n", " ").split()
        assert files
        for file in files:
            assert (ROOT / "tests" / file).exists(), file


def test_every_dependency_states_its_oldest_version():
    listed = [*PROJECT["dependencies"]]
    for extra in PROJECT["optional-dependencies"].values():
        listed.extend(extra)
    assert [line for line in listed if ">=" not in line and not line.startswith("flgpr[")] == []


def test_versions_of_python_are_the_same_everywhere():
    tried = WORKFLOW["jobs"]["demo"]["strategy"]["matrix"]["python"]
    stated = [
        line.rpartition(" ")[2]
        for line in PROJECT["classifiers"]
        if re.fullmatch(r"Programming Language :: Python :: 3\.\d+", line)
    ]
    assert tried == stated
    assert PROJECT["requires-python"] == f">={stated[0]}"


def test_the_image_installs_extras_and_copies_files_that_exist():
    text = (ROOT / "Dockerfile").read_text()
    (extras,) = re.findall(r"'\.\[([a-z,]+)\]'", text)
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    for line in re.findall(r"^COPY (.+)$", text, re.MULTILINE):
        *sources, _ = line.split()
        assert all((ROOT / source).exists() for source in sources), line
    (module,) = re.findall(r"python -m (flgpr[\w.]+)", text)
    assert (ROOT / "src" / Path(*module.split("."))).with_suffix(".py").is_file()


def test_the_source_distribution_takes_what_exists():
    for line in (ROOT / "MANIFEST.in").read_text().splitlines():
        verb, *names = line.split()
        if verb in ("include", "graft"):
            assert all((ROOT / name).exists() for name in names), line

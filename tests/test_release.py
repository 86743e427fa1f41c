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


def steps():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "test.yml").read_text())
    for job in workflow["jobs"].values():
        for step in job["steps"]:
            yield step.get("run", "")


def test_workflows_run_the_checks_that_contributors_run():
    commands = "\n".join(steps())
    assert ".ci/run" in commands
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o100
    assert "flgpr demo" in commands


def test_versions_of_python_are_the_same_everywhere():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "test.yml").read_text())
    tried = workflow["jobs"]["demo"]["strategy"]["matrix"]["python"]
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

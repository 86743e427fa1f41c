"""Files of a release: what they name exists."""

import ast
import importlib.util
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
GITHUB = sorted([*(ROOT / ".github").rglob("*.yml"), ROOT / "CITATION.cff"])


@pytest.mark.parametrize("file", GITHUB, ids=lambda file: file.name)
def test_yaml_files_are_valid(file):
    assert isinstance(yaml.safe_load(file.read_text(encoding="utf-8")), dict)


def workflow(name):
    return yaml.safe_load((ROOT / ".github" / "workflows" / f"{name}.yml").read_text())


def commands_of(name):
    """Return what the steps of a workflow run, a line each."""
    commands = []
    for job in workflow(name)["jobs"].values():
        for step in job.get("steps", []):
            commands.append(step.get("run", ""))
    return "\n".join(commands)


WORKFLOW = workflow("test")
MAKEFILE = (ROOT / "Makefile").read_text()


def test_workflows_run_the_checks_that_contributors_run():
    commands = commands_of("test")
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
    for name in ("QUICK", "ROBUSTNESS", "VERSIONS", "NOT_VERSIONS"):
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


def imported_modules():
    """Return the first names of all modules of others that the packages import anywhere."""
    modules = set()
    for file in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                modules |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                modules.add(node.module.partition(".")[0])
    return (
        modules
        - {"flgpr", "flgpr_papers", "flgpr_exchange", "flgpr_trials"}
        - set(sys.stdlib_module_names)
    )


def plain(name):
    """Return the name of a distribution in the form in which names are compared."""
    return re.sub(r"[-_.]+", "-", name).lower()


def required(requirements):
    return {plain(re.match(r"[\w.-]+", requirement)[0]) for requirement in requirements}


# Parts of a library that is stated itself, which it exchanges with its users.
PARTS = {"llvmlite": "numba", "markupsafe": "jinja2"}


@pytest.mark.slow("imports every package of the core")
def test_the_core_depends_on_what_it_imports_and_on_nothing_else():
    core = required(PROJECT["dependencies"])
    extras = set()
    for requirements in PROJECT["optional-dependencies"].values():
        extras |= required(requirements)
    distributions = packages_distributions()
    imported = set()
    for module in imported_modules():
        names = {plain(name) for name in distributions.get(module, [module])}
        imported |= {PARTS.get(name, name) for name in names}
    assert core - imported == set()
    assert imported - core - extras == set()


def test_versions_that_are_tested_are_versions_that_are_allowed():
    pinned = {}
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        name, _, version = line.partition("==")
        pinned[plain(name)] = version
    assert required(PROJECT["dependencies"]) <= pinned.keys()
    for requirement in PROJECT["dependencies"]:
        name, _, oldest = requirement.partition(">=")
        assert numbers(pinned[plain(name)]) >= numbers(oldest), requirement


def numbers(version):
    return [int(part) for part in re.findall(r"\d+", version)]


def script(name):
    """A script of .ci, as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_library_is_newer_if_its_version_is_not_the_one_that_is_tested():
    module = script("newer")
    versions = {"typing-extensions": "4.16.0", "numpy": "2.4.6", "torch": "9.9"}
    module.version = versions.__getitem__
    needed = ["typing-extensions>=4.12", "numpy>=2.1", 'torch>=2.5; extra == "network"']
    assert list(module.newer(needed, "numpy==2.4.6\ntyping_extensions==4.16.0\n")) == []
    assert list(module.newer(needed, "numpy==2.4.5\ntyping_extensions==4.16.0\n")) == [
        "numpy==2.4.6"
    ]
    assert list(module.newer(needed, "")) == ["typing-extensions==4.16.0", "numpy==2.4.6"]


@pytest.fixture(scope="module")
def release():
    """The script of a release, as a module."""
    return script("release")


CHANGELOG = """# Changelog

## 0.2.0 (2027-01-31)

- First entry, which
  goes on in `a line`.
- Second entry.

## 0.1.0 (unreleased)

- Older.
"""


@pytest.fixture
def tree(tmp_path):
    """A folder with what a release is made of, at version 0.2.0."""
    (tmp_path / "pyproject.toml").write_text('[project]\nversion = "0.2.0"\n')
    (tmp_path / "CITATION.cff").write_text("cff-version: 1.2.0\nversion: 0.2.0\n")
    (tmp_path / "CHANGELOG.md").write_text(CHANGELOG)
    return tmp_path


def test_release_notes_are_the_section_of_the_version(release, tree):
    notes = "- First entry, which goes on in `a line`.\n- Second entry."
    assert release.release_notes(tree, "v0.2.0") == notes
    assert release.release_notes(tree, "0.2.0") == notes


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("pyproject.toml", "0.2.0", "0.3.0", r"pyproject\.toml must be that of the tag v0\.2\.0"),
        ("CITATION.cff", "0.2.0", "0.1.0", r"CITATION\.cff must be that of the tag v0\.2\.0"),
        ("CHANGELOG.md", "## 0.2.0", "## 0.2.1", r"a section for 0\.2\.0, got 0\.2\.1, 0\.1\.0"),
        ("CHANGELOG.md", "(2027-01-31)", "(unreleased)", "must have its date, got '.unreleased.'"),
    ],
    ids=["version", "citation", "section", "date"],
)
def test_a_tag_that_does_not_fit_the_tree_is_refused(release, tree, file, old, new, words):
    path = tree / file
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=words):
        release.release_notes(tree, "v0.2.0")


def test_this_tree_has_a_section_for_its_version():
    """It gets its date when it is released."""
    heading = f"## {PROJECT['version']} ("
    assert heading in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_links_of_the_readme_lead_into_the_repository(release):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    text = release.absolute_links(readme, "https://example.org/radar/flgpr", "v0.2.0")
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    assert len(links) == len(re.findall(r"\]\([^)\s]+\)", readme)) > 20
    shown = 0
    for link in links:
        place = re.fullmatch(
            r"https://example\.org/radar/flgpr/(raw|blob)/v0\.2\.0/([^#]+)(#.*)?", link
        )
        assert place, link
        assert (ROOT / place[2]).exists(), link
        shown += place[1] == "raw"
    assert shown == len(re.findall(r"!\[", readme))
    assert release.absolute_links(text, "https://example.org/other", "v1") == text


def test_a_release_is_checked_and_has_its_bill_of_materials():
    jobs = workflow("release")["jobs"]
    checks = jobs["checks"]["uses"]
    assert (ROOT / checks).is_file()
    assert "workflow_call" in workflow("test")[True]  # YAML reads "on" as true
    assert jobs["release"]["needs"] == "checks"
    commands = commands_of("release")
    for command in (".ci/release.py notes", ".ci/release.py links", "python -m build", "make sbom"):
        assert command in commands
    assert commands.index("release.py links") < commands.index("python -m build")
    makefile = (ROOT / "Makefile").read_text()
    [written] = re.findall(r"--output-file (dist/\S+)", makefile)
    assert written.endswith(".cdx.json")  # beside wheel and sdist, all of which are attached
    assert "dist/*" in commands


def test_nothing_of_a_release_needs_credentials_of_ones_own():
    for file in (ROOT / ".github" / "workflows").iterdir():
        assert "secrets." not in file.read_text(encoding="utf-8"), file.name


def test_the_page_of_the_installation_lists_every_extra():
    page = (ROOT / "docs" / "guide" / "install.md").read_text(encoding="utf-8")
    table = page.partition("| extra | for what |")[2].partition("\n\n")[0]
    listed = re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)
    assert sorted(listed) == sorted(PROJECT["optional-dependencies"])

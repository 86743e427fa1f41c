"""A symbolic link at a name that a command takes: what it leads to stays, to the byte, and the command is refused."""

import os

import pytest

from every_command import COMMANDS, make_cheap, make_inputs
from robust import digests

BESIDE = (
    "{}",
    "{}.partial",
    ".partial-{}",
    ".replaced-by-{}",
    "{}.work",
    "{}.work.done",
    "{}.sections",
)
"""Names that writers take at and beside an output."""
MUST_REFUSE = {
    "import fullwave": ("a.zarr", "a.zarr.partial"),
    "import gprmax": ("a.zarr", "a.zarr.partial"),
    "import mapped": ("a.zarr", "a.zarr.partial"),
    "import cphd": ("a.zarr", "a.zarr.partial"),
    "import gpr": ("a.zarr", "a.zarr.partial"),
    "import gpr survey": ("a.zarr", "a.zarr.partial"),
    "simulate": ("a.zarr", "a.zarr.partial", "key.csv", ".partial-key.csv"),
    "simulate gprmax": ("decks", ".partial-decks"),
    "simulate signature": ("a.npz", "a.npz.work", ".partial-a.npz"),
    "prepare": ("a.zarr", "a.zarr.partial"),
    "calibrate clock": ("a.zarr", "a.zarr.partial"),
    "calibrate range-bias": ("a.zarr", "a.zarr.partial"),
    "calibrate joint": ("a.zarr", "a.zarr.partial"),
    "calibrate poses": ("a.zarr", "a.zarr.partial"),
    "detect": ("result", "result.work", ".partial-result"),
    "detect in sections": ("result", "result.work", "result.sections"),
    "train": ("model", ".partial-model"),
    "demo": ("result", ".partial-result"),
    "score a list": ("score",),
    "score --seal": ("sealed", ".partial-sealed"),
    "export sigmf": ("a", ".partial-a"),
    "live": ("live",),
}
"""Names at which a link must end a command with an error: all that it takes at once."""
WHERE_IT_WRITES = ("benchmark", "reproduce", "feed", "detect a survey")
"""Commands whose output is a folder that they write in and keep: it may be a link, as any folder on the way."""
SLOW = ("demo", "design", "reproduce", "reproduce worlds", "reproduce reasons", "simulate gprmax")
"""What ``make robustness`` tries alone."""
TRIED = [one.name for one in COMMANDS if one.name not in SLOW or "FLGPR_KILLS" in os.environ]


@pytest.fixture(scope="module")
def commands(tmp_path_factory):
    return make_inputs(tmp_path_factory.mktemp("inputs"))


def outputs_of(command):
    """Names that the words of a command give to its outputs, none of what it works on in place."""
    words = [word.removeprefix("{out}/") for word in command.words.split() if "{out}/" in word]
    return [word for word in words if word not in command.beside]


def make_precious(home):
    """Make a folder that a command would take for its own unfinished work, if it followed a link to it."""
    folder = home / "precious"
    (folder / "signal").mkdir(parents=True)
    for name in (
        "thesis.txt",
        "a.partial",
        "b.arrays",
        "signal/c",
        "job.json",
        "journal.jsonl",
        "manifest.json",
    ):
        (folder / name).write_text("years of work, without an end of line")
    return folder


def refused_names(command):
    return MUST_REFUSE.get(command.name, ())


def is_own_folder(link_name, command):
    return link_name in outputs_of(command) and command.name.startswith(WHERE_IT_WRITES)


def run_with_links(command, link_names, lead, home):
    """Run a command with links to a precious folder, or to a file in it; return what came, and the last link."""
    precious = make_precious(home)
    before = digests(precious)
    command.start(home / "out")
    links = [home / "out" / link_name for link_name in link_names]
    for link in links:
        link.symlink_to(precious / lead)
    done = command.run(home / "out")
    found = digests(precious)
    if not lead and any(is_own_folder(link_name, command) for link_name in link_names):
        found = {one: found[one] for one in before}
    assert found == before, (link_names, lead, done.output)
    for link in links:
        assert link.is_symlink(), (link, lead, done.output)
    return done, links[-1] if links else None


@pytest.mark.slow("runs every command with links")
@pytest.mark.parametrize("name", TRIED)
def test_what_a_link_leads_to_stays(name, commands, tmp_path, monkeypatch):
    command = commands[name]
    make_cheap(command, monkeypatch.setattr)
    taken = {form.format(output) for output in outputs_of(command) for form in BESIDE}
    assert set(refused_names(command)) <= taken
    alone = {*outputs_of(command), *refused_names(command)}
    refusals = []
    for number, lead in enumerate(("", "thesis.txt", "missing")):
        # Links that a command may run in spite of stand there together; those that it is refused for are tried alone.
        together, each = taken - alone, set(alone)
        while together:
            home = tmp_path / f"{number}-{len(together)}"
            done, _ = run_with_links(command, sorted(together), lead, home)
            if done.exit_code == 0:
                break
            named = {one for one in together if f"{home / 'out' / one} " in done.stderr} or together
            together, each = together - named, each | named
        for link_name in sorted(each):
            done, link = run_with_links(
                command, [link_name], lead, tmp_path / f"{number}-{link_name}"
            )
            if link_name in refused_names(command):
                refusals.append((done, link))
    for done, link in refusals:
        assert_plainly_refused(done, link)


def assert_plainly_refused(done, link):
    """Assert that a command ended with one plain line that names the link."""
    assert done.exit_code == 2, (done.output, done.exception)
    assert done.stderr.count("error: ") == 1, done.stderr
    line = done.stderr.partition("error: ")[2]
    assert line.count("\n") == 1, done.stderr
    assert line.startswith(f"{link} must not be a symbolic link, got one to "), line
    assert "remove the link or name another output" in line
    assert "Traceback" not in done.output

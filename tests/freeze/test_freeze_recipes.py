"""Every packaged recipe finds what it found, to the byte where the machine is known.

It does so in one piece and in sections, interrupted or killed and resumed, by one worker or by two,
and live.
"""

import os

import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.recipe.schema import load_recipe, recipe_names
from freeze.frozen import check_table, machine, machine_key, read_digests
from freeze.lanes import make_lanes
from freeze.recipes import (
    CAUSAL,
    KILLED,
    RECIPES,
    SECTION,
    Case,
    events,
    flgpr,
    frozen_table,
    killed,
    live_digests,
    result_digests,
    result_tables,
    section_digests,
)

INTERRUPTED = 130
KILLED_BY_SIGNAL = -9


@pytest.fixture(scope="module")
def lanes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("frozen-lanes")
    make_lanes(folder)
    return folder


@pytest.fixture(scope="module", params=RECIPES)
def case(request, lanes):
    """A recipe, trained and run on the test lane in one piece by one process."""
    case = Case(request.param, lanes)
    case.folder.mkdir()
    case.train()
    case.detect("result")
    return case


@pytest.fixture(scope="module")
def causal(case):
    """A recipe that runs live, after a live run that nothing disturbed."""
    flgpr(*case.live("live"))
    return case


def check_digests(name, digests):
    """Compare digests with those of this machine; on another one the tables alone can be."""
    known = read_digests()
    if machine_key() not in known:
        pytest.skip(f"digests are of other machines than this one: {machine()}")
    assert digests == known[machine_key()]["digests"][name], name


def test_these_are_the_packaged_recipes():
    assert sorted(recipe_names()) == RECIPES
    live = [name for name in RECIPES if not load_recipe(name).not_live_because()]
    # That of the demo has no detector; what it finds live is that of its run-view.
    assert sorted(live) == sorted([*CAUSAL, "demo-mean-self-signature"])


def test_digests_of_every_packaged_recipe_are_kept_of_every_machine():
    names = recipe_names()
    kept = [
        *names,
        *(f"{name} in sections" for name in names),
        *(f"{name} live" for name in CAUSAL),
    ]
    assert read_digests()
    for known in read_digests().values():
        assert sorted(known["digests"]) == sorted(kept)


def test_it_finds_what_it_found(case):
    for table, values in result_tables(case.folder / "result").items():
        check_table(values, frozen_table(case.name, table))


def test_its_numbers_are_the_same_to_the_byte(case):
    check_digests(case.name, result_digests(case.folder / "result"))


@pytest.mark.slow("interrupted and begins again for every recipe")
def test_interrupted_and_resumed_it_gives_the_same_bytes(case, monkeypatch):
    words = case.detection("resumed")
    replace = os.replace
    parts = []

    def interrupt(source, target, **options):
        if os.fspath(target).endswith(".arrays"):
            parts.append(target)
            if len(parts) == 3:
                raise KeyboardInterrupt
        replace(source, target, **options)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", interrupt)
        assert CliRunner().invoke(app, words).exit_code == INTERRUPTED
    assert not (case.folder / "resumed").exists()
    assert list((case.folder / "resumed.work").glob("*.arrays"))
    flgpr(*words)
    assert result_digests(case.folder / "resumed") == result_digests(case.folder / "result")


@pytest.mark.slow("is killed, and begins again, several times")
@pytest.mark.parametrize("case", KILLED, indirect=True)
def test_killed_and_resumed_by_two_workers_it_gives_the_same_bytes(case):
    words = case.detection("killed")
    assert killed(words, ".arrays", 2) == KILLED_BY_SIGNAL
    assert not (case.folder / "killed").exists()
    assert list((case.folder / "killed.work").glob("*.arrays"))
    flgpr(*words, "--workers", 2)
    assert result_digests(case.folder / "killed") == result_digests(case.folder / "result")


@pytest.mark.slow("runs every recipe again in sections")
def test_sections_find_what_they_found(case):
    folder = case.detect("sections", "--section", SECTION[case.name])
    assert len(list(folder.glob("section-*"))) > 1
    found = _by_place(folder / "alarms.csv")
    in_one_piece = _by_place(case.folder / "result" / "alarms.csv")
    pd.testing.assert_frame_equal(found, in_one_piece, rtol=1e-5, atol=1e-5, check_dtype=False)
    check_digests(f"{case.name} in sections", section_digests(folder))


def _by_place(path):
    alarms = pd.read_csv(path).drop(columns="alarm_id")
    return alarms.sort_values(["y", "x"], ignore_index=True)


@pytest.mark.parametrize("case", CAUSAL, indirect=True)
def test_live_it_finds_what_it_found(causal):
    table = pd.read_csv(causal.folder / "live" / "alarms.csv")
    check_table(table, frozen_table(causal.name, "live"))
    check_digests(f"{causal.name} live", live_digests(causal.folder / "live"))


@pytest.mark.slow("is killed, and begins again, several times")
@pytest.mark.parametrize("case", CAUSAL[:1], indirect=True)
def test_live_killed_and_resumed_it_finds_the_same(causal):
    words = causal.live("live-resumed", "--snapshot", 2)
    # The first and the last snapshot are always written; on a busy machine others may be skipped.
    assert killed(words, "snapshot.bundle", 2) == KILLED_BY_SIGNAL
    flgpr(*words)
    resumed = causal.folder / "live-resumed"
    assert any(one["event"] == "resume" for one in events(resumed))
    uninterrupted = causal.folder / "live" / "alarms.csv"
    assert (resumed / "alarms.csv").read_bytes() == uninterrupted.read_bytes()

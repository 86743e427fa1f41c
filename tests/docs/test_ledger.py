"""Every feature has a row in the ledger, and says whom it serves."""

import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "evidence"))

from make_ledger import DECLARED, Feature, features, fill_in_own, kept_seconds  # noqa: E402


@pytest.fixture(scope="module")
def declared():
    return tomllib.loads(DECLARED.read_text(encoding="utf-8"))


def test_every_feature_says_whom_it_serves_and_no_other_is_listed(declared):
    rows = features(declared)
    assert [f"{row.kind} {row.name}" for row in rows if not row.user] == []
    named = {(row.kind, row.name) for row in rows}
    listed = set()
    for kind in ("command", "stage", "format", "export", "estimators", "extra"):
        listed |= {(kind, name) for name in declared[kind]}
    assert listed == named


def test_the_page_has_a_row_for_every_feature(declared):
    assert set(kept_seconds()) == {(row.kind, row.name) for row in features(declared)}


def test_a_module_belongs_to_a_feature_that_alone_needs_it():
    uses = {"a": {"x", "y"}, "b": {"y"}, "x": {"z"}, "y": set(), "z": set(), "main": {"z"}}
    first, second = Feature("command", "a", {"a"}), Feature("command", "b", {"b"})
    fill_in_own([first, second], uses, set())
    assert (first.own, second.own) == ({"a", "x", "z"}, {"b"})
    fill_in_own([first, second], uses, {"main"})
    assert first.own == {"a", "x"}

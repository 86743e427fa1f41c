import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flgpr.scoring import splits

looks = st.lists(
    st.tuples(
        st.sampled_from(["", "m1", "m2", "m3"]),
        st.sampled_from("ab"),
        st.sampled_from(["wet", "dry"]),
    ),
    min_size=4,
    max_size=25,
)


def example_table(rows):
    return pd.DataFrame(rows, columns=["target", "lane", "site"]).assign(depth=0.05)


@settings(max_examples=150, deadline=None)
@given(looks, st.sampled_from(["example", "target", "lane", "site"]))
def test_every_example_is_tested_once_and_no_mine_straddles(rows, by):
    examples = example_table(rows)
    groups = {"example": len(rows), "target": examples["target"].replace("", np.nan).nunique()}.get(
        by, examples.get(by, examples["lane"]).nunique()
    )
    if groups < 2:
        return
    made = splits(examples, by)
    assert sorted(np.concatenate([one.test for one in made])) == list(range(len(rows)))
    for one in made:
        assert not set(one.train) & set(one.test)
        mines = [set(examples["target"].iloc[side]) - {""} for side in (one.train, one.test)]
        assert one.straddles == bool(mines[0] & mines[1])
        if by != "example":
            assert not one.straddles
        if by == "target":
            assert one.held_out == next(iter(mines[1]))
            assert len(mines[1]) == 1
            assert len(one.train) + len(one.test) == len(rows)
        if by in ("lane", "site"):
            assert set(examples[by].iloc[one.test]) == {one.held_out}
            left = set(range(len(rows))) - set(one.train) - set(one.test)
            assert all(examples["target"].iloc[row] in mines[1] for row in left)


def test_the_headline_is_grouped_by_target():
    examples = example_table(
        [("m1", "a", "wet"), ("m1", "b", "wet"), ("m2", "a", "wet"), ("", "a", "wet")]
    )
    assert {one.scheme for one in splits(examples)} == {"leave-one-target-out"}
    assert not any(one.straddles for one in splits(examples))


def test_mines_and_stretches_of_clutter_go_to_folds_together():
    examples = example_table(
        [(f"m{k // 2}", "a", "wet") for k in range(12)] + [("", "a", "wet")] * 6
    )
    examples["clutter"] = [""] * 12 + ["s1", "s1", "s2", "s2", "s3", "s3"]
    made = splits(examples, folds=3)
    assert [len(one.test) for one in made] == [6, 6, 6]
    assert made[0].held_out == "m0, m3"
    for one in made:
        stretches = set(examples["clutter"].iloc[one.test]) - {""}
        assert not stretches & set(examples["clutter"].iloc[one.train])


GOOD = example_table([("m1", "a", "wet"), ("m2", "b", "dry"), ("", "b", "dry")])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: splits(GOOD, "depth"), "by must be one of"),
        (lambda: splits(GOOD.drop(columns="target")), "must have the column target"),
        (lambda: splits(GOOD.drop(columns="site"), "site"), "must have the column site"),
        (
            lambda: splits(GOOD.assign(lane=["a", None, "b"]), "lane"),
            "lane must be named in every row",
        ),
        (lambda: splits(GOOD, "lane", folds=2), "folds must be left out"),
        (lambda: splits(GOOD, folds=9), "folds must lie between"),
        (lambda: splits(GOOD.iloc[:1]), "at least two groups"),
    ],
)
def test_divisions_that_cannot_be_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()

"""Experiments on soils and bands of Cosgrove et al. 2004, evidence/reasons/cosgrove2004_soils.py."""

import pytest

from flgpr.progress import silent
from flgpr_papers.cosgrove2004.detect import Peaks
from flgpr_papers.cosgrove2004.recipe import study_recipe
from reasons import cosgrove2004_soils
from reasons.cosgrove2004_soils import CHANGES, band_record, polarization_record, soil_trials

pytestmark = pytest.mark.slow("studies of papers")


def test_pd_is_told_by_band_and_depth(monkeypatch):
    asked = []

    def bands(recipe, site, seed, share, parts):
        asked.append((site, seed, parts))
        clutter = [0.0] * 400  # 400 boxes of 1 m²: the threshold lies under the highest four
        one = {"clutter": clutter, "clutter_quantile": clutter, "rock": [False] * 400}
        depth = [0.05, 0.05, 0.15, 0.15]
        found = {"0.3 to 1.9 GHz": [2.0, 2.0, -1.0, -1.0], "0.3 to 1.1 GHz": [2.0, -1.0, 2.0, -1.0]}
        return {
            name: Peaks(target=target, target_quantile=target, depth=depth, **one)
            for name, target in found.items()
        }

    monkeypatch.setattr(cosgrove2004_soils, "other_bands", bands)
    measure, parts = CHANGES["half the loss of clay"]
    record = measure(study_recipe(), parts, 3)
    assert asked == [("clay", 3, {"soil": {"loss_tangent": 0.12}})]
    assert record == {
        "paper": 0.5,
        "paper shallow": 1.0,
        "paper deep": 0.0,
        "low": 0.5,
        "low shallow": 0.5,
        "low deep": 0.5,
    }
    assert measure is band_record


def test_a_roadside_without_posts_is_another_roadside(monkeypatch):
    recipe = study_recipe(quick=True)
    views = []
    lane_looks = cosgrove2004_soils.lane_looks

    def looks(*rest, **options):
        views.append(lane_looks(*rest, **options))
        return views[-1]

    monkeypatch.setattr(cosgrove2004_soils, "lane_looks", looks)
    records = [
        polarization_record("gravel", "roadside", recipe, parts, 2)
        for parts in ({}, {"clutter": {"posts": 0.0, "bushes": 0.0}})
    ]
    for record in records:
        assert set(record) == {"both", "HH cuts alone", "VV cuts alone"}
        assert all(0 <= value <= 1 for value in record.values())
    beside, bare = views
    assert not beside["roadside"][0].image.equals(bare["roadside"][0].image)
    assert bare["roadside"][0].image.equals(bare["open"][0].image)
    assert beside["open"][0].image.equals(bare["open"][0].image)


def test_each_explanation_is_held_against_its_lanes(tmp_path, monkeypatch):
    worth = {"paper": 0.5, "low": 0.6, "paper shallow": 0.9, "low shallow": 0.9}
    worth |= {"paper deep": 0.1, "low deep": 0.3, "both": 0.6, "HH cuts alone": 0.5}
    worth |= {"VV cuts alone": 0.8}
    ran = []

    def fake(name):
        def measure(recipe, parts, seed):
            ran.append((name, seed))
            return {key: value + 1e-4 * seed * (key[0] in "pb") for key, value in worth.items()}

        return measure

    changes = {name: (fake(name), parts) for name, (_, parts) in CHANGES.items()}
    monkeypatch.setattr(cosgrove2004_soils, "CHANGES", changes)
    trials = soil_trials(study_recipe(quick=True), tmp_path, silent)
    assert len(ran) == 2 * len(CHANGES)
    said = {(one.changed, one.quantity.split(",")[0]): one.outcome for one in trials}
    assert said["half the loss of clay", "Pd"] == "refuted"
    assert said["mines at 15 cm alone", "Pd"] == "holds"
    assert said["bushes taken out", "Pd beside a roadside"] == "refuted"
    again = soil_trials(study_recipe(quick=True), tmp_path, silent)
    assert [one.row for one in again] == [one.row for one in trials]
    assert len(ran) == 2 * len(CHANGES)

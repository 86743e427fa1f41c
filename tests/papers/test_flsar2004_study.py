"""The flsar2004 reproduction: its settings, geometry, examples and verdicts, on images made by hand."""

import dataclasses
import json
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import LogisticRegression

from flgpr.detect import OneClassRelevanceVectorMachine
from flgpr.features import mean_template
from flgpr.model import Grid, load_sensor
from flgpr.screen import prescreen_clusters
from flgpr.simulate.simulator import Simulator
from flgpr_papers.flsar2004 import examples as ex
from flgpr_papers.flsar2004 import figures
from flgpr_papers.flsar2004 import machines as ma
from flgpr_papers.flsar2004 import study as flsar2004
from flgpr_papers.flsar2004.findings import Results
from flgpr_papers.flsar2004.lanes import Mines, Pass, _scene, load_settings
from flgpr_papers.kit import study
from flgpr_papers.kit.findings import AGREES, DISAGREES, NO_VERDICT, OPEN, UNDECIDED, read_findings
from flgpr_papers.kit.intervals import difference_of_shares
from flgpr_papers.kit.scenes import turned

pytestmark = pytest.mark.slow("studies of papers")


@pytest.fixture(scope="module")
def settings():
    return load_settings()


@pytest.fixture(scope="module")
def small(settings):
    mines = tuple(Mines(depth=m.depth, metal=4, plastic=2) for m in settings.mines)
    return settings.model_copy(update={"mines": mines})


def a_pass(settings, direction, seed, site="arid"):
    """Speckle, mines as bright ellipses whose strength falls with depth, fiducials; all shifted by 10 cm."""
    rng = np.random.default_rng(seed)
    m, (dx, dy) = settings.margin, settings.spacing
    nx = round((settings.lane[1] - settings.lane[0] + 2 * m) / dx) + 1
    grid = Grid(settings.lane[0] - m, -m, nx, round((settings.length + 2 * m) / dy) + 1, dx, dy)
    rows = [
        (k, mines.depth)
        for mines in settings.mines
        for k in ["metal"] * mines.metal + ["plastic"] * mines.plastic
    ]
    place = np.random.default_rng(0)
    truth = pd.DataFrame(rows, columns=["kind", "depth"])
    truth["x"] = place.uniform(-1, 1, len(rows))
    truth["y"] = (np.arange(len(rows)) + 0.5) * settings.pitch
    truth["target_id"] = [f"T{i:03d}" for i in range(len(rows))]
    fiducials = pd.DataFrame(
        {"x": np.tile([-2.2, 2.2], 4), "y": np.repeat(np.linspace(5, 60, 4), 2), "height": 0.0}
    )
    image = rng.rayleigh(0.4, (2, 3, *grid.shape))
    x, y = np.meshgrid(grid.x, grid.y)
    for mine in truth.itertuples():
        strength = 6 * np.exp(-mine.depth / 0.1) * (0.3 if mine.kind == "plastic" else 1)
        image += strength * np.exp(-(((x - mine.x) / 0.15) ** 2) - ((y - mine.y - 0.1) / 0.08) ** 2)
    for post in fiducials.itertuples():
        image += 30 * np.exp(-(((x - post.x) / 0.15) ** 2) - ((y - post.y - 0.1) / 0.08) ** 2)
    wave = np.exp(2j * np.pi * rng.random())  # the phase of a drive tells nothing
    return Pass(
        site,
        direction,
        (image * wave).astype(np.complex64),
        grid,
        truth,
        fiducials,
        f"{site}-{direction}",
    )


@pytest.fixture(scope="module")
def site(small):
    return ex.join(small, [a_pass(small, "out", 1), a_pass(small, "back", 2)])


def test_the_way_back_sees_the_same_mines_turned(small):
    sensor = load_sensor(small.sensor)
    sensor = sensor.model_copy(
        update={"tones": sensor.tones.model_copy(update={"step": 8e7, "count": 30})}
    )
    out = Simulator(_scene(small, "arid"), sensor, 3)
    back = Simulator(turned(_scene(small, "arid"), 3), sensor, 4)
    np.testing.assert_allclose(back.truth["x"], -out.truth["x"])
    np.testing.assert_allclose(back.truth["y"], small.length - out.truth["y"])
    assert (back.truth["kind"] == out.truth["kind"]).all()
    assert len(back.world.objects) == len(out.world.objects)
    assert len(out.truth) == 30


def test_join_finds_the_shift_and_keeps_both_looks_of_a_mine_together(small, site):
    assert max(found.residual for found in site.registration.values()) < 0.04
    for found in site.registration.values():
        assert found.shift == pytest.approx((0, 0.1), abs=0.03)
    looks = site.mines.groupby("target")["subset"]
    assert (looks.min() == looks.max()).all()
    assert (looks.size() == 2).all()
    assert site.mines["subset"].sum() == 2 * 4
    assert site.area == pytest.approx(2 * 3 * small.length)


def test_open_examples_leave_out_the_subset_and_give_mines_higher_features(small, site):
    templates = mean_template(ex.signatures(small, site, True)[0])
    table, X = ex.open_examples(small, site, templates)
    assert X.shape == (len(table), 6)
    assert not set(site.mines[site.mines["subset"]]["target"]) & set(table["target"])
    assert (table["kind"] == "metal").sum() + (table["kind"] == "plastic").sum() == (
        ~site.mines["subset"]
    ).sum()
    metal = X[table["kind"] == "metal"].mean()
    clutter = X[table["kind"] == "clutter"].mean()
    assert metal > clutter + 0.05


def test_prescreen_loses_weak_mines_and_labels_the_rest(small, site):
    templates = mean_template(ex.signatures(small, site, True)[0])
    screen = ex.learn_screen(small, site)
    regions = ex.screened_regions(site, screen, ("HH", "VV"))
    table, X = ex.screened_examples(small, site, templates, regions)
    assert len(table) == len(X) > 0
    mines = table[table["kind"] != "clutter"]
    assert not mines.duplicated(["target", "direction"]).any()
    for row in mines.itertuples():
        known = site.mines[
            (site.mines["target"] == row.target) & (site.mines["direction"] == row.direction)
        ]
        assert np.hypot(known["x"] - row.x, known["y"] - row.y).iloc[0] <= small.prescreen.halo


def test_held_out_scores_come_from_the_others(small):
    rng = np.random.default_rng(0)
    table = pd.DataFrame(
        {
            "kind": ["metal"] * 20 + ["clutter"] * 30,
            "target": [f"{i // 2}" for i in range(20)] + [""] * 30,
        }
    )
    X = rng.normal(size=(50, 2)) + 2 * (table["kind"] == "metal").to_numpy()[:, None]
    examples = ma.Examples(table, X)
    seen = []

    def classifier(train, y):
        seen.append((train, y))
        model = LogisticRegression().fit(train, y) if len(set(y)) > 1 else None
        return (lambda new: new.sum(axis=1)) if model is None else model.decision_function, 0.5

    one = ma.held_out(examples, classifier, 5)
    assert one.clutter.shape == (30, 1)
    assert all(len(train) < 50 for train, _ in seen)
    assert np.isfinite(one.mine).all()
    novel = ma.held_out(examples, classifier, 5, novelty=True)
    assert novel.clutter.shape == (30, 5)  # every fold scores all clutter
    seen.clear()
    alone = ma.leave_one_out(examples, classifier, 5)
    assert len(alone.vector_share) == len(seen) == 50
    assert all(len(train) == 49 for train, _ in seen)
    # N_o · N_c outputs: every mine left out once, and all clutter scored each time (par. 52).
    seen.clear()
    novel = ma.leave_one_out(examples, classifier, 5, novelty=True)
    assert novel.clutter.shape == (30, 20)
    assert [int(y.sum()) for _, y in seen] == [19] * 20


def test_the_second_prescreener_is_counted_where_there_are_no_mines(small, site):
    screen = ex.learn_screen(small, site)
    first, second, third = ex.clutter_past_prescreeners(site, screen, small.prescreen.halo)
    assert first >= second >= third >= 0
    assert ex.clutter_past_prescreeners(site, screen, 100.0) == (0, 0, 0)


def test_every_mine_of_the_subset_passes_every_prescreener(small, site):
    screen = ex.learn_screen(small, site)
    subset = site.mines[site.mines["subset"] & (site.mines["kind"] == "metal")]
    for channel, (ellipse, limits) in screen.channels(site.view):
        passed = prescreen_clusters(channel, limits, ellipse, small.prescreen.radius)
        for x, y in subset[["x", "y"]].to_numpy():
            assert np.hypot(passed["x"] - x, passed["y"] - y).min() <= small.prescreen.halo


def test_a_statement_that_hangs_on_the_formulation_cannot_be_said():
    rows = {"rvm, offset": (0.05, 0.02, 0.08), "rvm, no-bias": (0.3, 0.25, 0.4)}
    results = Results()
    results.judge_all("novelty", rows, kind="metal")
    results.judge_all("novelty", {name: rows["rvm, offset"] for name in rows}, kind="metal")
    results.judge_all("novelty", {name: rows["rvm, no-bias"] for name in rows}, kind="metal")
    assert [one.verdict for one in results.findings] == [UNDECIDED, AGREES, DISAGREES]
    assert "rvm, no-bias: 0.30" in results.findings[0].ours


def test_difference_of_proportions_matches_newcombes_example():
    # Newcombe 1998, Table II (a): 56/70 - 48/80
    value, low, high = difference_of_shares((56, 70), (48, 80))
    assert (value, low, high) == pytest.approx((0.2, 0.0524, 0.3339), abs=1e-4)


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory):
    """Run everything but the prescreeners on images made by hand, then again: nothing is computed a second time."""
    folder = tmp_path_factory.mktemp("flsar")

    def drive(settings, site, images, track):
        return [
            a_pass(settings, "out", len(site), site),
            a_pass(settings, "back", len(site) + 1, site),
        ]

    def few_references(**options):
        return OneClassRelevanceVectorMachine(**options | {"n_reference": 40})

    def never(material):
        raise AssertionError("computed again")

    few = load_settings(quick=True)
    fewest = {"widths": (1.0,), "costs": (1.0,), "degrees": (2,), "examples": (6, 8)}
    coarse = {"spacing": (0.12, 0.06), "classify": few.classify.model_copy(update=fewest)}
    few = few.model_copy(update=coarse)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flsar2004, "load_settings", lambda quick, world: few)
        patch.setattr(flsar2004, "drive", drive)
        patch.setattr(
            flsar2004, "PARTS", {k: part for k, part in flsar2004.PARTS.items() if k != "screened"}
        )
        patch.setattr(figures, "OneClassRelevanceVectorMachine", few_references)
        page = flsar2004.STUDY.reproduce(folder, quick=True)
        text = page.read_text(encoding="utf-8")
        findings = (folder / "findings.json").read_bytes()
        patch.setattr(flsar2004, "PARTS", dict.fromkeys(flsar2004.PARTS, never))
        patch.setattr(study, "draw", lambda *_: b"")
        undrawn = dataclasses.replace(flsar2004.STUDY, figures=MagicMock())
        undrawn.reproduce(folder, quick=True)
    assert (folder / "findings.json").read_bytes() == findings
    return folder, text


@pytest.mark.slow("runs a quick form of the whole study")
def test_the_page_holds_every_figure_and_finding(reproduced):
    folder, text = reproduced
    found = read_findings(folder)
    claims = {one.claim for one in found}
    assert {
        "RVM sparser by as much",
        "share of support vectors",
        "plastic separable without prescreener",
        "templates alike at both sites",
    } <= claims
    assert sum(text.count(f"<b>{verdict}</b>") for verdict in (NO_VERDICT, OPEN)) == len(found)
    for number in range(1, 11):
        assert f"<h3>Fig. {number}. " in text
        assert (folder / f"fig{number}.png").is_file()
    assert "Quick run" in text
    assert "http" not in text
    for name in ex.VARIANTS:
        assert name in text


@pytest.mark.slow("runs a quick form of the whole study")
def test_variants_have_intervals_and_the_main_one_no_difference_to_itself(reproduced):
    told = json.loads((reproduced[0] / "results.json").read_text(encoding="utf-8"))["notes"][
        "templates"
    ]
    assert set(told) == {
        f"{site}, {kind}" for site in ("arid", "temperate") for kind in ("metal", "plastic")
    }
    for case in told.values():
        assert case["mean template, magnitudes"]["less the main one"] == [0.0, 0.0, 0.0]
        for one in case.values():
            assert one["area"][1] <= one["area"][0] <= one["area"][2]


def test_complex_templates_do_not_depend_on_the_phase_of_each_signature(small, site):
    rows = np.exp(
        2j * np.pi * np.random.default_rng(5).random(400)
    )  # another phase every few metres of the strip
    phase = np.repeat(rows, -(-site.wave.shape[2] // 400))[: site.wave.shape[2]]
    # Magnitudes as they are; and every mine of the subset whole within one phase.
    for y in site.mines["y"][site.mines["subset"]]:
        near = np.abs(site.grid.y - y) < 0.6
        phase[near] = phase[near][0]
    turned = dataclasses.replace(site, wave=(site.wave * phase[:, None]).astype(np.complex64))
    for components in (0, 1):
        variant = ex.Variant(components, False)
        one, other = (ex.make_templates(small, where, variant) for where in (site, turned))
        np.testing.assert_allclose(np.abs(one), np.abs(other), atol=1e-4)
        assert (
            np.abs(ex.signatures(small, turned, True, False)[0].mean(axis=0)).max()
            < np.abs(ex.signatures(small, site, True, False)[0].mean(axis=0)).max()
        )

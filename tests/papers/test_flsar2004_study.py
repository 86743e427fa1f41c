"""The flsar2004 reproduction: its settings, geometry, examples and verdicts, on images made by hand."""

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from flgpr.detect import OneClassRelevanceVectorMachine, RelevanceVectorClassifier
from flgpr.features import mean_template
from flgpr.model import Grid, load_sensor
from flgpr.screen import prescreen_clusters
from flgpr.simulate.simulator import Simulator
from flgpr_papers.flsar2004 import examples as ex
from flgpr_papers.flsar2004 import experiment, figures
from flgpr_papers.flsar2004 import findings as fi
from flgpr_papers.flsar2004 import machines as ma
from flgpr_papers.flsar2004 import study as flsar2004
from flgpr_papers.flsar2004.lanes import Mines, Pass, _scene, lane_images, load_settings
from flgpr_papers.kit.findings import (
    AGREES,
    DISAGREES,
    NO_VERDICT,
    OPEN,
    UNDECIDED,
    difference_of_shares,
    read_findings,
)
from flgpr_papers.kit.worlds import turned


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


def test_settings_are_the_papers(settings):
    metal, plastic = (
        sum(getattr(m, kind) for m in settings.mines) for kind in ("metal", "plastic")
    )
    shallow = sum(m.metal + m.plastic for m in settings.mines if m.depth <= 0.05)
    assert (metal, plastic) == (60, 30)
    assert shallow / 90 == pytest.approx(0.7, abs=0.02)
    assert settings.ranges == (10.0, 15.0, 20.0)
    assert load_settings(quick=True).length < settings.length / 2


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


def test_lane_images_show_a_mine_where_it_is():
    settings = load_settings().model_copy(
        update={"mines": (Mines(depth=-0.15, metal=1, plastic=0),), "pitch": 8.0}
    )
    sensor = load_sensor("sri-van")
    tones = sensor.tones.model_copy(update={"start": 5e8, "step": 1e7, "count": 81})
    sensor = sensor.model_copy(update={"tones": tones, "footprint": (-3.0, 3.0, 6.5, 24.5)})
    scene = _scene(settings, "arid")
    quiet = scene.surface.model_copy(update={"echo": False, "phase_screen": False})
    none = scene.clutter.model_copy(update={"rocks": 0, "bushes": 0, "posts": 0, "patches": 0})
    scene = scene.model_copy(update={"surface": quiet, "clutter": none, "objects": ()})
    simulator = Simulator(scene, sensor, 0, errors=False)
    grid = Grid(-2.0, -1.0, 51, 251, 0.08, 0.04)
    image = np.abs(
        lane_images(settings, simulator, sensor, grid, range(len(simulator.reported_pose())))
    )
    mine = simulator.truth.iloc[0]
    for p, r in np.ndindex(2, 3):
        row, column = np.unravel_index(image[p, r].argmax(), grid.shape)
        assert grid.x[column] == pytest.approx(mine["x"], abs=0.3)
        assert grid.y[row] == pytest.approx(mine["y"], abs=0.5)


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


def scores_of(mine, clutter, target=None):
    mine = np.asarray(mine, float)
    clutter = np.asarray(clutter, float)
    clutter = clutter[:, None] if clutter.ndim == 1 else clutter
    target = np.arange(len(mine)).astype(str) if target is None else np.asarray(target)
    return ma.HeldOut(mine, clutter, target, np.arange(len(clutter)).astype(str), np.ones(1))


def test_held_out_scores_come_from_the_others(small):
    rng = np.random.default_rng(0)
    table = pd.DataFrame(
        {
            "kind": ["metal"] * 20 + ["clutter"] * 30,
            "target": [f"{i // 2}" for i in range(20)] + [""] * 30,
        }
    )
    X = rng.normal(size=(50, 2)) + 2 * (table["kind"] == "metal").to_numpy()[:, None]
    seen = []

    def classifier(train, y):
        seen.append((train, y))
        model = LogisticRegression().fit(train, y) if len(set(y)) > 1 else None
        return (lambda new: new.sum(axis=1)) if model is None else model.decision_function, 0.5

    one = ma.held_out(table, X, classifier, 5)
    assert one.clutter.shape == (30, 1)
    assert all(len(train) < 50 for train, _ in seen)
    assert np.isfinite(one.mine).all()
    novel = ma.held_out(table, X, classifier, 5, novelty=True)
    assert novel.clutter.shape == (30, 5)  # every fold scores all clutter
    seen.clear()
    alone = ma.leave_one_out(table, X, classifier, 5)
    assert len(alone.kept) == len(seen) == 50
    assert all(len(train) == 49 for train, _ in seen)
    # N_o · N_c outputs: every mine left out once, and all clutter scored each time (par. 52).
    seen.clear()
    novel = ma.leave_one_out(table, X, classifier, 5, novelty=True)
    assert novel.clutter.shape == (30, 20)
    assert [int(y.sum()) for _, y in seen] == [19] * 20


def some_examples(seed=0, mines=20, clutter=60):
    rng = np.random.default_rng(seed)
    y = np.arange(mines + clutter) < mines
    target = np.where(y, (np.arange(y.size) // 2).astype(str), "")
    table = pd.DataFrame({"kind": np.where(y, "metal", "clutter"), "target": target})
    return table, rng.normal(size=(y.size, 3)) + 1.5 * y[:, None]


def test_both_machines_have_one_kernel_and_the_papers_prior(settings, monkeypatch):
    (table, X), machines = some_examples(), []

    class Kept(RelevanceVectorClassifier):
        def fit(self, X, y):
            machines.append(self)
            return super().fit(X, y)

    monkeypatch.setattr(ma, "RelevanceVectorClassifier", Kept)
    y = (table["kind"] != "clutter").to_numpy()
    ma.rvm(settings.classify)(X, y)
    chosen = ma.search_svm(settings.classify, "rbf", X, y)[-1]
    assert [one.prior for one in machines] == ["laplacian-map"]
    assert machines[0].gamma == chosen.gamma
    machines.clear()
    ma.evidence_rvm(settings.classify)(X, y)
    assert {one.prior for one in machines} == {"ard"}
    assert len(machines) == len(settings.classify.widths) + 1


def test_the_width_of_a_novelty_detector_is_that_of_the_median_pair():
    X = np.random.default_rng(3).normal(size=(40, 6)) * [1, 2, 3, 4, 5, 6]
    Z = (X - X.mean(axis=0)) / X.std(axis=0)
    distance = ((Z[:, None] - Z) ** 2).sum(axis=2)[np.triu_indices(40, 1)]
    assert ma.median_width(X) == pytest.approx(1 / np.median(distance))


def test_training_anew_in_every_draw_holds_copies_out_together():
    table, X = some_examples()

    def memory(
        train, y
    ):  # remembers every example: it would give itself away if a copy were tested
        known = {tuple(row): float(label) for row, label in zip(train, y, strict=True)}
        return (lambda new: np.array([known.get(tuple(row), 0.5) for row in new])), 1.0

    np.testing.assert_allclose(ma.retrained(table, X, memory, 5, 4), 0.5)

    def fisher(train, y):
        return LogisticRegression().fit(train, y).decision_function, 1.0

    drawn = ma.retrained(table, X, fisher, 5, 30)
    assert 0.7 < drawn.mean() < 1.0
    assert drawn.std() > 0.005


def test_area_is_scikit_learns_and_its_interval_covers():
    rng = np.random.default_rng(1)
    one = scores_of(rng.normal(1, 1, 40), rng.normal(0, 1, 90))
    label = np.repeat([1, 0], [40, 90])
    assert fi.auc(one) == pytest.approx(
        roc_auc_score(label, np.concatenate([one.mine, one.clutter.ravel()]))
    )
    # Φ(1/√2)
    truth = 0.7602
    hits = 0
    for seed in range(60):
        draw = np.random.default_rng(seed)
        value = fi.auc_interval(scores_of(draw.normal(1, 1, 30), draw.normal(0, 1, 60)), 200)
        hits += value[1] <= truth <= value[2]
    assert hits >= 50  # 95 % of 60 less three standard errors


def test_looks_at_one_mine_widen_the_interval():
    rng = np.random.default_rng(2)
    mine = rng.normal(1, 1, 30)
    clutter = rng.normal(0, 1, 300)
    alone = fi.auc_interval(scores_of(mine, clutter), 500)
    twice = fi.auc_interval(
        scores_of(np.repeat(mine, 2), clutter, np.repeat(np.arange(30), 2)), 500
    )
    wrong = fi.auc_interval(scores_of(np.repeat(mine, 2), clutter), 500)
    assert twice[2] - twice[1] == pytest.approx(alone[2] - alone[1], rel=0.15)
    assert wrong[2] - wrong[1] < 0.9 * (twice[2] - twice[1])


def test_paired_differences_are_tighter_than_independent_ones():
    rng = np.random.default_rng(3)
    mine = rng.normal(1, 1, 50)
    clutter = rng.normal(0, 1, 100)
    a = scores_of(mine, clutter)
    b = scores_of(mine + rng.normal(0, 0.1, 50), clutter)
    measure = fi.Measure(area=200.0, far=0.07)
    value, low, high = fi.difference(a, b, measure, 500)
    assert low <= value <= high
    alone = measure.interval(a, 500)
    assert high - low < 0.5 * (alone[2] - alone[1])


def test_partial_area_and_pd_are_those_of_the_curve():
    rng = np.random.default_rng(5)
    for repeats in (1, 3):
        one = scores_of(rng.normal(1, 1, 30), rng.normal(0, 1, (80, repeats)))
        area = 160.0
        curve = fi.roc(one, area)
        far = curve["far"].to_numpy()
        pd_of = curve["pd"].to_numpy()
        for limit in (0.04, 0.07, 0.3):
            grid = (np.arange(20_000) + 0.5) / 20_000 * limit
            step = pd_of[np.searchsorted(far, grid, side="right") - 1]
            # Each output of clutter stands for the mines above it: the curve's value before it
            # falls due.
            assert fi.Measure(area, limit).value(one) == pytest.approx(step.mean(), abs=0.02)
            at = pd_of[np.searchsorted(far, limit, side="right") - 1]
            assert fi.Measure(area, limit, at=True).value(one) == pytest.approx(at, abs=1 / 30)
    whole = scores_of(rng.normal(1, 1, 30), rng.normal(0, 1, 80))
    assert fi.Measure(160.0, 0.5).value(whole) == pytest.approx(
        fi.auc(whole)
    )  # 80 in 160 m²: the whole ROC


def test_partial_area_by_chance_is_what_random_scores_give():
    rng = np.random.default_rng(6)
    measure = fi.Measure(160.0, 0.07)
    values = [
        measure.value(scores_of(rng.normal(size=30), rng.normal(size=80))) for _ in range(200)
    ]
    one = scores_of(rng.normal(size=30), rng.normal(size=80))
    assert np.mean(values) == pytest.approx(measure.chance(one), abs=0.015)
    values = [dataclasses.replace(measure, at=True).value(scores_of(rng.normal(size=30), rng.normal(size=80)))
              for _ in range(200)]  # fmt: skip
    assert np.mean(values) == pytest.approx(
        dataclasses.replace(measure, at=True).chance(one), abs=0.02
    )


def test_mines_that_the_prescreener_lost_are_found_at_no_threshold():
    one = scores_of([3.0, 2.0], [1.0, 0.5, 0.1], ["a", "b"])
    seen = pd.DataFrame({"target": ["a", "b"], "direction": ["out", "back"]})
    offered = pd.DataFrame({"target": ["a", "a", "b", "b"], "direction": ["out", "back"] * 2})
    every = ma.with_lost(one, seen, offered)
    assert every.mine.tolist() == [3.0, -np.inf, -np.inf, 2.0]
    assert fi.Measure(1.0, 0.0 + 1e-9, at=True).value(every) == 0.5
    assert (
        fi.Measure(1.0, 100.0, at=True).value(every) == 0.5
    )  # however many false alarms are allowed
    assert fi.Measure(1.0, 100.0).value(every) == pytest.approx(0.5)


def test_strength_is_compared_at_the_same_depth_alone():
    a = pd.DataFrame({"peak": [1.0, 9.0], "depth": [0.0, 0.1], "target": ["s", "t"]})
    b = pd.DataFrame(
        {"peak": [2.0, 8.0, 100.0], "depth": [0.0, 0.1, 0.15], "target": ["u", "v", "w"]}
    )
    assert fi.stronger_interval(a, b, 20)[0] == 0.5


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
    results = experiment.Results()
    results.judge_all("novelty", rows, kind="metal")
    results.judge_all("novelty", {name: rows["rvm, offset"] for name in rows}, kind="metal")
    results.judge_all("novelty", {name: rows["rvm, no-bias"] for name in rows}, kind="metal")
    assert [one.verdict for one in results.findings] == [UNDECIDED, AGREES, DISAGREES]
    assert "rvm, no-bias: 0.30" in results.findings[0].ours


def test_one_class_machines_are_told_apart(settings):
    table, X = some_examples()
    y = (table["kind"] != "clutter").to_numpy()
    scores = {name: ma.one_class(settings.classify, name)(X, y)[0](X) for name in ma.NOVELTY_RIVALS}
    assert len({tuple(np.round(one, 9)) for one in scores.values()}) == len(ma.NOVELTY_RIVALS)
    with pytest.raises(ValueError, match="kind must be one of"):
        ma.one_class(settings.classify, "rvm")
    np.testing.assert_allclose(ma.sum_of_correlations(X, y)[0](X), X.sum(axis=1))


def test_difference_of_proportions_matches_newcombes_example():
    # Newcombe 1998, Table II (a): 56/70 - 48/80
    value, low, high = difference_of_shares((56, 70), (48, 80))
    assert (value, low, high) == pytest.approx((0.2, 0.0524, 0.3339), abs=1e-4)


def test_pd_at_a_false_alarm_rate():
    one = scores_of([5, 4, 3, 2, 1, 0.5], [4.5, 2.5, 0.7, 0.1])
    assert fi.pd_count(one, 100.0, 0.01, np.ones(6, bool)) == (
        3,
        6,
    )  # one false alarm: everything above 2.5
    assert fi.pd_count(one, 100.0, 0.0, np.array([1, 1, 0, 0, 0, 0], bool)) == (1, 2)


def test_templates_of_one_signature_have_one_component():
    rng = np.random.default_rng(4)
    signature = rng.random((1, 2, 3, 9, 7))
    alike = signature * rng.uniform(1, 5, (30, 1, 1, 1, 1))
    share, cosine = fi.component_interval(alike, 20)
    assert share[0] == pytest.approx(1)
    assert cosine[0] == pytest.approx(1)
    different = rng.normal(size=(30, 2, 3, 9, 7))
    assert fi.component_interval(different, 20)[0][0] < 0.3
    assert fi.likeness_interval(alike, 3 * alike, 20)[0] == pytest.approx(1)


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
        page = flsar2004.reproduce(folder, quick=True)
        text = page.read_text(encoding="utf-8")
        findings = (folder / "findings.json").read_bytes()
        patch.setattr(flsar2004, "PARTS", dict.fromkeys(flsar2004.PARTS, never))
        patch.setattr(figures, "draw", lambda *_: iter(()))
        flsar2004.reproduce(folder, quick=True)
    assert (folder / "findings.json").read_bytes() == findings
    return folder, text


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


def test_margin_touches_the_nearest_points():
    figure = figures.margin_figure()
    title = figure.axes[0].get_title()
    below, above = (float(title.split(f"D{side}1 = ")[1].split(",")[0]) for side in "-+")
    assert below == pytest.approx(above, abs=0.02)  # a hard margin lies in the middle
    assert 0.1 < below < 2

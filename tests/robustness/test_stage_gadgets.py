"""Arrays of a model's stages that no training gives: refused before anything is worked out with them.

A stage's arrays are numbers, so nothing of them can run. Of other shapes than their own they could fill the memory, or
end a detection with a fault of the program after hours.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.method.model import Model, save_model
from flgpr.model import Grid
from flgpr.recipe.schema import recipe_text
from flgpr.stages import Stage, Table
from flgpr.stages.named import PACKAGED, Named, find_stage, make_stage, stage_names
from flgpr.store import sample_lane

SETUP = SimpleNamespace(
    images=Grid.spanning((-2.0, 2.0), (2.5, 5.5), 0.1),
    view=Grid.spanning((-1.0, 1.0), (0.0, 9.0), 0.08),
    imaged=[0, 1],
    imager=SimpleNamespace(subbands={"F1": (1e9, 2e9), "F2": (2e9, 3e9)}),
)
IMAGES = 4  # polarizations times sub-bands
RNG = np.random.default_rng(5)


def forms(features, count=2, rank=3):
    arrays = {"constant": RNG.normal(size=count), "clutter": np.array([0.1, 2.0])}
    for k in range(count):
        vectors = RNG.normal(size=(rank, features)) + 1j * RNG.normal(size=(rank, features))
        arrays |= {
            f"strength-{k}": RNG.normal(size=rank),
            f"vectors-{k}": vectors,
            f"linear-{k}": vectors[0],
            f"offset-{k}": np.zeros(rank),
        }
    return arrays


def network(channels=(16, 24, 32), networks=3):
    arrays = {"mean": np.zeros((IMAGES, 1, 1)), "deviation": np.ones((IMAGES, 1, 1))}
    for number in range(networks):
        given = IMAGES
        for layer, taken in enumerate(channels):
            arrays[f"{number}-kernel{layer}"] = np.zeros((taken, given, 3, 3), np.float32)
            arrays[f"{number}-bias{layer}"] = np.zeros(taken, np.float32)
            given = taken
        arrays[f"{number}-last"] = np.zeros(given, np.float32)
        arrays[f"{number}-bias"] = np.zeros(1, np.float32)
    return arrays


def likelihood(metres=4, rank=8, size=9 * IMAGES):
    white = np.zeros((metres, size, size), np.complex64)
    vectors = np.zeros((metres, rank, size), np.complex64)
    share = np.full((metres, rank), 1 / rank)
    return {
        "whitener": white,
        "signature": vectors,
        "share": share,
        "stone": vectors,
        "stone_share": share,
    }


def clusters():
    names = ("half_x", "half_y", "offset_x", "offset_y", "amplitude", "size", "std", "energy_ratio")
    return {name: np.full((2, 3), 0.2) for name in names}


def dictionary(components, directions, **arrays):
    mean = np.zeros(components)
    return {"mean": mean, "projection": np.zeros((directions, components)), **arrays}


WINDOW = 9  # pixels of 0.08 m in the 0.7 m of a window of visual words
LEARNT = {
    ("clutter", "masks"): {
        "vv": np.ones(4),
        "vh": np.ones(4),
        "low_vh": np.ones(4),
        "looks": np.ones(4, int),
    },
    ("map", "deflection"): forms(56),
    ("map", "neyman-pearson"): forms(56),
    ("map", "principal-components"): forms(56, count=3),
    ("map", "whitening"): forms(2, rank=2),
    ("map", "magnitude"): forms(2, count=1, rank=1),
    ("map", "likelihood"): likelihood(),
    ("screen", "clusters"): clusters(),
    ("features", "templates"): {"templates": np.zeros((2, 3, 11, 13))},
    ("features", "matched"): {
        "mean": np.zeros(IMAGES),
        "signature": np.ones(IMAGES),
        "covariance": np.eye(IMAGES),
    },
    ("features", "network"): network(),
    ("features", "visual-words"): dictionary(2 * WINDOW**2, 32, words=np.zeros((200, 32))),
    ("features", "fisher-vectors"): dictionary(
        2 * 128,
        16,
        share=np.full(30, 1 / 30),
        centre=np.zeros((30, 16)),
        deviation=np.ones((30, 16)),
    ),
}
"""Arrays of every packaged stage that learns, as training gives them for ``SETUP`` and the defaults."""


SETTINGS = {"likelihood": {"sensor": "sri-array"}}  # entries without a default


class Taken(Stage):
    """Stands in for a stage that is made: only its arrays are looked at."""

    def __init__(self, settings, setup, learnt=None):
        self.learnt = learnt


def make(kind, name, arrays):
    of = find_stage(kind, name)
    stand_in = type(of.__name__, (Taken,), {"check_learnt": of.check_learnt})
    return make_stage(
        f"{kind}.{name}",
        Named(stage=name, settings=of.Settings(**SETTINGS.get(name, {})), stage_class=stand_in),
        SETUP,
        arrays,
    )


def with_arrays(**arrays):
    return lambda learnt: learnt.update(
        {name.replace("_dash_", "-"): np.asarray(value) for name, value in arrays.items()}
    )


def without(name):
    return lambda learnt: learnt.pop(name)


GADGETS = {
    "an array that is missing": ("network", without("1-last"), "'1-last' is missing"),
    "a method's name": ("masks", with_arrays(__init__=np.ones(4)), "'__init__' does not belong"),
    "text": ("masks", with_arrays(vv=["eval"] * 4), "'vv' must hold float64, got <U4"),
    "thresholds of other regions": (
        "masks",
        with_arrays(vh=np.ones(5)),
        "'vh' must have the shape",
    ),
    "a threshold that is no number": (
        "masks",
        with_arrays(vv=np.full(4, np.nan)),
        "must be numbers",
    ),
    "a hundred thousand networks": (
        "network",
        with_arrays(**{f"{k}_dash_bias": np.zeros(1, np.float32) for k in range(100)}),
        "does not belong",
    ),
    "a kernel of a million channels": (
        "network",
        with_arrays(**{"0_dash_kernel0": np.zeros((10**6, IMAGES, 3, 3), np.float32)}),
        "'0-kernel0' must have the shape",
    ),
    "a deviation of zero": ("network", with_arrays(deviation=np.zeros((IMAGES, 1, 1))), "positive"),
    "a network that is numbered by code": (
        "network",
        with_arrays(**{"exit()_dash_bias": np.zeros(1, np.float32)}),
        "does not belong",
    ),
    "no forms": ("deflection", with_arrays(constant=np.zeros(0)), "1 to 64 forms, got 0"),
    "a thousand forms": ("deflection", with_arrays(constant=np.zeros(1000)), "1 to 64 forms"),
    "forms of other chips": ("neyman-pearson", lambda learnt: learnt.update(forms(55)), "shape"),
    "more directions than values": (
        "whitening",
        with_arrays(**{"strength_dash_0": np.ones(10**6)}),
        "must have at most 2",
    ),
    "a strength for each of a million pixels": (
        "magnitude",
        with_arrays(**{"linear_dash_0": np.ones((10**6, 2))}),
        "'linear-0' must have the shape",
    ),
    "a spread that is endless": ("deflection", with_arrays(clutter=[0.0, np.inf]), "finite"),
    "components of other intervals": (
        "principal-components",
        lambda learnt: learnt.update(forms(56, count=2)),
        "'constant' must have the shape",
    ),
    "components of other chips": (
        "principal-components",
        lambda learnt: learnt.update(forms(55, count=3)),
        "shape",
    ),
    "metres without end": (
        "likelihood",
        lambda learnt: learnt.update(likelihood(metres=5000, size=1)),
        "'whitener' must have the shape",
    ),
    "signatures without end": (
        "likelihood",
        lambda learnt: learnt.update(likelihood(rank=5000)),
        "'share' must have at most",
    ),
    "a stone that does not fit": (
        "likelihood",
        with_arrays(stone=np.zeros((4, 8, 7), np.complex64)),
        "'stone' must have the shape",
    ),
    "an ellipse as large as a village": (
        "clusters",
        with_arrays(half_x=np.full((2, 3), 1e3)),
        "'half_x' must lie between 0 and",
    ),
    "an ellipse far away": (
        "clusters",
        with_arrays(offset_y=np.full((2, 3), -1e9)),
        "'offset_y' must lie between",
    ),
    "thresholds of other images": ("clusters", with_arrays(std=np.ones((3, 3))), "shape"),
    "a template as large as a lane": (
        "templates",
        with_arrays(templates=np.zeros((2, 3, 11, 100_000))),
        "'templates' must have the shape",
    ),
    "a covariance that is not square": (
        "matched",
        with_arrays(covariance=np.ones((IMAGES, 10**6))),
        "'covariance' must have the shape",
    ),
    "windows without end": (
        "visual-words",
        with_arrays(mean=np.zeros(10**6)),
        "'mean' must have 81 components of each of 1 to 2 polarizations",
    ),
    "directions without end": (
        "visual-words",
        with_arrays(projection=np.zeros((10**4, 2 * WINDOW**2))),
        "'projection' must have the shape",
    ),
    "a million words": (
        "visual-words",
        with_arrays(words=np.zeros((10**6, 32))),
        "'words' must have the shape",
    ),
    "words that are endless": (
        "visual-words",
        with_arrays(words=np.full((200, 32), np.inf)),
        "'words' must be finite",
    ),
    "Gaussians without end": (
        "fisher-vectors",
        with_arrays(centre=np.zeros((10**6, 16))),
        "'centre' must have the shape",
    ),
    "a Gaussian without width": (
        "fisher-vectors",
        with_arrays(deviation=np.zeros((30, 16))),
        "'deviation' must be positive",
    ),
    "a share of less than nothing": (
        "fisher-vectors",
        with_arrays(share=np.full(30, -1 / 30)),
        "'share' must be positive",
    ),
    "shares of more than all": (
        "fisher-vectors",
        with_arrays(share=np.ones(30)),
        "'share' must add up to 1, got 30",
    ),
    "a mean of complex numbers": ("matched", with_arrays(mean=np.ones(IMAGES, complex)), "float64"),
}


def kind_of(name):
    return next(kind for kind, known in LEARNT if known == name)


def test_every_packaged_stage_that_learns_is_tried():
    learning = {
        (kind, name)
        for kind in PACKAGED
        for name in stage_names(kind)
        if find_stage(kind, name).learns
    }
    assert set(LEARNT) == learning
    assert {name for name, _, _ in GADGETS.values()} == {name for _, name in learning}


@pytest.mark.parametrize(("kind", "name"), LEARNT)
def test_what_training_gives_is_taken(kind, name):
    arrays = LEARNT[kind, name]
    assert make(kind, name, arrays).learnt is arrays
    assert make(kind, name, None).learnt is None


@pytest.mark.parametrize("gadget", GADGETS)
def test_what_training_does_not_give_is_refused(gadget):
    name, change, words = GADGETS[gadget]
    kind = kind_of(name)
    arrays = dict(LEARNT[kind, name])
    change(arrays)
    with pytest.raises(ValueError, match=f"^model's stage {kind}.{name} does not fit.*{words}"):
        make(kind, name, arrays)


def test_stages_of_others_may_leave_it_out():
    named = Named(stage="own", settings=Table(), stage_class=Taken)
    arrays = {"anything": np.ones(3)}
    assert make_stage("features.own", named, SETUP, arrays).learnt is arrays


def test_a_detection_with_such_a_model_ends_before_it_begins(tmp_path):
    recipe = tmp_path / "recipe.toml"
    recipe.write_text(recipe_text("miniature") + '\n[[columns]]\nstage = "network"\n')
    arrays = network() | {"0-kernel0": np.zeros((20_000, IMAGES, 3, 3), np.float32)}
    model = save_model(Model(stages={"features.network": arrays}), tmp_path / "model")
    words = ["detect", str(sample_lane() / "run.zarr"), "--recipe", str(recipe)]
    words += ["--model", str(model), "-o", str(tmp_path / "out"), "--quiet"]
    ran = CliRunner().invoke(app, words)
    assert ran.exit_code == 2, ran.output
    assert "'0-kernel0' must have the shape" in ran.output
    assert not (tmp_path / "out").exists()

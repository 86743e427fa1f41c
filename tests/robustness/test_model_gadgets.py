"""Models that somebody made to run code, to reach files or to exhaust the memory: each is refused, and nothing happens.

A gadget is a model file whose digests all fit, as whoever can write a file can make them.
"""

import io
import json
import shutil
import tracemalloc
import zipfile
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.run_report import model_info
from flgpr.detect.estimator_table import known_estimators
from flgpr.detect.scorers.checks import Checked
from flgpr.method.classifier import TrainingSet, train
from flgpr.method.estimators import train_estimator
from flgpr.method.model import MODEL_FILE, Model, describe_model, load_model, save_model
from flgpr.recipe.tables import DetectorTable
from flgpr.store import (
    Bundle,
    json_with_digest,
    parse_with_digest,
    sample_lane,
    sha256,
    write_bundle,
)

COLUMNS = ["a", "b"]
ONE_CLASS = {"one-class-rvm": "mines", "mixture": "mines", "one-class-svm": "mines", "isolation-forest": "clutter",
             "ecod": "clutter", "copod": "clutter", "knn": "clutter"}  # fmt: skip
OPTIONS = {
    "random-forest": {"n_estimators": 5, "random_state": 0},
    "gradient-boosting": {"max_iter": 5},
    "isolation-forest": {"n_estimators": 5, "random_state": 0},
    "mixture": {"random_state": 0},
    "rvm": {"n_starts": 1},
}


@pytest.fixture(scope="module")
def examples():
    rng = np.random.default_rng(3)
    features = pd.DataFrame(
        np.concatenate([rng.normal(0, 1, (60, 2)), rng.normal(3, 1, (20, 2))]), columns=COLUMNS
    )
    label = np.repeat([0, 1], [60, 20])
    return TrainingSet(features, label, np.ones(80, int), np.repeat("lane", 80))


@pytest.fixture(scope="module")
def trained(examples, tmp_path_factory):
    """A whole model of every estimator that a recipe may name."""
    folders = {}
    for name in known_estimators():
        table = DetectorTable(
            estimator=name,
            features=COLUMNS,
            on=ONE_CLASS.get(name, "all"),
            options=OPTIONS.get(name, {}),
        )
        folder = tmp_path_factory.mktemp("models") / name
        folders[name] = save_model(Model(train_estimator(examples, table, COLUMNS)), folder)
    folder = tmp_path_factory.mktemp("models") / "fisher"
    folders["fisher"] = save_model(Model(train(examples, COLUMNS)), folder)
    return folders


def forge(source, folder, change):
    """Write a model again with what ``change`` makes of its words and arrays, digests and all."""
    bundle = Bundle(source / MODEL_FILE)
    about = json.loads(json.dumps(bundle.about))
    arrays = dict(bundle)
    change(about, arrays)
    folder.mkdir(parents=True, exist_ok=True)
    write_bundle(folder / MODEL_FILE, arrays, about)
    return folder


def forge_head(source, folder, change):
    """Write a model's file with what ``change`` makes of its head, which no writer of ours would write."""
    data = (source / MODEL_FILE).read_bytes()
    first, _, rest = data.partition(b"\n")
    length = int(first.split()[0])
    head = json.loads(rest[:length])
    change(head)
    text = json.dumps(head).encode()
    folder.mkdir(parents=True)
    (folder / MODEL_FILE).write_bytes(
        b"%d %s\n%s%s" % (len(text), sha256(text).encode(), text, rest[length:])
    )
    return folder


def settings(about):
    return about["detector"]["settings"]


def skops_archive(marker):
    """A file of skops whose tree calls str.format and then eval on what comes out: it writes ``marker``."""
    code = f"open({str(marker)!r}, 'w').close()"
    function = {
        "__class__": "eval",
        "__module__": "builtins",
        "__loader__": "FunctionNode",
        "__id__": 2,
        "content": "eval",
    }
    step = {"__class__": "FunctionTransformer", "__module__": "sklearn.preprocessing._function_transformer",
            "__loader__": "ObjectNode", "__id__": 3, "content": {"func": function, "kw_args": code}}  # fmt: skip
    schema = {"__class__": "Pipeline", "__module__": "sklearn.pipeline", "__loader__": "ObjectNode", "__id__": 1,
              "content": {"steps": [step]}, "protocol": 2}  # fmt: skip
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("schema.json", json.dumps(schema))
    return np.frombuffer(out.getvalue(), np.uint8)


CALL = "__import__('os').mknod('MARKER')"


def old_archive(about, arrays, marker):
    about["detector"] = {"estimator": "gradient-boosting", "features": COLUMNS, "unlike": False}
    for name in list(arrays):
        del arrays[name]
    arrays |= {
        "detector.centre": np.zeros(2),
        "detector.scale": np.ones(2),
        "detector.estimator": skops_archive(marker),
    }


def archive_beside(about, arrays, marker):
    arrays["detector.estimator"] = skops_archive(marker)


def with_setting(name, value):
    def change(about, arrays, marker):
        settings(about)[name] = json.loads(json.dumps(value).replace("MARKER", str(marker)))

    return change


def with_array(name, value):
    def change(about, arrays, marker):
        arrays[f"detector.{name}"] = np.asarray(value)

    return change


def with_words(**words):
    def change(about, arrays, marker):
        about["detector"].update(words)

    return change


def child_of_itself(about, arrays, marker):
    """A walk that never ends."""
    left = arrays["detector.left"].copy()
    left[0] = 0
    arrays["detector.left"] = left


def child_of_another_tree(about, arrays, marker):
    right = arrays["detector.right"].copy()
    right[0] = arrays["detector.first"][1]
    arrays["detector.right"] = right


def feature_beyond(about, arrays, marker):
    feature = arrays["detector.feature"].copy()
    feature[0] = 10**9
    arrays["detector.feature"] = feature


def deep_tree(about, arrays, marker):
    """One tree of 100,000 nodes, each with one leaf: every alarm would take them all."""
    inner = 50_000
    count = 2 * inner + 1
    left = np.full(count, -1)
    right = np.full(count, -1)
    left[:inner] = np.arange(1, inner + 1)
    right[:inner] = np.arange(inner + 1, count)
    arrays |= {"detector.first": np.array([0]), "detector.left": left, "detector.right": right,
               "detector.feature": np.zeros(count, int), "detector.split": np.zeros(count),
               "detector.value": np.zeros(count)}  # fmt: skip


def grown(name, *shape):
    def change(about, arrays, marker):
        arrays[f"detector.{name}"] = np.zeros(shape)

    return change


GADGETS = {
    # a file that could name what to call
    "an archive of skops": ("gradient-boosting", old_archive, "train it again"),
    "an archive of skops beside": (
        "gradient-boosting",
        archive_beside,
        "'estimator' does not belong",
    ),
    # callables and names where a word stands
    "kernel is code": ("svm", with_setting("kernel", CALL), "'kernel' must be one of linear"),
    "kernel is a list": (
        "rvm",
        with_setting("kernel", ["eval", CALL]),
        "'kernel' must be one of linear",
    ),
    "kernel is a class": (
        "one-class-svm",
        with_setting("kernel", {"__module__": "builtins", "__class__": "eval"}),
        "'kernel' must be one of linear",
    ),
    "metric is numpy.load": (
        "knn",
        with_setting("metric", "numpy.load"),
        "'metric' does not belong",
    ),
    "method is a methodcaller": (
        "knn",
        with_setting("method", "operator.methodcaller"),
        "'method' must be one of largest",
    ),
    "func is a partial": (
        "lda",
        with_setting("func", "functools.partial"),
        "'func' does not belong",
    ),
    "intercept is text": (
        "logistic",
        with_setting("intercept", CALL),
        "'intercept' must be a finite number",
    ),
    "intercept is nothing": ("logistic", with_setting("intercept", None), "finite number"),
    "a nested pipeline": (
        "mixture",
        with_setting("offset", {"steps": [["eval", CALL]]}),
        "'offset' must be a finite",
    ),
    "a flag that is a number": (
        "rvm",
        with_setting("moderated", 1),
        "'moderated' must be true or false",
    ),
    # another class, module or estimator
    "an estimator of another module": (
        "svm",
        with_words(estimator="os.system"),
        "must be one of rvm",
    ),
    "an estimator that is a list": (
        "svm",
        with_words(estimator=["eval"]),
        "must be one of rvm|cannot be read",
    ),
    "another estimator's arrays": (
        "svm",
        with_words(estimator="random-forest"),
        "is missing|does not belong",
    ),
    "unlike is text": ("ecod", with_words(unlike=CALL), "unlike must be true or false"),
    "features are not names": (
        "lda",
        with_words(features=[{"a": 1}, CALL]),
        "must be a list of different names",
    ),
    "features are one text": (
        "lda",
        with_words(features="ab"),
        "must be a list of different names",
    ),
    # arrays of other types and shapes
    "names of features as text": (
        "logistic",
        with_array("feature_names_in_", np.array(["a", CALL])),
        "does not belong",
    ),
    "weights as text": (
        "logistic",
        with_array("weight", np.array([CALL, "b"])),
        "'weight' must hold float64",
    ),
    "weights as complex numbers": (
        "lda",
        with_array("weight", np.ones(2, complex)),
        "'weight' must hold float64",
    ),
    "weights without end": ("svm", with_array("weight", np.array([np.inf])), "must be finite"),
    "a scale of zero": (
        "one-class-rvm",
        with_array("own_scale", np.zeros(2)),
        "'own_scale' must be positive",
    ),
    "another scale of zero": ("svm", with_array("scale", np.zeros(2)), "scale must be positive"),
    "a huge covariance": ("rvm", grown("covariance", 0, 10**9), "must have the shape"),
    "a broadcasting mean": ("mixture", grown("mean", 1, 1), "must have the shape"),
    "vectors of other features": ("svm", grown("vectors", 3, 1), "must have the shape"),
    # kernels
    "a kernel that is not there": (
        "mkl",
        with_array("group", np.array([0, 10**9])),
        "'group' must be from 0 to 1",
    ),
    "a group before the first": (
        "mkl",
        with_array("group", np.array([0, -1])),
        "'group' must be from 0 to 1",
    ),
    "groups as fractions": ("mkl", with_array("group", np.zeros(2)), "'group' must hold int64"),
    "a million kernels": (
        "mkl",
        grown("kernel_weight", 10**6),
        "'gamma' must have the shape",
    ),
    "kernels of a million features": (
        "mkl",
        lambda about, arrays, marker: arrays.update(
            {f"detector.{name}": np.ones(10**6) for name in ("kernel_weight", "gamma")}
        ),
        "'kernel_weight' must be of 1 to 2",
    ),
    "a kernel of negative weight": (
        "mkl",
        with_array("kernel_weight", np.array([2.0, -1.0])),
        "'kernel_weight' must not be negative",
    ),
    "a kernel that grows with distance": (
        "mkl",
        with_array("gamma", np.array([1.0, -1e3])),
        "'gamma' must not be negative",
    ),
    "neighbours beyond the examples": (
        "knn",
        with_setting("neighbours", 10**12),
        "whole number from 1",
    ),
    "no examples": ("knn", grown("examples", 0, 2), "neighbours|hold an example"),
    # trees
    "a node that is its own child": ("random-forest", child_of_itself, "must lead to later nodes"),
    "a way into another tree": (
        "gradient-boosting",
        child_of_another_tree,
        "must lead to later nodes",
    ),
    "a feature that is not there": (
        "isolation-forest",
        feature_beyond,
        "'feature' must be from 0 to 1",
    ),
    "a tree that is endlessly deep": ("gradient-boosting", deep_tree, "at most 4096 nodes deep"),
    "shares beyond one": ("random-forest", grown("value", 1), "shape|between 0 and 1"),
}


@pytest.mark.parametrize("name", GADGETS)
def test_a_gadget_is_refused_and_nothing_happens(trained, tmp_path, name):
    estimator, change, told = GADGETS[name]
    marker = tmp_path / "marker"
    folder = forge(
        trained[estimator], tmp_path / "model", lambda about, arrays: change(about, arrays, marker)
    )
    with pytest.raises(ValueError, match=f"^model .*(?:{told})"):
        load_model(folder)
    assert not marker.exists()
    assert describe_model(folder)["arrays"]  # told without being loaded


HEADS = {
    "objects": ("dtype", "|O"),
    "a record with objects": ("dtype", {"names": ["a"], "formats": ["O"]}),
    "types in one text": ("dtype", "f8,O"),
    "the default type": ("dtype", None),
    "a module": ("dtype", "numpy.load"),
    "text without letters": ("dtype", "<U0"),
    "an array as the type": ("dtype", "(2,3)f8"),
    "a shape that is text": ("shape", "22"),
    "a shape of so many axes": ("shape", [1] * 100_000),
    "nothing, so many times": ("shape", [0, 10**30]),
    "a true shape": ("shape", [True]),
    "a broken length": ("shape", [2.0]),
    "less than nothing": ("shape", [-1]),
    "a place before the file": ("at", -64),
    "a place that is text": ("at", "0"),
    "a name that is a list": ("name", ["eval"]),
    "a name that is nothing": ("name", None),
}


@pytest.mark.parametrize("name", HEADS)
def test_a_head_that_no_writer_of_ours_writes_is_refused_at_once(trained, tmp_path, name):
    entry, value = HEADS[name]
    folder = forge_head(
        trained["logistic"],
        tmp_path / "model",
        lambda head: head["arrays"][0].update({entry: value}),
    )
    for read in (load_model, describe_model):
        with pytest.raises(ValueError, match="not a whole file of arrays") as caught:
            read(folder)
        assert len(str(caught.value)) < 500


def test_the_type_of_an_array_is_not_worked_out(trained, tmp_path):
    """NumPy evaluates a shape within a type, which takes a thousand times the memory of its text."""
    endless = f"({'1,' * 100_000})f8"
    folder = forge_head(
        trained["logistic"],
        tmp_path / "model",
        lambda head: head["arrays"][0].update(dtype=endless),
    )
    tracemalloc.start()
    with pytest.raises(ValueError, match="must hold numbers or text"):
        load_model(folder)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10e6


def test_a_head_with_an_array_twice_is_refused(trained, tmp_path):
    folder = forge_head(
        trained["logistic"],
        tmp_path / "model",
        lambda head: head["arrays"].append(head["arrays"][0]),
    )
    with pytest.raises(ValueError, match="is there twice"):
        load_model(folder)


@pytest.mark.parametrize(
    "stages", ["abc", {"a": 1}, [["a"]], [1], ["a", "a"], ["detector"], None, [{}]], ids=str
)
def test_stages_are_a_list_of_different_names(trained, tmp_path, stages):
    folder = forge(
        trained["svm"], tmp_path / "model", lambda about, arrays: about.update(stages=stages)
    )
    with pytest.raises(ValueError, match="stages must be a list of different names"):
        load_model(folder)


@pytest.mark.parametrize("estimator", ["svm", "fisher"])
def test_words_of_a_detector_that_nothing_reads_are_refused(trained, tmp_path, estimator):
    folder = forge(
        trained[estimator],
        tmp_path / "model",
        lambda about, arrays: about["detector"].update(func="eval"),
    )
    with pytest.raises(ValueError, match="alone, got 'func'"):
        load_model(folder)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), True, "1", [1], {}])
def test_what_json_can_hold_beside_numbers_is_no_number(value):
    with pytest.raises(ValueError, match="'offset' must be a finite number"):
        Checked({"offset": value}, {}).number("offset")


def test_there_are_gadgets_of_every_estimator():
    assert {estimator for estimator, _, _ in GADGETS.values()} >= set(known_estimators()) - {
        "copod"
    }
    assert len(GADGETS) >= 12


def test_a_forged_model_that_breaks_no_rule_is_read(trained, tmp_path, examples):
    for name, folder in trained.items():
        again = load_model(forge(folder, tmp_path / name, lambda about, arrays: None)).detector
        np.testing.assert_array_equal(
            again.confidence(examples.features),
            load_model(folder).detector.confidence(examples.features),
        )


@pytest.mark.parametrize(
    "words", [{"detector": None}, {"detector": {"estimator": "fisher", "features": ["a"]}}]
)
def test_arrays_that_the_words_do_not_name_are_refused(trained, tmp_path, words):
    folder = forge(trained["svm"], tmp_path / "model", lambda about, arrays: about.update(words))
    with pytest.raises(ValueError, match=r"does not name|cannot be read|is missing"):
        load_model(folder)


def test_detection_with_a_gadget_ends_with_its_reason(trained, tmp_path):
    marker = tmp_path / "marker"
    folder = forge(
        trained["svm"], tmp_path / "model", lambda about, arrays: old_archive(about, arrays, marker)
    )
    ran = CliRunner().invoke(
        app,
        [
            "detect",
            str(sample_lane() / "run.zarr"),
            "--recipe",
            "miniature",
            "--model",
            str(folder),
            "-o",
            str(tmp_path / "out"),
            "--quiet",
        ],
    )
    assert ran.exit_code == 2
    assert "train it again" in ran.output
    assert not marker.exists()
    assert not (tmp_path / "out").exists()


def test_replay_of_a_result_with_a_gadget_ends_with_its_reason(demo, tmp_path):
    folder = tmp_path / "result"
    shutil.copytree(demo[0].folder, folder)
    marker = tmp_path / "marker"
    (folder / "model").mkdir()
    write_bundle(folder / "model" / MODEL_FILE, {}, {"format": "flgpr-model", "version": 1})
    gadget = {"format": "flgpr-model", "version": 1, "flgpr": "0", "stages": [], "notes": {}}
    arrays: dict = {}
    about = gadget | {"detector": None}
    old_archive(about, arrays, marker)
    write_bundle(folder / "model" / MODEL_FILE, arrays, about)
    manifest = parse_with_digest((folder / "manifest.json").read_bytes())
    content = {name: value for name, value in manifest.items() if name != "sha256"}
    content["files"][f"model/{MODEL_FILE}"] = sha256((folder / "model" / MODEL_FILE).read_bytes())
    (folder / "manifest.json").write_bytes(json_with_digest(content))
    ran = CliRunner().invoke(app, ["replay", str(folder), "--quiet"])
    assert ran.exit_code == 2
    assert "train it again" in ran.output
    assert not marker.exists()


def test_info_tells_what_a_model_holds_without_loading_it(trained, tmp_path, monkeypatch):
    folder = forge(
        trained["random-forest"], tmp_path / "model",
        lambda about, arrays: about["notes"].update({"\x1b[31mred": "\x1b]0;title\x07", "long": "x" * 500}),
    )  # fmt: skip
    monkeypatch.setattr(Bundle, "__getitem__", lambda *_: pytest.fail("an array was read"))
    ran = CliRunner().invoke(app, ["info", str(folder)])
    assert ran.exit_code == 0, ran.output
    for told in (
        "random-forest",
        "flgpr-model version 1",
        '["a", "b"]',
        "detector.left",
        '"hits": 20',
    ):
        assert told in ran.output
    assert "\x1b" not in ran.output
    assert "\x07" not in ran.output
    assert max(map(len, ran.output.splitlines())) < 250
    held = json.loads(CliRunner().invoke(app, ["info", str(folder), "--json"]).stdout)
    assert {one["name"] for one in held["arrays"]} >= {"detector.first", "detector.value"}
    assert model_info(folder)["bytes"] == sum(one["bytes"] for one in held["arrays"])


def test_info_refuses_what_is_no_model(demo, tmp_path):
    ran = CliRunner().invoke(app, ["info", str(demo[0].folder)])
    assert ran.exit_code == 2
    assert "without a model" in ran.output
    (tmp_path / MODEL_FILE).write_bytes(b"5 x\n[[[[[")
    ran = CliRunner().invoke(app, ["info", str(tmp_path)])
    assert ran.exit_code == 2
    assert "not a whole file of arrays" in ran.output


def test_the_same_training_gives_the_same_bytes(examples, trained, tmp_path):
    for name in ("random-forest", "isolation-forest", "svm", "mixture", "gradient-boosting"):
        table = DetectorTable(
            estimator=name,
            features=COLUMNS,
            on=ONE_CLASS.get(name, "all"),
            options=OPTIONS.get(name, {}),
        )
        again = save_model(
            Model(train_estimator(replace(examples), table, COLUMNS)), tmp_path / name
        )
        assert (again / MODEL_FILE).read_bytes() == (trained[name] / MODEL_FILE).read_bytes()

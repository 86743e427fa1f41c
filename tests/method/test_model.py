"""Models on the disk: what is written is read, and anything else is refused."""

import json

import numpy as np
import pytest

from flgpr.method.model import (
    MODEL_FILE,
    Model,
    as_model,
    check_free_model,
    describe_model,
    load_model,
    parse_model,
    read_model,
    save_model,
    unlearnt,
)
from flgpr.recipe.schema import load_recipe
from flgpr.store import Bundle, sha256, write_bundle

STAGES = {
    "map.deflection": {"constant": np.arange(3.0)},
    "screen.clusters": {"amplitude": np.ones((2, 1)), "size": np.zeros((2, 1))},
}


@pytest.fixture
def folder(tmp_path):
    return save_model(Model(stages=STAGES, notes={"looks": 3}), tmp_path / "model", {"recipe": "r"})


def test_what_is_written_is_read(folder):
    model = load_model(folder, sha256(read_model(folder)))
    assert model.notes == {"looks": 3, "recipe": "r"}
    assert model.detector is None
    assert list(model.stages) == list(STAGES)
    for name, arrays in STAGES.items():
        assert model.stages[name].keys() == arrays.keys()
        for key, array in arrays.items():
            np.testing.assert_array_equal(model.stages[name][key], array)


def test_bytes_that_were_read_are_parsed_without_the_file(folder, tmp_path):
    data = read_model(folder)
    assert list(parse_model(data, tmp_path / "gone").stages) == list(STAGES)
    with pytest.raises(ValueError, match=r"model .*gone: "):
        parse_model(data[:-1], tmp_path / "gone")


def test_a_description_reads_the_head_alone(folder):
    about = describe_model(folder)
    assert about["path"] == str(folder / MODEL_FILE)
    assert about["stages"] == list(STAGES)
    assert [row["name"] for row in about["arrays"]] == [
        "map.deflection.constant",
        "screen.clusters.amplitude",
        "screen.clusters.size",
    ]
    assert about["bytes"] == sum(row["bytes"] for row in about["arrays"]) == 3 * 8 + 4 * 8


def test_a_model_replaces_a_model_and_nothing_else(folder, tmp_path):
    save_model(Model(), folder)
    assert load_model(folder).stages == {}
    other = tmp_path / "letters"
    other.mkdir()
    (other / "letter.txt").write_text("dear reader")
    with pytest.raises(FileExistsError):
        save_model(Model(), other)
    assert check_free_model(tmp_path / "new") == tmp_path / "new"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "letters"}, "format must be flgpr-model version 1"),
        ({"version": 2}, "format must be flgpr-model version 1"),
        ({"stages": ["a", "a"]}, "stages must be a list of different names"),
        ({"stages": ["detector"]}, "stages must be a list of different names"),
        ({"stages": [1]}, "stages must be a list of different names"),
    ],
)
def test_a_head_that_breaks_a_rule_is_refused(folder, change, message):
    bundle = Bundle(folder / MODEL_FILE)
    arrays = {name: np.array(bundle[name]) for name in bundle}
    head = json.loads(json.dumps(dict(bundle.about))) | change
    write_bundle(folder / MODEL_FILE, arrays, head)
    with pytest.raises(ValueError, match=message):
        load_model(folder)


def test_arrays_of_a_detector_that_is_not_named_are_refused(folder):
    bundle = Bundle(folder / MODEL_FILE)
    write_bundle(folder / MODEL_FILE, {"detector.direction": np.ones(2)}, dict(bundle.about))
    with pytest.raises(ValueError, match="holds 1 arrays of a detector that it does not name"):
        load_model(folder)


def test_a_folder_without_a_model_and_another_digest_are_refused(folder, tmp_path):
    with pytest.raises(ValueError, match=r"not a whole model: .* is missing"):
        load_model(tmp_path)
    with pytest.raises(ValueError, match=f"{MODEL_FILE} is missing"):
        describe_model(tmp_path)
    with pytest.raises(ValueError, match="differs from what was written"):
        load_model(folder, "0" * 64)


def test_stages_that_have_not_learnt_yet_are_named_and_refused_but_for_training():
    recipe = load_recipe("flsar2004")
    names = unlearnt(recipe, Model(), training=True)
    assert names == recipe.learning()
    with pytest.raises(ValueError, match=r"learns \(.*\) and needs a model: make one with `flgpr"):
        unlearnt(recipe, Model())
    learnt = Model(stages={name: {} for name in names})
    assert unlearnt(recipe, learnt) == []
    assert as_model(learnt) is learnt
    assert as_model(None) == Model()

"""Flip a bit of every file of a store, a result or a model in turn, cut it, delete it: always an error."""

import json
import shutil

import numpy as np
import pytest

import flgpr
from flgpr.commands.replay import replay
from flgpr.detect import HistogramNormalizer
from flgpr.detect.fisher import FisherDiscriminant
from flgpr.detect.linear_quadratic import LinearQuadraticForm
from flgpr.method.classifier import Classifier
from flgpr.method.model import MODEL_FILE, Model, load_model, save_model
from flgpr.results import result as result_module
from flgpr.results.manifest import ResultError
from flgpr.results.result import add_files, read_result
from flgpr.stages.forms import learnt_of
from flgpr.store import Bundle, json_with_digest, open_run, save_run, write_bundle
from flgpr.viewer.session import open_source
from robust import digests
from small_results import small_result


def small_classifier():
    rng = np.random.default_rng(1)
    values = rng.normal(size=(40, 2))
    label = np.arange(40) % 2
    normalizer = HistogramNormalizer().fit(values)
    discriminant = FisherDiscriminant().fit(normalizer.transform(values + label[:, None]), label)
    return Classifier(("C_HH_F1", "M_VV_F1"), normalizer, discriminant, {"lanes": ["a"]})


def learnt_stage(folder):
    rng = np.random.default_rng(2)
    form = LinearQuadraticForm(
        constant=0.5,
        strength=rng.normal(size=2),
        vectors=rng.normal(size=(2, 6)),
        linear=rng.normal(size=6),
        offset=rng.normal(size=2),
    )
    return save_model(
        Model(stages={"map.deflection": learnt_of([form], rng.normal(size=(9, 6)))}), folder
    )


def make_store(folder, run):
    return save_run(run, folder)


def make_result(folder, run):
    small_result(folder, small_classifier())
    add_files(folder, {"report.html": "<p>page</p>", "roc.json": "{}"})
    return folder


def view(folder):
    source = open_source(folder)
    source.index_bytes()
    for layer, one in enumerate(source.index["layers"]):
        for level in range(len(one["levels"])):
            source.tile(layer, level, 0)


CASES = {
    "store": (make_store, lambda folder: open_run(folder).load()),
    "result": (make_result, lambda folder: read_result(folder)),
    "model": (lambda folder, run: save_model(small_classifier(), folder), load_model),
    "learnt stage": (lambda folder, run: learnt_stage(folder), load_model),
}


@pytest.mark.parametrize("kind", CASES)
def test_every_damage_to_every_file_is_an_error(kind, small_run, tmp_path):
    make, read = CASES[kind]
    folder = make(tmp_path / "it", small_run)
    read(folder)
    names = sorted(digests(folder))
    assert names
    rng = np.random.default_rng(5)
    for name in names:
        path = folder / name
        whole = (folder / name).read_bytes()
        damages = [whole[: len(whole) // 2], whole + b" ", b"", None]
        for at in rng.integers(0, max(len(whole), 1), 4):
            flipped = bytearray(whole or b"\0")
            flipped[at] ^= 1 << int(rng.integers(8))
            damages.append(bytes(flipped))
        for damage in damages:
            if damage == whole:
                continue
            path.unlink()
            if damage is not None:
                path.write_bytes(damage)
            with pytest.raises((ValueError, FileNotFoundError)):
                read(folder)
            path.write_bytes(whole)
    read(folder)


@pytest.mark.parametrize("sealed", [True, False])
def test_other_versions_are_refused(sealed, tmp_path):
    folder = make_result(tmp_path / "it", None)
    content = json.loads((folder / "manifest.json").read_bytes()) | {"version": 99}
    del content["sha256"]
    (folder / "manifest.json").write_bytes(
        json_with_digest(content) if sealed else json.dumps(content).encode()
    )
    with pytest.raises(ValueError, match=r"must be .* version \d" if sealed else "is altered"):
        read_result(folder)


def test_models_of_other_versions_are_refused(tmp_path):
    path = save_model(small_classifier(), tmp_path / "model") / MODEL_FILE
    bundle = Bundle(path)
    write_bundle(path, dict(bundle), bundle.about | {"version": 99})
    with pytest.raises(ValueError, match=r"must be .* version \d"):
        load_model(path.parent)


def test_the_viewer_shows_nothing_that_was_altered(tmp_path):
    folder = make_result(tmp_path / "it", None)
    view(folder)
    for name in sorted(
        name for name in digests(folder) if name.startswith("view/") or name == "manifest.json"
    ):
        path = folder / name
        whole = (folder / name).read_bytes()
        if not whole or "evidence" in name:
            continue
        path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
        with pytest.raises(ValueError, match=r"differs|cannot be read|not a result"):
            view(folder)
        path.write_bytes(whole)


def test_a_result_can_be_read_whenever_adding_files_stops(tmp_path, monkeypatch):
    """The report is replaced by another; the stop comes before and within every write."""
    folder = make_result(tmp_path / "it", None)
    kept = tmp_path / "kept"
    shutil.copytree(folder, kept)
    write = result_module.write_whole
    stop = [0]

    def stopping(path, data):
        if not stop[0]:
            raise KeyboardInterrupt
        stop[0] -= 1
        write(path, data)

    monkeypatch.setattr(result_module, "write_whole", stopping)
    for writes in range(5):
        stop[0] = writes
        try:
            add_files(folder, {"report.html": "<p>new</p>", "view/score.json": b"{}"})
        except KeyboardInterrupt:
            assert writes < 4
        else:
            assert writes == 4
        assert read_result(folder).manifest["identity"] == read_result(kept).manifest["identity"]
        if writes < 4:
            shutil.rmtree(folder)
            shutil.copytree(kept, folder)
    assert (folder / "report.html").read_text() == "<p>new</p>"
    (folder / "report.html").write_text("<p>page</p>")
    with pytest.raises(ResultError, match=r"report\.html differs"):
        read_result(folder)


@pytest.mark.slow("runs a whole command more than once")
def test_replay_uses_the_model_of_the_result(lane, tmp_path):

    model = save_model(small_classifier(), tmp_path / "model")
    result = flgpr.detect(
        *lane.arguments, tmp_path / "result", lane.area, model=model, report=False
    )
    shutil.rmtree(model)
    assert result.model().detector.notes == {"lanes": ["a"]}
    told = replay(result.folder)
    assert told == {"identical": True, "agrees": True, "files": [], "difference": 0.0}

"""Tables of signatures are made in pieces, on several processes, and resume."""

import json
from hashlib import sha256
from pathlib import Path

import pytest

from flgpr import system
from flgpr.simulate.bodies.signature import packaged_bodies
from flgpr.simulate.bodies.signature import table as nodes
from flgpr.simulate.bodies.signature.body import Body
from flgpr_ground.signatures import build
from flgpr_ground.signatures.build import build_table

TINY = Body(name="tiny", layers=[{"thickness": 0.02, "zones": ((0.03, 2.0),)}])


@pytest.fixture
def few(monkeypatch):
    """Two soils, two tones, two depths."""
    monkeypatch.setattr(nodes, "PERMITTIVITY", nodes.PERMITTIVITY[:2])
    monkeypatch.setattr(nodes, "LOSS", nodes.LOSS[:2])
    monkeypatch.setattr(nodes, "FREQUENCY", nodes.FREQUENCY[:2])
    monkeypatch.setattr(nodes, "DEPTH", nodes.DEPTH[-2:])
    monkeypatch.setattr(system, "start_method", lambda: "fork")  # processes have these nodes, too


@pytest.mark.slow("is killed, and begins again, several times")
@pytest.mark.usefixtures("few")
def test_a_table_that_was_stopped_goes_on_and_gives_the_same_bits(tmp_path, monkeypatch):
    whole = build_table(TINY, tmp_path / "whole")
    assert whole.values.shape == (2, 2, 2, 1, 6, 3, 4)

    def stop(done, count):
        assert count == 4
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build_table(TINY, tmp_path / "part", progress=stop)
    solved = []
    told = []
    solve = build.solve_piece
    monkeypatch.setattr(
        build, "solve_piece", lambda *piece: solved.append(piece[1:]) or solve(*piece)
    )
    went_on = build_table(TINY, tmp_path / "part", progress=lambda *at: told.append(at))
    assert len(set(solved)) == len(solved) == 2
    assert told == [(3, 4), (4, 4)]
    assert went_on.values.tobytes() == whole.values.tobytes()
    build_table(TINY, tmp_path / "part")
    assert len(solved) == 2
    build_table(TINY.model_copy(update={"name": "another"}), tmp_path / "part")
    assert len(solved) == 6  # of another body it starts anew


@pytest.mark.slow("runs in processes of its own")
@pytest.mark.usefixtures("few")
def test_two_workers_give_the_same_bits(tmp_path):
    one = build_table(TINY, tmp_path / "one")
    two = build_table(TINY, tmp_path / "two", workers=2)
    assert two.values.tobytes() == one.values.tobytes()


@pytest.mark.usefixtures("few")
def test_an_interrupt_does_not_wait_for_pieces_that_have_not_begun(tmp_path, monkeypatch):
    monkeypatch.setattr(nodes, "FREQUENCY", nodes.FREQUENCY.repeat(6))

    def stop(done, count):
        assert count == 24
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build_table(TINY, tmp_path, workers=2, progress=stop)
    assert 1 <= len(list(tmp_path.glob("*/*.npy"))) < 24


def test_a_box_with_metal_is_refused(tmp_path):
    box = Body(name="tin", shape="box", layers=[{"thickness": 0.02, "zones": ((0.03, "metal"),)}])
    with pytest.raises(ValueError, match="body tin: a box must be without metal"):
        build_table(box, tmp_path)


def test_the_manifest_lists_every_table_with_its_digest():
    folder = Path(nodes.__file__).parent / "tables"
    listed = json.loads((folder / "manifest.json").read_text())["files"]
    assert (
        set(listed)
        == {f"{name}.npz" for name in packaged_bodies()}
        == {p.name for p in folder.glob("*.npz")}
    )
    for name, entry in listed.items():
        data = (folder / name).read_bytes()
        assert entry == {"bytes": len(data), "sha256": sha256(data).hexdigest()}
    assert sum(entry["bytes"] for entry in listed.values()) < 10e6

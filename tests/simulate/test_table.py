"""Tables of signatures: kept, read between their nodes, made in pieces, and named by scenes."""

from functools import partial
from hashlib import sha256

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate.bodies.signature import packaged_table
from flgpr.simulate.bodies.signature import table as nodes
from flgpr.simulate.bodies.signature.body import Body
from flgpr.simulate.bodies.signature.table import SignatureTable, load_table, save_table
from flgpr.simulate.bodies.targets import node_weights
from flgpr_ground.signatures.build import cells_for
from flgpr_ground.signatures.dipoles import Waves, scattering_amplitudes, solve_box
from flgpr_ground.signatures.revolution import solve_round
from simulate.lattices import sample_round

SHAPE = (
    nodes.PERMITTIVITY.size,
    nodes.FREQUENCY.size,
    nodes.DEPTH.size,
    1,
    nodes.SINE.size,
    nodes.SEPARATION.size,
    4,
)
TINY = Body(name="tiny", layers=[{"thickness": 0.02, "zones": ((0.03, 2.0),)}])


def soil_of(node):
    """Permittivity at a node, the same at all tones."""
    eps = nodes.PERMITTIVITY[node] * (1 - 1j * nodes.LOSS[node])
    return np.full(nodes.FREQUENCY.size, eps)


def test_a_file_keeps_a_table_to_a_thousandth(tmp_path):
    table = packaged_table("plastic-at")
    path = tmp_path / "mine.npz"
    digest = save_table(table, path)
    back = load_table(path)
    assert back.body == table.body
    scale = np.abs(table.values).max(axis=(2, 3, 4, 5, 6), keepdims=True)
    assert (np.abs(back.values - table.values) / scale).max() < 1e-3
    assert (
        digest == sha256(path.read_bytes()).hexdigest() == save_table(table, tmp_path / "again.npz")
    )


def test_a_table_of_very_weak_and_very_strong_tones_loses_neither(tmp_path):
    rng = np.random.default_rng(0)
    size = SHAPE
    levels = 10.0 ** rng.uniform(-9, 3, size[:2]).reshape(*size[:2], 1, 1, 1, 1, 1)
    values = levels * (rng.normal(size=size) + 1j * rng.normal(size=size))
    save_table(SignatureTable(TINY, values.astype(np.complex64)), tmp_path / "t.npz")
    back = load_table(tmp_path / "t.npz").values
    assert (
        np.abs(back - values) / np.abs(values).max(axis=(2, 3, 4, 5, 6), keepdims=True)
    ).max() < 1e-3


@pytest.mark.parametrize("damage", ["cut", "flipped", "text", "foreign", "missing"])
def test_a_damaged_or_foreign_file_is_named(tmp_path, damage):
    path = tmp_path / "broken.npz"
    save_table(SignatureTable(TINY, np.ones(SHAPE, np.complex64)), path)
    data = path.read_bytes()
    if damage == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif damage == "flipped":
        middle = len(data) // 2
        path.write_bytes(
            data[:middle] + bytes(255 - b for b in data[middle : middle + 64]) + data[middle + 64 :]
        )
    elif damage == "text":
        path.write_text("nothing of the kind")
    elif damage == "foreign":
        np.savez(path, other=np.ones(3))
    else:
        path.unlink()
    with pytest.raises(ValueError, match=r"broken.npz"):
        load_table(path)


def test_a_table_made_for_other_nodes_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "old.npz"
    with monkeypatch.context() as patched:
        patched.setattr(nodes, "DEPTH", nodes.DEPTH + 0.001)
        save_table(SignatureTable(TINY, np.ones(SHAPE, np.complex64)), path)
    with pytest.raises(ValueError, match=r"old.npz: made for other nodes"):
        load_table(path)


@pytest.mark.parametrize("name", ["metal-at", "plastic-at", "vs-2.2-hollow"])
@pytest.mark.parametrize(("soil", "depth"), [(0, 0), (1, 3), (4, 6)])
def test_a_table_gives_back_its_nodes(name, soil, depth):
    table = packaged_table(name)
    got = table.at(nodes.FREQUENCY, soil_of(soil), float(nodes.DEPTH[depth]))
    want = np.moveaxis(table.values[soil, :, depth], 0, -1)
    np.testing.assert_allclose(got, want, atol=1e-5 * np.abs(want).max())


def test_below_its_tones_a_table_falls_with_the_square_and_above_it_stays():
    table = packaged_table("plastic-at")
    depth = 0.05
    f = np.array([0.15e9, 0.3e9, 3.225e9, 3.4e9])
    got = np.abs(table.at(f, np.full(4, 3.1 - 0.06j), depth)[..., :2, :])
    np.testing.assert_allclose(got[..., 0], got[..., 1] / 4, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(got[..., 3], got[..., 2], rtol=1e-4, atol=1e-9)


def test_what_the_surface_adds_fades_with_depth():
    table = packaged_table("metal-at")
    f = nodes.FREQUENCY
    deep = table.at(f, soil_of(1), 1e4)
    added = [np.linalg.norm(table.at(f, soil_of(1), d) - deep) for d in (0.05, 0.15, 0.3, 0.6)]
    assert added[0] > added[1]
    np.testing.assert_allclose(
        np.divide(added[1:-1], added[2:]), 2, rtol=1e-3
    )  # below the last node as 1/d


BETWEEN = np.array([0.75, 0.9, 0.965])  # sines that are not nodes


@pytest.mark.slow("solves fields on fine grids")
@pytest.mark.parametrize(
    ("name", "limit"), [("metal-at", 0.15), ("plastic-at", 0.15), ("vs-2.2-hollow", 0.15)]
)
@pytest.mark.parametrize(("frequency", "soil"), [(1.0e9, 3.4 - 0.04j), (0.71e9, 4.9 - 0.18j)])
def test_between_its_nodes_a_table_is_what_solving_there_gives(name, limit, frequency, soil):
    """Tone, soil, loss, depth, sine and azimuth all off their nodes."""
    apart = np.radians(8.0)
    depth = 0.037
    body = packaged_table(name).body
    cells = cells_for(frequency, soil.real)
    want = solve_round(body, frequency, soil, BETWEEN, np.array([apart]), np.array([depth]), cells)[
        0, :, 0
    ]
    found = packaged_table(name).at(np.array([frequency]), np.array([soil]), depth)[..., 0]
    weight = node_weights(BETWEEN, np.full(3, apart), np.zeros(3), np.zeros(1))
    even = np.einsum("aspn,aspc->nc", weight[..., 0, :], found)
    odd = np.einsum("aspn,aspc->nc", weight[..., 2, :], found)
    got = np.concatenate([even[:, :3], odd[:, 3:]], axis=1)
    assert np.abs(got - want).max() < limit * np.abs(want).max()
    level = 20 * np.log10(np.linalg.norm(got[:, :2], axis=0) / np.linalg.norm(want[:, :2], axis=0))
    assert np.abs(level).max() < 1.5


@pytest.mark.parametrize("name", ["plastic-at-solid", "vs-2.2", "vs-2.2-hollow"])
@pytest.mark.parametrize("soil", [2, 6])
def test_deep_down_a_table_of_plastic_is_what_dipoles_on_a_lattice_give(name, soil):
    """The lattice's cells of 6 mm and its other solver leave a tenth of the amplitude."""
    table = packaged_table(name)
    tone = 6
    direction = 3
    eps = nodes.PERMITTIVITY[soil] * (1 - 1j * nodes.LOSS[soil])
    wavenumber = 2 * np.pi * float(nodes.FREQUENCY[tone]) / SPEED_OF_LIGHT
    waves = Waves(np.array([wavenumber * nodes.SINE[direction]]), np.zeros(1))
    lattice = sample_round(table.body, 0.006, eps)
    with threadpool_limits(1):
        amplitudes = scattering_amplitudes(lattice, eps, wavenumber, waves)[:, 0, :, 0]
    want = table.values[soil, tone, -1, 0, direction, 0, :2]
    assert np.abs(np.diag(amplitudes) - want).max() < 0.15 * np.abs(want).max()


def test_without_a_surface_a_table_gives_its_deepest_node():
    table = packaged_table("metal-at")
    deep = table.at(nodes.FREQUENCY, soil_of(1), np.inf)
    np.testing.assert_allclose(
        deep, table.at(nodes.FREQUENCY, soil_of(1), 1e6), atol=1e-6 * np.abs(deep).max()
    )


def test_swapping_the_antennas_swaps_hv_and_vh():
    table = packaged_table("metal-at").at(np.array([1e9]), np.array([3.4 - 0.04j]), 0.05)[..., 0]
    sine = np.full(2, 0.9)
    apart = np.array([0.3, -0.3])
    weight = node_weights(sine, apart, np.zeros(2), np.zeros(1))
    even = np.einsum("aspn,aspc->nc", weight[..., 0, :], table)
    odd = np.einsum("aspn,aspc->nc", weight[..., 2, :], table)
    there, back = ((even[n, 2] + odd[n, 3], even[n, 2] - odd[n, 3]) for n in range(2))
    assert abs(there[0]) > 1e-4
    np.testing.assert_allclose(there, back[::-1], rtol=1e-12)
    np.testing.assert_allclose(even[0, :2], even[1, :2], rtol=1e-12)


BRICK = {"thickness": 0.03, "zones": ((0.04, 2.0),)}


@pytest.mark.parametrize(("elongation", "count"), [(1.0, 4), (1.6, 7)])
def test_all_aspects_of_a_box_come_from_an_eighth_or_a_quarter_of_its_turn(elongation, count):
    """Between the nodes and behind every mirror, where (HV + VH)/2 changes its sign."""
    body = Body(name="brick", shape="box", elongation=elongation, layers=[BRICK])
    aspects = np.radians(np.linspace(0, 45 if elongation == 1 else 90, count))
    at = np.radians([20.0, -20.0, 110.0, 70.0, 200.0, 38.0])
    apart = np.radians(12.0)
    solve = partial(solve_box, body, 1.5e9, 4.0 - 0.1j, nodes.SINE)

    def channels(found):
        hh, hv, vh, vv = np.moveaxis(found, -1, 0)
        return np.stack([hh, vv, (hv + vh) / 2, (hv - vh) / 2], axis=-1)

    want = channels(solve(at, np.array([apart])))[3, :, 0]
    table = channels(solve(aspects, nodes.SEPARATION))  # (sine, aspect, separation, 4)
    weight = node_weights(np.full(at.size, nodes.SINE[3]), np.full(at.size, apart), at, aspects)
    rows = [0, 0, 1, 2]  # the weights of each channel
    got = np.stack(
        [np.einsum("aspn,sap->n", weight[..., rows[c], :], table[..., c]) for c in range(4)],
        axis=-1,
    )
    assert np.abs(want[:, 2]).max() > 0.02 * np.abs(want).max()
    np.testing.assert_allclose(got, want, atol=2e-3 * np.abs(want).max())

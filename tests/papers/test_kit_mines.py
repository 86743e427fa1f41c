"""Mixes of mines: their shares and bodies, how a lane's mines are dealt, and the air that a mine's mass leaves."""

import math
import re
from collections import Counter

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from flgpr.simulate import Scene
from flgpr.simulate.bodies.signature import load_body, packaged_bodies, packaged_table
from flgpr.simulate.bodies.signature import table as nodes
from flgpr.simulate.bodies.signature.body import Body
from flgpr_ground.signatures.build import cells_for
from flgpr_ground.signatures.revolution import solve_round
from flgpr_papers.kit.mines import MIXES, Mix, find_mix, mix_counts, mix_draws
from reading import ROOT, read

pytestmark = pytest.mark.slow("studies of papers")

PAGE = ROOT / "docs" / "evidence" / "mines.md"
MASSES = {  # kg and kg/l: mine with its charge, charge, density of the charge; as the page has them
    "vs-2.2": (3.5, 2.2, 1.65),
    "vs-1.6": (3.0, 1.85, 1.65),
    "m19": (12.56, 9.53, 1.65),
    "tm-62p": (11.0, 8.0, 1.6),
}
PLASTIC = 1.2  # kg/l
FILLED = (0.75, 0.8, 0.9, 0.95)  # of the cylinder or box


def make_body(*layers):
    """Body of (thickness, zones) layers."""
    return Body(
        name="mine",
        layers=[{"thickness": thickness, "zones": zones} for thickness, zones in layers],
    )


# Mines without a table of their own, which stand in the mixes as other bodies; m, as the page
# describes them.
M15 = make_body((0.025, ((0.11, "metal"),)), (0.125, ((0.1685, "metal"),)))
PLASTIC_FUZE = make_body((0.09, ((0.04, 1.8), (0.16, 2.9))), (0.038, ((0.16, 2.9),)))
HOLLOW_VS_1_6 = make_body((0.025, ((0.098, 1.0), (0.111, 2.9))), (0.067, ((0.111, 2.9),)))
TMA_4 = make_body((0.065, ((0.142, 2.9),)))
TAKEN_AS = [
    (M15, "tm-62m"),
    (PLASTIC_FUZE, "plastic-at-solid"),
    (HOLLOW_VS_1_6, "plastic-at"),
    (TMA_4, "plastic-at-solid"),
]


def volume(body, medium=None):
    """Volume of a body, or of a medium in it, litres."""
    area = math.pi if body.shape == "round" else 4 * body.elongation
    total = 0.0
    for layer in body.layers:
        inner = 0.0
        for width, eps in layer.zones:
            if medium is None or eps == medium:
                total += area * (width**2 - inner**2) * layer.thickness
            inner = width
    return 1000 * total


def air_by_mass(name, filled):
    """Volume that neither charge nor plastic fills, litres."""
    mass, charge, density = MASSES[name]
    return filled * volume(load_body(name)) - charge / density - (mass - charge) / PLASTIC


def rows_of_page(heading, place=0):
    """Rows of a table under a heading of the page."""
    part = read(PAGE).split(f"## {heading}\n")[1].split("\n## ")[0]
    lines = re.findall(r"(?:^\|.*\n)+", part + "\n", re.MULTILINE)[place].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


@pytest.mark.parametrize("name", MIXES)
def test_a_mix_s_shares_sum_to_one_over_packaged_bodies_with_a_source(name):
    mix = MIXES[name]
    assert sum(mix.shares.values()) == 1
    assert mix.about
    assert set(mix.parts) <= set(packaged_bodies())
    for body in mix.parts:
        assert load_body(body).source
        assert load_body(body).metal == (mix.kind == "metal" or body == "tm-62p")


def test_there_are_the_kinds_and_two_alternatives_to_plastic():
    kinds = Counter(mix.kind for mix in MIXES.values())
    assert kinds == {"metal": 1, "plastic": 3, "simulant": 1}
    assert {"metal", "plastic", "simulant"} <= set(MIXES)
    assert "tm-62p" not in MIXES["plastic-minimum-metal"].parts


def test_mines_are_dealt_by_the_largest_remainder_and_the_first_wins_a_tie():
    assert mix_counts("metal", 3) == {"tm-62m": 2, "metal-at": 1}
    assert mix_counts("metal", 2) == {"tm-62m": 1, "metal-at": 1}
    assert mix_counts("metal", 1) == {"tm-62m": 1}
    assert mix_counts("plastic-large-gap", 5) == {
        "plastic-at": 2,
        "plastic-at-cavity": 2,
        "vs-2.2-hollow": 1,
    }
    assert mix_counts("plastic", 0) == {}


@pytest.mark.parametrize("name", MIXES)
@pytest.mark.parametrize("count", [1, 7, 10, 43])
def test_no_body_is_a_mine_or_more_off_its_share(name, count):
    counts = mix_counts(name, count)
    assert sum(counts.values()) == count
    for body, share in MIXES[name].shares.items():
        assert abs(counts.get(body, 0) - share * count) < 1


def test_draws_make_a_scene_with_the_kind_and_entries_asked_for():
    draws = mix_draws("plastic", 0.075, 10, tilt=0.02)
    assert draws == mix_draws("plastic", 0.075, 10, tilt=0.02)
    scene = Scene(length=100.0, draws=draws)
    assert sum(draw.count for draw in scene.draws) == 10
    assert {(draw.kind, draw.depth, draw.tilt) for draw in scene.draws} == {
        ("plastic", 0.075, 0.02)
    }
    assert {draw.body: draw.count for draw in scene.draws} == mix_counts("plastic", 10)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: find_mix("plastics"),
            r"mix must be one of metal, plastic, .*simulant, got 'plastics'",
        ),
        (lambda: mix_draws("wood", 0.1, 0), r"mix must be one of .*, got 'wood'"),
        (lambda: mix_draws("metal", 0.1, -1), r"count must not be negative, got -1"),
        (
            lambda: Mix("none", "metal", "nothing", {}),
            r"mix none: parts must be whole numbers above 0, at least one",
        ),
        (
            lambda: Mix("half", "metal", "", {"m19": 0.5}),
            r"mix half: parts must be whole numbers above 0.*0\.5",
        ),
    ],
)
def test_bad_input_is_told(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_the_page_has_every_mix_as_it_is_declared():
    listed = {}
    for name, kind, parts, _ in rows_of_page("Mixes"):
        found = {body: int(part) for body, part in re.findall(r"`([\w.-]+)` (\d+)", parts)}
        listed[name.strip("`")] = (kind, found)
    assert listed == {name: (mix.kind, mix.parts) for name, mix in MIXES.items()}


def test_the_page_s_air_is_what_the_masses_leave():
    rows = rows_of_page("Air inside the mines")
    assert [row[0].lower() for row in rows] == list(MASSES)
    for row, (name, (mass, charge, density)) in zip(rows, MASSES.items(), strict=True):
        assert row[1] == f"{mass}, {charge}"
        assert float(row[2]) == pytest.approx(volume(load_body(name)), abs=0.006)
        filled = [float(value) for value in row[3].split(", ")]
        assert filled == pytest.approx([charge / density, (mass - charge) / PLASTIC], abs=0.006)
        left = [0.0 if value == "none" else float(value) for value in row[4].split(", ")]
        assert left == pytest.approx(
            [max(air_by_mass(name, part), 0.0) for part in FILLED], abs=0.006
        )
        for body, air in re.findall(r"`([\w.-]+)` ([\d.]+|none)", row[5]):
            assert volume(load_body(body), 1.0) == pytest.approx(
                0.0 if air == "none" else float(air), abs=0.006
            )


def test_the_page_s_levels_are_those_of_the_tables():
    """Mean power of HH and VV, in the soils of the columns; a box has no surface and many aspects."""
    rows = rows_of_page("Air inside the mines", 1)
    assert {row[0].strip("`") for row in rows} == set().union(
        *(mix.parts for mix in MIXES.values())
    )
    for row in rows:
        values = packaged_table(row[0].strip("`")).values
        for cell, soil in zip(row[1:], (2, 5), strict=True):
            part = values[soil, 6:15, min(4, values.shape[2] - 1), :, 2:5, 0, :2]
            level = 10 * np.log10(np.mean(np.abs(part) ** 2, axis=(0, 1, 2)))
            assert [float(value) for value in cell.split(", ")] == pytest.approx(
                level.tolist(), abs=0.06
            )


@pytest.mark.parametrize(
    ("name", "hollow"), [("vs-1.6", HOLLOW_VS_1_6), ("vs-2.2", load_body("vs-2.2-hollow"))]
)
def test_hollow_bodies_have_the_size_of_the_mine_and_the_air_its_mass_leaves(name, hollow):
    body = load_body(name)
    assert (hollow.radius, hollow.height) == pytest.approx((body.radius, body.height))
    assert volume(hollow, 1.0) == pytest.approx(air_by_mass(name, 0.8), rel=0.05)
    assert volume(body, 1.0) < air_by_mass(name, min(FILLED)) / 3


def test_the_tma_4_is_as_high_as_its_charge_and_no_higher_than_with_its_fuzes():
    charge = 5.5 / 1.56  # kg over kg/l
    assert 1.0 < volume(TMA_4) / charge < 1.25
    assert TMA_4.height < 0.11


@pytest.mark.slow("solves fields on fine grids")
@pytest.mark.parametrize(("mine", "body"), TAKEN_AS)
def test_a_mine_that_is_taken_as_another_body_scatters_nearly_as_much(mine, body):
    """Mean power of HH and of VV over the first subband, in soil of permittivity 3.5, 7 cm deep."""
    soil = 2
    depth = 4
    sines = slice(2, 5)
    eps = nodes.PERMITTIVITY[soil] * (1 - 1j * nodes.LOSS[soil])
    solved = []
    taken = []
    for tone in (6, 10, 14):
        frequency = float(nodes.FREQUENCY[tone])
        asked = (nodes.SINE[sines], nodes.SEPARATION[:1], nodes.DEPTH[depth : depth + 1])
        with threadpool_limits(1):
            found = solve_round(mine, frequency, eps, *asked, cells_for(frequency, eps.real))
        solved.append(found[0, :, 0, :2])
        taken.append(packaged_table(body).values[soil, tone, depth, 0, sines, 0, :2])
    power = [np.mean(np.abs(np.array(values)) ** 2, axis=(0, 1)) for values in (solved, taken)]
    assert np.abs(10 * np.log10(power[0] / power[1])).max() < 4

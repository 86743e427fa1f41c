"""The theory pages: every figure can be drawn, and the numbers in the text are what the functions give."""

import csv
import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from flgpr.features import cameron, entropy_alpha
from flgpr.model import SPEED_OF_LIGHT, load_sensor
from flgpr.model.refraction import (
    interface_path,
    two_way_attenuation,
    two_way_transmission,
)
from flgpr.scoring import clopper_pearson
from flgpr.simulate import Scene
from flgpr.simulate.ground.roughness import surface_backscatter
from flgpr.simulate.ground.soil import mironov, one_way_loss
from flgpr.trials import sample_size

pytestmark = pytest.mark.slow("checks of pages")

DOCS = Path(__file__).parents[2] / "docs"
THEORY = DOCS / "reference" / "theory"


def module_of_theory(name):
    spec = importlib.util.spec_from_file_location(f"theory_{name}", THEORY / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(THEORY)  # as where it is a script
        spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def figures():
    return module_of_theory("figures")


@pytest.fixture(scope="module")
def quantities():
    return module_of_theory("quantities")


def text(page):
    return re.sub(r"\s+", " ", (THEORY / f"{page}.md").read_text(encoding="utf-8"))


def table_row(page, start):
    """Numbers of the table row that begins with a text, in the order of its columns."""
    lines = (THEORY / f"{page}.md").read_text(encoding="utf-8").splitlines()
    (row,) = [line for line in lines if line.startswith(f"| {start}")]
    return [float(cell) for cell in re.findall(r"[-+]?\d+\.?\d*", row.removeprefix(f"| {start}"))]


@pytest.mark.slow("draws all figures of the theory")
@pytest.mark.parametrize(
    "name",
    [
        "geometry",
        "subbands",
        "refraction",
        "soils",
        "signatures",
        "roughness",
        "clutter",
        "polarimetry",
        "detectors",
        "scoring",
    ],
)
def test_figures_are_drawn_and_shown_on_a_page(name, figures, tmp_path, monkeypatch):
    sensor = load_sensor("sri-array")
    few = sensor.model_copy(update={"rx": sensor.rx[::6]})
    monkeypatch.setattr(figures, "load_sensor", {"sri-array": few}.__getitem__)
    assert name in {draw.__name__ for draw in figures.FIGURES}
    drawn = getattr(figures, name)()
    for axes in drawn.axes:
        for line in axes.lines:
            assert np.isfinite(np.asarray(line.get_ydata(), dtype=float)).any()
    drawn.savefig(tmp_path / "figure.png", dpi=30)
    pages = "".join(page.read_text(encoding="utf-8") for page in THEORY.glob("*.md"))
    assert f"theory-{name}.png" in pages
    assert (DOCS / "images" / f"theory-{name}.png").is_file()


def test_resolution_is_as_measured(quantities):
    told = table_row("geometry", "F1, 0.75-1.35 GHz")
    down, across, down_formula, across_formula = quantities.half_power_widths()
    np.testing.assert_allclose([100 * down, 100 * across], told, atol=0.6)
    assert "| by the formulas | 24 cm | 47 cm |" in text("geometry")
    np.testing.assert_allclose([100 * down_formula, 100 * across_formula], [24, 47], atol=0.6)
    wide = quantities.half_power_widths(band=(0.8e9, 2.8e9))
    assert 100 * wide[0] == pytest.approx(table_row("subbands", "F0 |")[-1], abs=0.6)


@pytest.mark.parametrize("epsilon", [3.4, 10.7])
def test_shifts_are_those_of_focused_points(epsilon, quantities):
    told = table_row("refraction", f"ε = {epsilon} |")
    found = [
        100 * quantities.focused_shift(0.10, epsilon, distance, 5.0)
        for distance in (7.0, 12.0, 26.0)
    ]
    np.testing.assert_allclose(found, told, atol=0.6)


def test_losses_at_the_surface_and_in_it():
    sine = 26 / np.hypot(26, 5)
    h, v = (20 * np.log10(np.abs(one)) for one in two_way_transmission(sine, 3.4))
    assert (h, v) == (pytest.approx(-8.3, abs=0.05), pytest.approx(-1.7, abs=0.05))
    assert "8.3 dB at 26 m" in text("refraction")
    assert "at most 1.7 dB" in text("refraction")
    variance = [
        (2 * np.pi * f / SPEED_OF_LIGHT * 0.007 * interface_path(np.sin(np.radians(67)), 3.4)) ** 2
        for f in (1.05e9, 9.4e9)
    ]
    assert variance == [pytest.approx(0.03, abs=0.005), pytest.approx(2.8, abs=0.05)]
    loss = [
        -20
        * np.log10(
            two_way_attenuation(0.1, 2 * np.pi * f / SPEED_OF_LIGHT, 12 / 13, mironov(f, 40, 0.25))
        )
        for f in (1.05e9, 2.55e9)
    ]
    assert loss[0] == pytest.approx(10, abs=0.5)
    assert loss[1] > 20


def test_soils_in_the_table():
    for start, clay, moisture in (
        ("dry sand | 3 %, 0.03 |", 3, 0.03),
        ("wet clay | 40 %, 0.25 |", 40, 0.25),
    ):
        real, imaginary, loss = table_row("soils", start)
        epsilon = complex(mironov(1.05e9, clay, moisture))
        assert epsilon.real == pytest.approx(real, rel=0.005)
        assert -epsilon.imag == pytest.approx(imaginary, abs=0.006)
        assert one_way_loss(1.05e9, epsilon) == pytest.approx(loss, abs=0.5)


@pytest.mark.parametrize(
    ("start", "body"),
    [
        ("metal |", "metal-at"),
        ("air gap |", "plastic-at"),
        ("cavity |", "plastic-at-cavity"),
        ("simulant |", "plastic-at-solid"),
    ],
)
def test_levels_of_bodies_are_those_of_their_tables(start, body, quantities):
    f = np.linspace(0.75e9, 1.35e9, 41)
    levels = [
        level
        for eps in (3.1 - 0.062j, 5.3 - 0.265j)
        for level in quantities.body_levels(body, f, eps)
    ]
    found = [10 * np.log10(np.mean(10 ** (level / 10))) for level in levels]
    np.testing.assert_allclose(found, table_row("signatures", start), atol=0.06)


def test_edges(quantities):
    levels = quantities.edge_levels(3.2, np.radians(67))
    assert table_row("signatures", "HH |") == pytest.approx(
        [levels["near H"], levels["far H"]], abs=0.06
    )
    assert table_row("signatures", "VV |") == pytest.approx(
        [levels["near V"], levels["far V"]], abs=0.06
    )


def test_backscatter_in_the_text():
    told = "-40 dB in HH and -32 dB in VV at 1.05 GHz, -35 and -27 dB at 2.55 GHz"
    assert told in text("clutter")
    found = [
        10
        * np.log10(
            surface_backscatter(
                f, np.sin(np.radians(67)), mironov(f, 3, 0.03), 0.005, 0.05, np.radians(5)
            )
        )
        for f in (1.05e9, 2.55e9)
    ]
    np.testing.assert_allclose(found, [[-40, -32], [-35, -27]], atol=0.5)


@pytest.mark.parametrize("site", ["arid-sand", "gravel"])
def test_backscatter_of_one_scale_and_of_tracks(site, quantities):
    """The table of the clutter's spectrum: four rows of arid sand and two of gravel, and the model fitted to soils."""
    table = THEORY.parent / "physics" / "surface-backscatter.csv"
    rows = list(csv.reader(table.read_text(encoding="utf-8").splitlines()))
    first = next(i for i, row in enumerate(rows) if row[0].startswith(f"{site}, one"))
    frequency = np.array([0.44, 0.60, 0.75, 1.05, 2.55]) * 1e9
    sine = np.sin(np.radians(67))
    surface = Scene(site=site).surface
    eps = Scene(site=site).soil.media(frequency)[-1]
    classes = (0, 256e-6, 1024e-6, 4096e-6) if site == "arid-sand" else (0, 1024e-6)
    known = (surface.rms_height, surface.correlation_length, surface.slope)
    wanted = [surface_backscatter(frequency, sine, eps, *known, uneven)[0] for uneven in classes]
    wanted.append(quantities.oh1992(frequency, sine, eps, surface.rms_height)[0])
    for row, want in zip(rows[first:], wanted, strict=False):
        told = [float(cell) for cell in row[1:]]
        level = 10 * np.log10(want)
        np.testing.assert_allclose(told[:5], level, atol=0.051)
        assert told[5] == pytest.approx(
            (level[2] - level[0]) / 10 / np.log10(0.75 / 0.44), abs=0.06
        )
    assert surface.unevenness == 1024e-6


@pytest.mark.parametrize(
    ("start", "channels"),
    [
        ("sphere, plane (1, 0, 1) |", (1, 0, 1)),
        ("cylinder (1, 0, ½) |", (1, 0, 0.5)),
        ("dipole (1, 0, 0) |", (1, 0, 0)),
        ("(1, 0, -½) |", (1, 0, -0.5)),
        ("dihedral (1, 0, -1) |", (1, 0, -1)),
        ("helix (1, j, -1) |", (1, 1j, -1)),
    ],
)
def test_pure_scatterers(start, channels):
    entropy, alpha = entropy_alpha(*(np.array([[one]]) for one in channels))
    tau, _ = cameron(*channels)
    found = [float(entropy[0, 0]), np.degrees(alpha[0, 0]), np.degrees(float(tau))]
    assert found == pytest.approx(table_row("polarimetry", start), abs=0.01)


def test_detectors_in_the_text(quantities):
    share = {}
    for name, (target, clutter) in quantities.detector_scores().items():
        share[name] = 100 * float(np.mean(target >= np.quantile(clutter, 0.99)))
    told = [
        int(one)
        for one in re.findall(r"(\d+) %", text("detectors").split("at 1 % of the clutter")[1])[:4]
    ]
    order = (
        "deflection, rank 3",
        "Neyman-Pearson, rank 3",
        "deflection, rank 1",
        "energy of the brightest sample",
    )
    assert [share[name] for name in order] == pytest.approx(told, abs=0.6)


def test_counts_in_the_text():
    lower = [round(float(clopper_pearson(n, n)[0]), 2) for n in (3, 12, 30)]
    assert lower == [0.29, 0.74, 0.88]
    assert all(str(one) in text("counting") for one in lower)
    plan = sample_size(0.9, 0.01, 0.95)
    assert (plan.mines, round(plan.area)) == (29, 300)

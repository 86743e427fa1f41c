"""Print the tables of docs/reference/sites.md: the packaged sites side by side.

With a folder as argument its figure, sites.png, is written there.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parent))
from common import markdown
from flgpr.simulate import Scene
from flgpr.simulate.ground.roughness import surface_backscatter, surface_heights
from flgpr.simulate.ground.soil import mironov, one_way_loss

PAIRS = {
    "arid-sand": "prepared-sand",
    "temperate": "prepared-earth",
    "gravel": "prepared-gravel",
    "wet-clay": "prepared-clay",
}
"""A prepared lane for every natural site."""
SITES = tuple(site for pair in PAIRS.items() for site in pair)
CLASSES = {16e-6: "A", 64e-6: "B", 256e-6: "C", 1024e-6: "D", 4096e-6: "E"}
"""Middles of the classes of ISO 8608, m³."""
COLOURS = dict(zip(PAIRS, ("#e69f00", "#009e73", "#666666", "#d55e00"), strict=True))
LEVEL = np.sin(np.radians(67.0))  # of incidence, about 12 m ahead of an array 5 m up
BANDS = (1.05e9, 2.55e9)  # Hz, the middles of F1 and F4


def number(value: float) -> str:
    """Write a value with at most three digits that count and no idle zeros."""
    return f"{value:.3g}" if value else "0"


def permittivity(scene: Scene, frequency: float) -> complex:
    """Return the complex permittivity of the soil below all layers."""
    return complex(scene.soil.media(np.array([frequency]))[-1].item())


def surfaces() -> str:
    """Tell the surface and the soil of every site."""
    rows = []
    for site in SITES:
        scene = Scene(site=site)
        surface = scene.surface
        eps = permittivity(scene, 1e9)
        rows.append(
            [
                site,
                number(1e3 * surface.rms_height),
                number(1e2 * surface.correlation_length),
                CLASSES[surface.unevenness],
                f"{1e3 * scene.terrain.undulation:.0f}, {1e3 * scene.terrain.rut_depth:.0f}",
                f"{eps.real:.1f}",
                f"{-eps.imag / eps.real:.3f}",
                f"{one_way_loss(1e9, eps):.0f}",
            ]
        )
    head = [
        "site",
        "rms height, mm",
        "correlation length, cm",
        "class",
        "undulation, ruts, mm",
        "ε'",
        "tan δ",
    ]
    return markdown([*head, "loss one way, dB/m"], rows)


def contents() -> str:
    """Tell what lies in, grows on and stands beside every site."""
    rows = []
    for site in SITES:
        scene = Scene(site=site)
        clutter = scene.clutter
        holes = scene.holes
        stones = scene.stones
        sizes = " to ".join(number(1e2 * radius) for radius in stones.radius)
        fill = " to ".join(number(share) for share in holes.looseness)
        rows.append(
            [
                site,
                f"{number(stones.density)}; {sizes}",
                number(clutter.rocks),
                number(scene.heterogeneity.deviation),
                f"{number(scene.roots.density)}, {number(scene.lenses.density)}",
                number(holes.empty),
                f"{fill}; {number(1e3 * holes.cap)}",
                f"{100 * scene.grass.height:.0f}",
                f"{number(clutter.bushes)}, {number(clutter.posts)}",
            ]
        )
    head = [
        "site",
        "stones per m²; radius, cm",
        "rocks per m²",
        "deviation of ε",
        "roots, lenses per m²",
    ]
    head += [
        "empty holes per m²",
        "density of the fill; cap, mm",
        "grass, cm",
        "bushes, posts per m",
    ]
    return markdown(head, rows)


def backscatter() -> str:
    """Tell σ⁰ of the surface of every site by the formula the simulator draws from."""
    rows = []
    for site in SITES:
        scene = Scene(site=site)
        cells = [site]
        for frequency in BANDS:
            for level in sigma(scene, frequency, LEVEL):
                cells.append(f"{level:.1f}")
        rows.append([*cells, number(scene.surface.cross_db)])
    return markdown(["site", "F1 HH", "F1 VV", "F4 HH", "F4 VV", "HV re HH"], rows)


def sigma(
    scene: Scene, frequency: float, sine: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return σ⁰ of HH and of VV, dB."""
    surface = scene.surface
    shape = (
        surface.rms_height,
        surface.correlation_length,
        surface.slope,
        surface.unevenness,
        surface.waviness,
    )
    hh, vv = surface_backscatter(frequency, sine, permittivity(scene, frequency), *shape)
    return 10 * np.log10(hh), 10 * np.log10(vv)


def hallikainen(sand: float, clay: float, moisture: float) -> tuple[float, float]:
    """Return ε' and tan δ at 1.4 GHz as fitted to measured soils (Hallikainen et al. 1985, Table II)."""
    real = 2.862 - 0.012 * sand + 0.001 * clay
    real += (3.803 + 0.462 * sand - 0.341 * clay) * moisture
    real += (119.006 - 0.500 * sand + 0.633 * clay) * moisture**2
    lost = 0.356 - 0.003 * sand - 0.008 * clay
    lost += (5.507 + 0.044 * sand - 0.002 * clay) * moisture
    lost += (17.753 - 0.313 * sand + 0.206 * clay) * moisture**2
    return real, lost / real


def losses() -> str:
    """Set loss tangents of the model against what was measured."""
    soils = (
        ("dry sand", 90, 3, 0.015, "0.006 to 0.01 dry, 0.03 with 2 %"),
        ("sand", 90, 3, 0.06, "0.03 to 0.05 with 4 %"),
        ("sandy loam", 65, 10, 0.12, "-"),
        ("loam", 40, 20, 0.2, "0.12 to 0.16 with 14 %"),
        ("clay", 20, 40, 0.28, "0.25 to 0.5 with 20 %"),
    )
    rows = []
    for name, sand, clay, moisture, hippel in soils:
        model = mironov(np.array([1e9]), clay, moisture).item()
        fitted = (
            "-" if sand > 70 else f"{hallikainen(sand, clay, moisture)[1]:.2f}"
        )  # its sandiest had 51.5 %
        rows.append(
            [
                name,
                f"{clay} %, {moisture:g}",
                f"{model.real:.1f}",
                f"{-model.imag / model.real:.3f}",
                fitted,
                hippel,
            ]
        )
    head = ["soil", "clay, moisture", "ε' of the model", "tan δ of the model, 1 GHz"]
    return markdown(
        [*head, "Hallikainen et al. 1985, 1.4 GHz", "von Hippel 1954, 0.3 to 3 GHz"], rows
    )


TABLES = (surfaces, contents, backscatter, losses)


def figure() -> Figure:
    """Draw a natural and a prepared surface, and σ⁰ of all sites over incidence."""
    drawn = Figure(figsize=(10, 3.9), layout="constrained")
    left, right = drawn.subplots(1, 2, width_ratios=(1.1, 1))
    along = np.linspace(0.0, 3.0, 1501)
    for (site, colour), shift in zip(
        (("temperate", "C7"), ("prepared-earth", "#009e73")), (20.0, -20.0), strict=True
    ):
        heights = surface_heights(Scene(site=site).surface, 4)(np.zeros(along.size), along)
        left.plot(along, 1e3 * (heights - heights.mean()) + shift, color=colour, lw=1, label=site)
    left.set(xlabel="along the lane, m", ylabel="height, mm (shifted)", title="drawn surfaces")
    left.legend(fontsize=8, loc="center right")
    left.grid(alpha=0.3)
    angle = np.radians(np.linspace(50, 80, 61))
    for natural, prepared in PAIRS.items():
        for site, style in ((natural, "--"), (prepared, "-")):
            hh, _ = sigma(Scene(site=site), BANDS[0], np.sin(angle))
            right.plot(np.degrees(angle), hh, style, color=COLOURS[natural], label=site)
    right.set(xlabel="incidence, degrees", ylabel="σ⁰ of HH, dB", title="backscatter at 1.05 GHz")
    right.legend(fontsize=7, ncols=2, loc="lower left")
    right.grid(alpha=0.3)
    return drawn


def main() -> None:
    for make in TABLES:
        print(make(), end="\n\n")
    if len(sys.argv) > 1:
        figure().savefig(Path(sys.argv[1]) / "sites.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()

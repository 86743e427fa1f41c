"""Draw the figures of the theory pages and write them to docs/images."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from quantities import (
    BANDS,
    body_levels,
    detector_scores,
    edge_levels,
    focused_shift,
    half_power_widths,
    mine_cuts,
    oh1992,
    roc_example,
    scan_images,
)

from flgpr.clutter import gain_background, remove_background, scan_gain, self_signature
from flgpr.detect import RelevanceVectorClassifier
from flgpr.features import entropy_alpha
from flgpr.features.polarimetry import entropy_alpha_of
from flgpr.model import SPEED_OF_LIGHT, load_sensor
from flgpr.model.refraction import (
    apparent_shift,
    interface_path,
    two_way_attenuation,
    two_way_transmission,
)
from flgpr.recipe.schema import load_recipe
from flgpr.scoring import clopper_pearson, roc
from flgpr.simulate import Scene
from flgpr.simulate.ground.roughness import surface_backscatter
from flgpr.simulate.ground.soil import mironov, one_way_loss, peplinski_conductivity, topp

HOME = Path(__file__).parents[2] / "images"
ARID = (3.0, 0.03)
CLAY = (40.0, 0.25)
"""Clay (per cent) and moisture of dry sand and of wet clay."""
COLOURS = dict(zip(BANDS, ("#0072b2", "#009e73", "#e69f00", "#d55e00"), strict=True))


def geometry():
    """Side view of the array and the ground, and resolution over distance."""
    sensor = load_sensor("sri-array")
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    side, plot = figure.subplots(1, 2, width_ratios=(1.15, 1))
    h = sensor.height
    y = 12.0
    side.plot([-4, 27], [0, 0], color="saddlebrown", lw=2)
    side.fill_between([-4, 27], -1.4, 0, color="#e8dcc8")
    side.add_patch(Rectangle((-3.6, 0.5), 3.4, 1.8, fc="0.75", ec="0.3"))
    for wheel in (-3.0, -0.9):
        side.plot(wheel, 0.45, "o", color="0.25", ms=9)
    side.plot([-0.6, 0], [2.3, h], color="0.3", lw=2)
    side.plot(0, h, "ks", ms=6)
    side.plot([0, y], [h, 0], "C0")
    side.annotate("R", (8.0, 2.0), color="C0")
    side.add_patch(Rectangle((y - 0.5, -0.55), 1.0, 0.35, fc="C3"))
    side.plot([y, y], [0, 5.0], ":", color="0.4")
    side.annotate("θ", (y - 0.9, 1.0), color="0.3")
    side.annotate("", (0, 5.0), (y, 5.0), arrowprops={"arrowstyle": "<->", "color": "0.5"})
    side.annotate("distance y", (4.4, 5.2), color="0.4")
    side.annotate("H", (-0.2, h + 0.4))
    side.axvspan(7, 26, ymin=0, ymax=0.05, color="C0", alpha=0.3)
    side.annotate("imaged: 7 to 26 m ahead", (14.2, -1.2), fontsize=8, color="C0")
    side.set(
        xlim=(-4, 27),
        ylim=(-1.6, 7),
        xlabel="ahead (m)",
        ylabel="height (m)",
        title="from the side",
    )
    distance = np.array([7.0, 9, 12, 16, 20, 26])
    for name, colour in (("F1", "#0072b2"), ("F4", "#d55e00")):
        widths = np.array([half_power_widths(band=BANDS[name], distance=d) for d in distance])
        plot.plot(
            distance, 100 * widths[:, 2], "-", color=colour, label=f"{name} down-range, formula"
        )
        plot.plot(distance, 100 * widths[:, 0], "o", color=colour)
        plot.plot(
            distance, 100 * widths[:, 3], "--", color=colour, label=f"{name} cross-range, formula"
        )
        plot.plot(distance, 100 * widths[:, 1], "s", color=colour)
    plot.set(
        xlabel="distance ahead (m)",
        ylabel="half-power width (cm)",
        ylim=(0, None),
        title="marks: measured",
    )
    plot.legend(fontsize=7)
    plot.grid(alpha=0.3)
    return figure


def subbands():
    """What changes over the band: clutter, loss in the soil, resolution; and range cuts of one mine."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    f = np.linspace(0.45e9, 3.0e9, 120)
    sine = np.sin(np.arctan2(12.0, 5.0))
    hh, _ = surface_backscatter(f, sine, mironov(f, *ARID), 0.005, 0.05, np.radians(5))
    left.plot(f / 1e9, 10 * np.log10(hh), "k", label="surface σ⁰, HH")
    for name, (lo, hi) in BANDS.items():
        left.axvspan(lo / 1e9, hi / 1e9, color=COLOURS[name], alpha=0.15)
        left.annotate(name, ((lo + hi) / 2e9, -46), color=COLOURS[name], ha="center", weight="bold")
    k = 2 * np.pi * f / SPEED_OF_LIGHT
    for (clay, moisture), style, name in ((ARID, "--", "dry sand"), (CLAY, ":", "wet clay")):
        loss = two_way_attenuation(0.1, k, sine, mironov(f, clay, moisture))
        left.plot(
            f / 1e9,
            20 * np.log10(loss),
            style,
            color="C3",
            label=f"10 cm of {name}, there and back",
        )
    left.set(xlabel="GHz", ylabel="dB (dB re 1 m²/m² for σ⁰)", ylim=(-48, 2))
    left.legend(fontsize=7, loc="lower left", bbox_to_anchor=(0.0, 0.33))
    offset, cuts = mine_cuts(bands={"F0": load_recipe("wang2007").image.subbands["F0"], **BANDS})
    shown = {"F0": (0, "k"), "F1": (1, COLOURS["F1"]), "F4": (4, COLOURS["F4"])}
    for name, (b, colour) in shown.items():
        right.plot(100 * offset, cuts[0, b] / cuts[0, b].max(), color=colour, label=name)
    right.axvspan(-16, 16, color="0.9", label="the mine")
    right.set(
        xlabel="ground range from the mine's centre (cm)",
        ylabel="HH, of the largest",
        xlim=(-70, 100),
    )
    right.legend(fontsize=8)
    return figure


def refraction():
    """Shift, transmission and the rough interface over distance."""
    figure = Figure(figsize=(9.6, 3.3), layout="constrained")
    one, two, three = figure.subplots(1, 3)
    distance = np.linspace(6, 26, 100)
    height = 5.0
    for epsilon, colour in ((3.4, "C0"), (10.7, "C1")):
        sine = distance / np.hypot(distance, height)
        one.plot(
            distance,
            100 * apparent_shift(0.10, epsilon, sine),
            color=colour,
            label=f"formula, ε = {epsilon}",
        )
        found = [100 * focused_shift(0.10, epsilon, d, height) for d in (7.0, 12.0, 18.0, 26.0)]
        one.plot((7.0, 12.0, 18.0, 26.0), found, "o", color=colour)
        h, v = two_way_transmission(sine, epsilon)
        two.plot(distance, 20 * np.log10(np.abs(h)), "-", color=colour, label=f"HH, ε = {epsilon}")
        two.plot(distance, 20 * np.log10(np.abs(v)), "--", color=colour, label=f"VV, ε = {epsilon}")
    one.set(
        xlabel="distance (m)",
        ylabel="away from the radar (cm)",
        title="shift of a point 10 cm deep",
        ylim=(0, 45),
    )
    two.set(xlabel="distance (m)", ylabel="dB", title="plane-wave transmission, both ways")
    for f, name in ((1.05e9, "1.05 GHz"), (2.55e9, "2.55 GHz"), (9.4e9, "9.4 GHz")):
        k = 2 * np.pi * f / SPEED_OF_LIGHT
        s = np.linspace(0, 0.015, 60)
        variance = (k * s * interface_path(np.sin(np.radians(67)), 3.4)) ** 2
        three.semilogy(1000 * s[1:], variance[1:], label=name)
    three.axhline(1, color="0.6", lw=0.8)
    three.set(
        xlabel="rms height (mm)", ylabel="rad²", title="phase variance per pass", ylim=(1e-3, 20)
    )
    for axes in (one, two, three):
        axes.legend(fontsize=7)
        axes.grid(alpha=0.3)
    return figure


def soils():
    """Permittivity and loss over moisture and frequency, and where one model breaks down."""
    figure = Figure(figsize=(9.6, 3.3), layout="constrained")
    one, two, three = figure.subplots(1, 3)
    moisture = np.linspace(0.005, 0.35, 60)
    for clay, colour in ((3.0, "C1"), (15.0, "C2"), (40.0, "C3")):
        one.plot(
            moisture,
            [mironov(1.05e9, clay, m).real for m in moisture],
            color=colour,
            label=f"{clay:g} % clay",
        )
        loss = [one_way_loss(1.05e9, complex(mironov(1.05e9, clay, m))) for m in moisture]
        two.semilogy(moisture, loss, color=colour, label=f"{clay:g} % clay")
    one.plot(moisture, [topp(m).real for m in moisture], "k:", label="Topp et al.")
    one.set(xlabel="moisture (m³/m³)", ylabel="ε'", title="permittivity, 1.05 GHz")
    two.set(xlabel="moisture (m³/m³)", ylabel="dB/m, one way", title="loss, 1.05 GHz")
    sand = np.linspace(0, 100, 101)
    for clay in (0.0, 3.0, 10.0):
        chosen = sand[sand <= 100 - clay]
        three.plot(
            chosen, [peplinski_conductivity(s, clay) for s in chosen], label=f"{clay:g} % clay"
        )
    three.axhline(0, color="0.4", lw=0.8)
    three.set(xlabel="sand (per cent)", ylabel="S/m", title="Peplinski's conductivity")
    for axes in (one, two, three):
        axes.legend(fontsize=7)
        axes.grid(alpha=0.3)
    return figure


BODIES = {
    "metal-at": "metal",
    "plastic-at": "air gap",
    "plastic-at-cavity": "cavity",
    "plastic-at-solid": "simulant",
}
"""Packaged bodies of 16 cm radius, and what sets them apart."""


def signatures():
    """The double hump, the strength of metal's edges, and what four bodies of one size scatter."""
    figure = Figure(figsize=(9.6, 3.4), layout="constrained")
    one, two, three = figure.subplots(1, 3)
    offset, cuts = mine_cuts(0.10, bands={"F0": (0.45e9, 3.0e9)})
    for p, name in enumerate(("HH", "VV")):
        one.plot(100 * offset, cuts[p, 0] / cuts[p, 0].max(), label=name)
    shift = 100 * float(apparent_shift(0.10, mironov(1.05e9, *ARID).real, 12 / 13))
    for edge in (-16, 16):
        one.axvline(edge + shift, color="0.6", lw=0.8, ls=":")
    one.set(xlabel="ground range from the centre (cm)", xlim=(-40, 90), ylabel="of the largest")
    one.set_title("metal mine 10 cm deep, 0.45-3 GHz", fontsize=10)
    angle = np.radians(np.linspace(45, 80, 60))
    levels = pd.DataFrame([edge_levels(3.2, a) for a in angle])
    for name, style in (("near H", "C0-"), ("far H", "C0--"), ("near V", "C1-"), ("far V", "C1--")):
        two.plot(np.degrees(angle), levels[name], style, label=name)
    two.axvline(67, color="0.7", lw=0.8)
    two.set(xlabel="incidence (degrees)", ylabel="dB over physical optics")
    two.set_title("top rim of metal, ε = 3.2", fontsize=10)
    f = np.linspace(0.3e9, 3.2e9, 240)
    for number, (body, name) in enumerate(BODIES.items()):
        hh, vv = body_levels(body, f)
        three.plot(f / 1e9, hh, f"C{number}", lw=1.2, label=name)
        three.plot(f / 1e9, vv, f"C{number}--", lw=1.2)
    three.set(xlabel="GHz", ylabel="|F| (dB re 1 m)", ylim=(-95, -15))
    three.set_title("5 cm deep, ε = 3.1 (VV dashed)", fontsize=10)
    for axes in (one, two, three):
        axes.legend(fontsize=7)
        axes.grid(alpha=0.3)
    return figure


def roughness():
    """Backscatter over frequency of two sites: one scale, one scale on uneven ground, and a model fitted to soils."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    f = np.linspace(0.44e9, 3.0e9, 120)
    sine = np.sin(np.radians(67))
    for axes, site in zip(figure.subplots(1, 2, sharey=True), ("arid-sand", "gravel"), strict=True):
        scene = Scene(site=site)
        surface = scene.surface
        eps = scene.soil.media(f)[-1]
        for name, uneven, style in (
            ("one scale", 0.0, "C0--"),
            ("on a class D track", 1024e-6, "C0"),
        ):
            known = (surface.rms_height, surface.correlation_length, surface.slope, uneven)
            axes.plot(
                f / 1e9,
                10 * np.log10(surface_backscatter(f, sine, eps, *known)[0]),
                style,
                label=name,
            )
        fitted = 10 * np.log10(oh1992(f, sine, eps, surface.rms_height)[0])
        known = 2 * np.pi * f / SPEED_OF_LIGHT * surface.rms_height >= 0.1
        axes.plot(
            f[known] / 1e9, fitted[known], "k", label="fitted to measurements (Oh et al. 1992)"
        )
        axes.plot(f / 1e9, fitted, "k:", label="the same, ks below 0.1")
        axes.axvspan(0.44, 0.75, color="0.9")
        axes.set(xlabel="GHz", title=f"{site}, HH, 67°")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7, loc="lower right")
    figure.axes[0].set_ylabel("σ⁰ (dB)")
    return figure


def clutter():
    """Surface clutter over angle, the tail of its amplitudes, and what background removal takes away."""
    grid, bare, signed = scan_images()
    figure = Figure(figsize=(9.6, 7.2), layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=(1, 1.25))
    one, two = top.subplots(1, 2)
    angle = np.radians(np.linspace(45, 82, 80))
    for f, colour in ((1.05e9, "C0"), (2.55e9, "C1")):
        hh, vv = surface_backscatter(
            f, np.sin(angle), mironov(f, *ARID), 0.005, 0.05, np.radians(5)
        )
        one.plot(
            np.degrees(angle), 10 * np.log10(hh), "-", color=colour, label=f"HH, {f / 1e9:g} GHz"
        )
        one.plot(
            np.degrees(angle), 10 * np.log10(vv), "--", color=colour, label=f"VV, {f / 1e9:g} GHz"
        )
    one.set(
        xlabel="incidence (degrees)", ylabel="σ⁰ (dB)", title="backscatter of dry sand, s = 5 mm"
    )
    one.legend(fontsize=7)
    one.grid(alpha=0.3)
    # Every range has its own level: its root mean square is divided out before amplitudes are
    # counted.
    for name, image in zip(("F1", "F4"), bare[:, grid.y > 16], strict=True):
        power = np.abs(image) ** 2 / np.mean(np.abs(image) ** 2, axis=1, keepdims=True)
        level = np.sort(np.sqrt(power).ravel())
        two.semilogy(
            level, 1 - np.arange(level.size) / level.size, label=f"simulated image, {name} HH"
        )
    x = np.linspace(0, 4, 100)
    two.semilogy(x, np.exp(-(x**2)), "k:", label="Rayleigh")
    two.set(
        xlabel="amplitude over its rms at that range",
        ylabel="share above",
        ylim=(1e-4, 1.2),
        xlim=(0, 4.5),
    )
    two.set_title("amplitudes")
    two.legend(fontsize=8)
    two.grid(alpha=0.3)
    signature = self_signature(signed, "mean")
    background = gain_background(signed, signature, (11, 11), (25, 25))
    cleaned = remove_background(signed[0], signature, background)
    panels = bottom.subplots(1, 3, sharey=True)
    scale = np.median(np.abs(signed[0] / scan_gain(signed[0])))
    shown = {
        "one scan": signed[0] / scan_gain(signed[0]),
        "self-signature (mean of 8)": signature,
        "cleaned": cleaned,
    }
    for axes, (title, image) in zip(panels, shown.items(), strict=True):
        unit = np.median(np.abs(image)) if title == "cleaned" else scale
        decibel = 20 * np.log10(np.abs(image) / unit)
        drawn = axes.pcolormesh(grid.x, grid.y, decibel, vmin=-5, vmax=20, cmap="magma")
        axes.plot(0.5, 14.0, "co", mfc="none", ms=13)
        axes.set(title=title, xlabel="x (m)", aspect="equal")
    panels[0].set_ylabel("ahead (m)")
    bottom.colorbar(drawn, ax=panels, label="dB over the scan's median", shrink=0.8)
    return figure


CANONICAL = {
    "sphere, plane": (1, 0, 1),
    "cylinder (1, ½)": (1, 0, 0.5),
    "dipole": (1, 0, 0),
    "(1, -½)": (1, 0, -0.5),
    "dihedral": (1, 0, -1),
    "helix": (1, 1j, -1),
}
"""Scattering matrices as (hh, hv, vv)."""


def polarimetry():
    """The plane of entropy and alpha: pure scatterers, the same in noise, and the bounds."""
    rng = np.random.default_rng(0)
    figure = Figure(figsize=(6.6, 4.4), layout="constrained")
    axes = figure.subplots()
    m = np.linspace(0, 1, 200)
    low = [np.diag([1, x, x]) for x in m]
    high = [np.diag([0, 1, 2 * x]) if x < 0.5 else np.diag([2 * x - 1, 1, 1]) for x in m]
    for matrices in (low, high):
        h, a = entropy_alpha_of(np.array(matrices, dtype=complex))
        axes.plot(h, np.degrees(a), "k", lw=1)
    for number, (name, channels) in enumerate(CANONICAL.items()):
        course = []
        for noise in np.geomspace(0.02, 3, 14):
            shape = (3, 61, 61)
            random = noise * (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / 2
            random[1] /= np.sqrt(2)  # noise alike in all directions of the scattering vector
            h, a = entropy_alpha(*(np.array(channels)[:, None, None] + random), window=(61, 61))
            course.append((h[30, 30], np.degrees(a[30, 30])))
        axes.plot(*np.array(course).T, ".-", ms=4, color=f"C{number}", label=name)
    axes.set(xlabel="entropy H", ylabel="mean α (degrees)", xlim=(0, 1), ylim=(0, 92))
    axes.legend(fontsize=8, title="with more and more noise", title_fontsize=8)
    axes.grid(alpha=0.3)
    return figure


def detectors():
    """ROCs of detectors that know a few examples, and a sparse kernel machine's border."""
    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    one, two = figure.subplots(1, 2)
    for name, (target, clutter) in detector_scores().items():
        limits = np.quantile(clutter, 1 - np.geomspace(1e-3, 1, 60))
        one.semilogx(
            [(clutter >= x).mean() for x in limits],
            [(target >= x).mean() for x in limits],
            label=name,
        )
    one.set(
        xlabel="share of clutter declared",
        ylabel="Pd",
        title="14 examples of 56 samples",
        ylim=(0, 1.02),
    )
    one.legend(fontsize=8)
    one.grid(alpha=0.3)
    rng = np.random.default_rng(1)
    mines = np.concatenate(
        [rng.normal((-0.6, 0.7), 0.28, (60, 2)), rng.normal((0.5, 0.7), 0.28, (60, 2))]
    )
    others = np.concatenate(
        [rng.normal((-0.2, 0.15), 0.3, (60, 2)), rng.normal((0.9, 0.1), 0.3, (60, 2))]
    )
    x = np.concatenate([mines, others])
    y = np.repeat([1, 0], [120, 120])
    machine = RelevanceVectorClassifier(kernel="rbf", gamma=4.0).fit(x, y)
    u, v = np.meshgrid(np.linspace(-1.6, 1.9, 90), np.linspace(-0.9, 1.6, 90))
    p = machine.predict_proba(np.column_stack([u.ravel(), v.ravel()]))[:, 1].reshape(u.shape)
    drawn = two.pcolormesh(u, v, p, cmap="RdBu_r", vmin=0, vmax=1, alpha=0.75, rasterized=True)
    two.contour(u, v, p, [0.5], colors="k", linewidths=1)
    two.plot(*mines.T, ".", color="darkred", ms=4)
    two.plot(*others.T, ".", color="navy", ms=4)
    two.plot(
        *x[machine.relevance_].T,
        "ko",
        mfc="none",
        ms=11,
        label=f"{len(machine.relevance_)} relevance vectors of 240",
    )
    two.set(xlabel="first feature", ylabel="second feature", title="relevance vector machine")
    two.legend(fontsize=8, loc="upper left")
    figure.colorbar(drawn, ax=two, label="p(mine)")
    return figure


def scoring():
    """A curve with exact intervals, kinds apart, and how the interval narrows with the number of mines."""
    alarms, truth, lane = roc_example()
    figure = Figure(figsize=(9.4, 3.6), layout="constrained")
    one, two = figure.subplots(1, 2)
    whole = roc(alarms, truth, lane)
    one.fill_between(
        whole.far,
        whole.pd_low,
        whole.pd_high,
        step="post",
        alpha=0.2,
        label="95 %, exact, point by point",
    )
    one.step(whole.far, whole.pd, where="post", label="all 20 mines")
    for kind, colour in (("metal", "C3"), ("plastic", "C1")):
        curve = roc(alarms, truth, lane, subset={"kind": kind})
        one.step(curve.far, curve.pd, "--", where="post", color=colour, label=f"{kind} (10)")
    one.axvspan(0, 0.1, color="0.93", zorder=0)
    one.set(
        xlabel="false alarms per m²",
        ylabel="Pd",
        ylim=(0, 1.03),
        xlim=(0, 0.16),
        title="halo rules",
    )
    one.annotate("PD_mean: mean Pd\nover the grey part", (0.006, 0.04), fontsize=8)
    one.legend(fontsize=7, loc="lower right")
    number = np.array([3, 5, 8, 12, 20, 30, 50, 80, 120, 200])
    for share, colour in ((1.0, "C0"), (0.9, "C1")):
        bounds = np.array([clopper_pearson(round(share * n), n) for n in number])
        two.fill_between(number, *bounds.T, alpha=0.2, color=colour)
        two.plot(
            number,
            np.round(share * number) / number,
            "o-",
            ms=3,
            color=colour,
            label=f"{share:.0%} found",
        )
    two.set(xscale="log", xlabel="mines on the lane", ylabel="Pd, 95 % exact", ylim=(0, 1.03))
    two.set_title("what a number of mines can show")
    two.legend(fontsize=8, loc="lower right")
    two.grid(alpha=0.3)
    return figure


FIGURES = (
    geometry,
    subbands,
    refraction,
    soils,
    signatures,
    roughness,
    clutter,
    polarimetry,
    detectors,
    scoring,
)


if __name__ == "__main__":
    home = Path(sys.argv[1]) if len(sys.argv) > 1 else HOME
    for draw in FIGURES:
        draw().savefig(home / f"theory-{draw.__name__}.png", dpi=110, metadata={"Software": None})

"""Compare the simulator's buried bodies with the full-wave archives of tests/data/signatures, body by body.

Prints the tables and writes docs/images/signatures.png. Nothing is fitted, not even a common scale.
The archives are made by make_signatures.py.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from simulate.fullwave_difference import compare, load, names, simulated  # noqa: E402

# dB, cm: what must hold
LEVEL = 2.0
PLACE = 5.0
ORDER = {"metal": 0, "gap": 1, "solid": 2}
WORDS = {"metal": "metal", "gap": "plastic, gap", "solid": "plastic, solid"}


def signed(values) -> str:
    return f"{values[0]:+.1f} ({', '.join(f'{v:+.1f}' for v in values[1:])})"


def plain(values) -> str:
    return f"{values[0]:.1f} ({', '.join(f'{v:.1f}' for v in values[1:])})"


def lead(case) -> str:
    return f"{case.soil['permittivity']:g} | {WORDS[case.body['name']]} | {100 * case.body['cover_m']:g}"


def report(cases, found) -> None:
    print(
        "Whole band, and its thirds in brackets. Peaks are told in ground range behind the body's centre. *Simulated "
        "there* is the simulated image within 5 cm of the full wave's peak, over its own peak.\n"
    )
    print(
        "| ε | body | cover (cm) | | level, full wave (dB) | full wave over simulated (dB) | the same, rms | "
        "peak, full wave (cm) | full wave less simulated (cm) | simulated there (dB) | coherence |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for case, one in zip(cases, found, strict=True):
        for row, label in enumerate(("HH", "VV")):
            print(
                f"| {lead(case)} | {label} | {plain(one.full_level[row])} | {signed(one.level[row])} | "
                f"{signed(one.power[row])} | {plain(100 * one.full_place[row])} | {signed(100 * one.apart[row])} | "
                f"{signed(one.there[row])} | "
                f"{one.coherence[row, 0]:.2f} |"
            )
    print("\n| ε | body | cover (cm) | VV/HH, full wave (dB) | full wave less simulated (dB) |")
    print("|---|---|---|---|---|")
    for case, one in zip(cases, found, strict=True):
        print(f"| {lead(case)} | {signed(one.full_ratio)} | {signed(one.ratio)} |")
    print(f"\n| within | whole band | thirds |\n|---|---|---|\n{verdicts(found)}")


def verdicts(found) -> str:
    rows = []
    for name, values, limit in (
        (f"level, {LEVEL:g} dB", np.array([one.level for one in found]), LEVEL),
        (f"peak, {PLACE:g} cm", 100 * np.array([one.apart for one in found]), PLACE),
        (f"VV/HH, {LEVEL:g} dB", np.array([one.ratio for one in found])[:, None], LEVEL),
    ):
        good = np.abs(values) <= limit + 1e-9
        parts = [f"{part.sum()} of {part.size}" for part in (good[..., 0], good[..., 1:])]
        rows.append(f"| {name} | {parts[0]} | {parts[1]} |")
    return "\n".join(rows)


def draw(cases, found, path) -> None:
    figure = Figure(figsize=(10, 7), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    for i, eps in enumerate(sorted({case.soil["permittivity"] for case in cases})):
        for row, label in enumerate(("HH", "VV")):
            for body, colour in zip(ORDER, ("C0", "C1", "C2"), strict=True):
                some = [
                    (100 * case.body["cover_m"], one.full_level[row, 0], one.level[row, 0])
                    for case, one in zip(cases, found, strict=True)
                    if case.soil["permittivity"] == eps and case.body["name"] == body
                ]
                cover, full, over = np.array(some).T
                axes[row, i].plot(
                    cover, full, "o-", color=colour, label=f"{WORDS[body]}, full wave"
                )
                axes[row, i].plot(cover, full - over, "x--", color=colour, label="simulated")
            axes[row, i].set(title=f"{label}, soil {eps:g}")
            axes[row, i].grid(alpha=0.3)
    for one in axes[1]:
        one.set_xlabel("cover (cm)")
    for one in axes[:, 0]:
        one.set_ylabel("peak of the image (dB)")
    axes[0, 1].legend(fontsize=7, ncols=3)
    figure.savefig(path, dpi=80, metadata={"Software": None})


def main() -> None:
    cases = [load(name) for name in names()]
    cases.sort(
        key=lambda case: (case.soil["permittivity"], ORDER[case.body["name"]], case.body["cover_m"])
    )
    found = [compare(case, simulated(case)) for case in cases]
    report(cases, found)
    draw(cases, found, ROOT / "docs" / "images" / "signatures.png")


if __name__ == "__main__":
    main()

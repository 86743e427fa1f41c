"""The tables of the page: sizes, areas under the ROC, templates and registration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.flsar2004.material import Results
from flgpr_papers.kit.findings import in_words

Row = tuple[Any, ...]
_VECTORS = {
    "support vectors": ("34 % (par. 48), typically 30 % (par. 57)", "SVM"),
    "relevance vectors": ("14 % (par. 48), typically 15 % (par. 57)", "RVM"),
    "the same, prior by the evidence": ("not said", "RVM, prior by the evidence"),
    "the same, ARD and width by evidence": ("not tried", "RVM, ARD, width by evidence"),
}
"""Shares of vectors that are shown: what the paper says, and the machine."""


def page_tables(settings: Settings, results: Results) -> dict[str, Any]:
    """Return what the template of the page takes."""
    notes = results.notes
    areas = []
    for name, area in results.areas.items():
        # Whole areas that were trained anew in every draw have no partial one.
        partial = ("", "")
        if name in results.partial:
            partial = (in_words(*results.partial[name]), f"{results.chance[name]:.2f}")
        areas.append((name, *partial, in_words(*area)))
    return {
        "settings": settings,
        "sizes": _sizes(settings, notes),
        "areas": areas,
        "cases": list(notes["templates"]),
        "templates": _variants(notes["templates"]),
        "energy": notes["energy of the first component"],
        "registration": _registration(notes["registration"]),
    }


def _sizes(settings: Settings, notes: Mapping[str, Any]) -> list[Row]:
    """Tabulate numbers of mines and examples in the paper and here."""
    loo = notes["vectors, leave-one-out"]
    metal = sum(mines.metal for mines in settings.mines)
    plastic = sum(mines.plastic for mines in settings.mines)
    examples = f"{loo['examples']}, {loo['mines']} mines"
    rows: list[Row] = [
        ("mines per site, metal and plastic", "60 and 30", f"{metal} and {plastic}"),
        ("examples of the leave-one-out (par. 57)", "153, of them 27 mines", examples),
    ]
    for name, (paper, machine) in _VECTORS.items():
        rows.append((name, paper, f"{100 * loo[machine]:.1f} %"))
    for site, counts in notes["examples"].items():
        text = ", ".join(f"{count} {kind}" for kind, count in counts.items())
        rows.append((f"examples without prescreener, both looks, {site}", "not given", text))
    for name, value in notes.items():
        if name.startswith(("prescreen", "fig5")):
            rows.append((name, "", _note_text(value)))
    return rows


def _note_text(value: Any) -> str:
    """Format a note of the results: a text, or several named numbers."""
    if isinstance(value, dict):
        return ", ".join(f"{name}: {_note_text(number)}" for name, number in value.items())
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _variants(summary: Mapping[str, Any]) -> list[Row]:
    """Tabulate the number of every kind of template in every case, and that less the main one's."""
    rows: list[Row] = []
    for name in next(iter(summary.values())):
        cells = []
        for case in summary.values():
            area = "{:.2f} ({:.2f} to {:.2f})".format(*case[name]["area"])
            gap = "{:+.2f} ({:+.2f} to {:+.2f})".format(*case[name]["less the main one"])
            cells.append(f"{area}; {gap}")
        rows.append((name, *cells))
    return rows


def _registration(summary: Mapping[str, Any]) -> list[Row]:
    """Tabulate how well the fiducials register the images."""
    rows: list[Row] = []
    for site, by_pass in summary.items():
        for name, registered in by_pass.items():
            across, along = registered["shift"]
            shift = f"{100 * across:+.1f}, {100 * along:+.1f} cm"
            residual = f"{100 * registered['residual']:.1f} cm"
            rows.append((site, name, shift, residual, registered["fiducials"]))
    return rows

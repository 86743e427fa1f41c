"""What the template of the page takes: settings, sizes, areas under the ROC, and notes."""

from __future__ import annotations

from typing import Any

from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.flsar2004.material import Results
from flgpr_papers.kit.findings import in_words


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
    screened = {
        name: _note_text(value)
        for name, value in notes.items()
        if name.startswith(("prescreen", "fig5"))
    }
    return {"settings": settings, "areas": areas, "notes": notes, "screened": screened}


def _note_text(value: Any) -> str:
    """Format a note of the results: a text, or several named numbers."""
    if isinstance(value, dict):
        return ", ".join(f"{name}: {_note_text(number)}" for name, number in value.items())
    return f"{value:.2f}" if isinstance(value, float) else str(value)

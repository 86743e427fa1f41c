"""Run the parts of the map of worlds, in order, each with its tables, figures and section."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from flgpr.jobs.workers import DEFAULTS, RunOptions
from flgpr.store import write_whole
from flgpr_papers.kit.page import log_if_unchanged
from flgpr_papers.worlds import ablation, detection, geometry, statements
from flgpr_papers.worlds.figures import draw_figures
from flgpr_papers.worlds.page import page_html, short_tables
from flgpr_papers.worlds.tables import write_rounded_table

RUN = {
    "detection": detection.run,
    "ablation": ablation.run,
    "geometry": geometry.run,
    "statements": statements.run,
}
FIGURES = "figures"
"""Part that runs nothing: it draws the figures of all tables that are there."""
PARTS = (*RUN, FIGURES)
"""Names of the parts."""
_FORM = "worlds.json"


def map_worlds(
    output: str | Path,
    parts: Sequence[str] = tuple(RUN),
    quick: bool = False,
    how: RunOptions = DEFAULTS,
) -> Path:
    """Run parts of the map of worlds and write their tables, figures and the page.

    An interrupted run resumes.

    Parameters
    ----------
    output : str or Path
        Folder to work in: ``index.html``, CSV files and figures. A cluster's workers see it under
        the same path.
    parts : sequence of str
        Parts to run, in the order of ``PARTS`` whatever the order given. "figures" alone draws the
        PNG files of the CSV files that are in the folder, and writes nothing else.
    quick : bool
        Few worlds and short lanes with other seeds, which only show that everything runs; the page
        says so.
    how : RunOptions
        Who works, each at a lane or at a study in a world, and who is shown progress.

    Returns
    -------
    Path
        The page; the folder if figures alone were drawn.

    Raises
    ------
    ValueError
        If there is no such part, workers and a scheduler are asked for, or there is no scheduler at
        the address.
    FileExistsError
        If the folder holds the other form, quick or full.
    """
    for part in parts:
        if part not in PARTS:
            raise ValueError(f"part must be one of {', '.join(PARTS)}, got {part!r}")
    folder = Path(output).resolve()
    if set(parts) == {FIGURES}:
        draw_figures(folder)
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    _take_form(folder, quick)
    with how.executor() as executor:
        for part, run in RUN.items():
            if part in parts:
                run(folder, executor, quick, how.track)
    pictures = draw_figures(folder, quick)
    for name, table in short_tables(folder).items():
        write_rounded_table(folder / f"{name}.csv", table)
    page = folder / "index.html"
    with log_if_unchanged(page):
        write_whole(page, page_html(folder, pictures, quick))
    return page


def _take_form(folder: Path, quick: bool) -> None:
    """Refuse a folder that holds the other form, and note which one it holds."""
    path = folder / _FORM
    if path.is_file() and json.loads(path.read_text(encoding="utf-8"))["quick"] != quick:
        form = "full" if quick else "quick"
        raise FileExistsError(
            f"output must not exist yet, got {folder} with the {form} form: choose another output"
        )
    write_whole(path, json.dumps({"quick": quick}) + "\n")

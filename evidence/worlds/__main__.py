"""What decides: on which lanes mines are found.

``python evidence/worlds DIR [--part detection] [--workers 2]`` writes the tables and figures of
docs/evidence/worlds into DIR: which worlds give which Pd (detection), what each part of a road costs
(ablation), height and standoff (geometry). An interrupted run resumes lane by lane. ``--part
figures`` runs nothing: it draws the figures of the tables in DIR.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from flgpr.commands.bars import Bars
from flgpr.jobs.workers import Executor, InProcess, Processes
from flgpr.progress import Track, silent
from worlds import ablation, detection, geometry
from worlds.figures import draw_figures
from worlds.lanes import read_targets, run_jobs
from worlds.short_tables import short_tables
from worlds.tables import write_rounded_table

LANES = {"detection": detection, "ablation": ablation, "geometry": geometry}
"""Parts whose lanes are simulated and searched."""
FIGURES = "figures"
PARTS = (*LANES, FIGURES)


def main(arguments: list[str] | None = None) -> None:
    """Run the parts asked for and write all tables and figures of what is there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--part", choices=PARTS, action="append", help="all without any")
    parser.add_argument("--workers", type=int, default=1, help="processes, each at a lane")
    given = parser.parse_args(arguments)
    executor = Processes(given.workers) if given.workers > 1 else InProcess()
    given.folder.mkdir(parents=True, exist_ok=True)
    with executor, Bars() as track:
        for part in given.part or PARTS:
            run_part(given.folder, part, executor, track)
    write_summaries(given.folder)


def run_part(folder: Path, part: str, executor: Executor, track: Track = silent) -> None:
    """Run what is not on disk of a part, and write the tables of all that is."""
    if part in LANES:
        jobs = LANES[part].jobs()
        run_jobs(folder, jobs, executor, track)
        targets = read_targets(folder, jobs)
        tables = LANES[part].tables(targets) if len(targets) else {}
        for name, table in tables.items():
            write_rounded_table(folder / f"{name}.csv", table)


def write_summaries(folder: Path) -> None:
    """Write the short tables and the figures of the tables in a folder."""
    for name, table in short_tables(folder).items():
        write_rounded_table(folder / f"{name}.csv", table)
    draw_figures(folder)


if __name__ == "__main__":
    main()

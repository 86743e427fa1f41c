"""The skeleton of a study: every paper fills it in, and it writes findings, figures and the page."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, cast

import matplotlib as mpl
import scipy.linalg  # noqa: F401  # loads the BLAS of SciPy, which can be limited only once loaded
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from flgpr.progress import Track, silent
from flgpr.store import write_whole
from flgpr.types import Entries
from flgpr_papers.kit.findings import Finding, by_chance, write_findings
from flgpr_papers.kit.page import draw, study_html, twins
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.kit.study_worlds import OWN, other_world, study_world

Run = TypeVar("Run", bound=Callable[..., Any])


def one_blas_thread(run: Run) -> Run:
    """Return a function that runs with one thread of the linear algebra.

    The matrices of the studies are small, so that several threads mostly wait for each other. When
    other work runs on the same two cores, flsar2004 takes four times as long with two threads.
    """
    return cast("Run", threadpool_limits.wrap(limits=1, user_api="blas")(run))


@dataclass(frozen=True)
class Outcome:
    """What a study has measured on its lanes, and what its page shows of it."""

    findings: Sequence[Finding]  #: in the order of the page
    measured: Any  #: what its figures draw
    facts: Entries  #: what the captions and their numbers take, by name
    tables: Entries  #: what the template of the page takes
    files: Mapping[str, str] = field(default_factory=dict)  #: other texts, by the name of the file
    notes: Entries = field(default_factory=dict)  #: what else ``findings.json`` holds


@dataclass(frozen=True)
class Study:
    """A paper's experiment: lanes, what is done on them, what is measured, and the page.

    A study of several parts, lanes or seeds, can make each by itself: ``run`` then finds it on
    disk.
    """

    name: str  #: of the paper
    page: str  #: file name of the page
    figures: Any  #: module with the functions that ``captions.toml`` declares to draw them
    #: runs the experiment: folder, whether quick, progress and world
    run: Callable[[Path, bool, Track, str], Outcome]
    parts: Callable[[bool], list[str]] | None = None  #: names of the parts, quick or not
    part: Callable[[Path, str, bool, str], Any] | None = None  #: makes a part: folder, name, ...
    dpi: tuple[float, float] = (110, 110)  #: of the figures, of a full and of a quick run
    style: Any = None  #: Matplotlib's settings for them, by name

    @one_blas_thread
    def reproduce(
        self, output: str | Path, quick: bool = False, track: Track = silent, world: str = OWN
    ) -> Path:
        """Run the experiment and write findings, figures and the page.

        What is on disk and was made of the same settings is used: an interrupted run resumes.

        Parameters
        ----------
        output : str or Path
            Folder to work in.
        quick : bool
            A small form that only shows that everything runs.
        track : Track
            Shows progress.
        world : str
            World of the lanes, see `flgpr_papers.kit.study_worlds`.

        Returns
        -------
        Path
            The page.
        """
        folder = Path(output)
        folder.mkdir(parents=True, exist_ok=True)
        outcome = self.run(folder, quick, track, world)
        write_findings(folder, outcome.findings, quick, world=world, **outcome.notes)
        for name, text in outcome.files.items():
            write_whole(folder / name, text)
        captions = tomllib.loads(packaged_text(self.name, "captions"))
        pictures = {}
        with mpl.rc_context(self.style):
            for name in track(captions, "drawing the page", len(captions)):
                function, *given = captions[name]["draws"]
                figure = getattr(self.figures, function)(outcome.measured, *given)
                pictures[name] = draw(figure, quick, self.dpi[quick])
                write_whole(folder / f"{name}.png", pictures[name])
        shown = twins(captions, pictures, outcome.findings, outcome.facts)
        values = {
            "quick": quick,
            "study_world": study_world(self.name, world),
            "other": other_world(folder, self.page, world, quick),
            "found": outcome.findings,
            "chance": by_chance(outcome.findings),
            "twins": [twin for twin in shown if twin.number],
            "others": [twin for twin in shown if not twin.number],
        }
        write_whole(folder / self.page, study_html(f"{self.name}.html", **values, **outcome.tables))
        return folder / self.page

    @one_blas_thread
    def make_part(self, folder: Path, name: str, quick: bool, world: str = OWN) -> None:
        """Make a part of the study, unless it is on disk."""
        if self.part is not None:
            self.part(folder, name, quick, world)

"""The recipe of the study of Cosgrove et al. 2004."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from flgpr.chain.stages.forms import CutSettings
from flgpr.model import Grid
from flgpr_papers.kit.settings import Table, packaged
from flgpr_papers.kit.study_worlds import OWN, study_world

Positive = Annotated[float, Field(gt=0)]


class Radar(Table):
    """Sensor preset, step of its tones (Hz) and range of the mines (m).

    Also the stop spacing (m) and the surface scatterers per m².
    """

    sensor: str
    tone_step: Positive
    range: Positive
    scatterers: Positive | None = None
    stop_spacing: Positive
    margin: Positive


class Image(Table):
    """Image in the scan frame (m), band (Hz) and how it is formed.

    ``spacing`` is cross-track, down-track.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    spacing: tuple[Positive, Positive]
    band: tuple[float, float]
    filter: Literal["ramp", "none"]
    calibrate: bool
    self_signature: Literal["none", "mean", "median"]

    def grid(self) -> Grid:
        """Grid of the images."""
        dx, dy = self.spacing
        x0, x1 = self.x
        y0, y1 = self.y
        return Grid(x0, y0, round((x1 - x0) / dx) + 1, round((y1 - y0) / dy) + 1, dx, dy)


class Cut(Table):
    """Range cut: polarizations stacked and number of samples of each."""

    polarizations: tuple[str, ...]
    length: Annotated[int, Field(ge=1)]


class Training(Table):
    """How target and clutter samples are taken; lengths in m, steps in pixels."""

    search: Annotated[float, Field(ge=0)]
    clear: Positive
    clutter_step: tuple[int, int]
    moments: str


class Detector(Table):
    """Ranks compared, the one scored and the divisor of Eq. 7."""

    ranks: tuple[int, ...]
    rank: int
    ddof: int


class Score(Table):
    """Boxes, clearance and reach of rocks (m), and the levels of comparisons.

    They are the quantile beside the peak and the P_FA (per m²).
    """

    box: Positive
    clearance: Annotated[float, Field(ge=0)]
    quantile: Annotated[float, Field(gt=0, le=1)]
    pfa: Positive
    rock: Annotated[float, Field(ge=0)]


class Premises(Table):
    """How the paper's premises are measured, and within what they are said to hold."""

    #: share of a cut's largest value by which a hump stands out
    hump: Annotated[float, Field(gt=0, le=1)]
    humps: tuple[float, float]  #: mean number of humps that is called a double hump
    #: share of clutter boxes that a visible mine exceeds
    visible: Annotated[float, Field(gt=0, lt=1)]
    visible_mines: tuple[float, float]  #: share of visible mines that is called "readily visible"
    fourth_moment: tuple[float, float]  #: of complex Gaussian clutter, E|z|⁴ / (E|z|²)² is 2
    humps_across: tuple[float, float]  #: mean number of humps across that is called no structure
    width_across: Positive  #: least width of mines across, in widths of an ideal point
    clutter_thinning: Annotated[int, Field(ge=1)]  #: of so many clutter cuts one is measured


class Study(Table):
    """Number of seeds and share of the mines that are laid."""

    seeds: Annotated[int, Field(ge=2)]
    share: Annotated[float, Field(gt=0, le=1)]


class Site(Table):
    """A lane: soil, kind of mine and its body, and numbers of mines by depth (m)."""

    title: str
    scene: str
    kind: str
    body: str | None = None  #: packaged body; None takes the generic one of the kind
    training: dict[str, int]
    test: dict[str, int]

    def mine(self, **position: float) -> dict[str, Any]:
        """Return a mine of this lane at a position, as scenes hold targets."""
        entries: dict[str, Any] = {"kind": self.kind}
        if self.body is not None:
            entries["body"] = self.body
        return entries | position

    def depths(self, share: float = 1.0) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the depth of every mine, m, and whether it belongs to the training set.

        Parameters
        ----------
        share : float
            Share of the mines that is laid, at least one of every depth.
        """
        depths = []
        trains = []
        for counts, is_training in ((self.training, True), (self.test, False)):
            for depth, count in counts.items():
                number = max(1, round(count * share))
                depths += [float(depth)] * number
                trains += [is_training] * number
        return np.array(depths), np.array(trains)


class StudyRecipe(Table):
    """All that the study depends on, and what is asked beyond the paper, by detector."""

    name: str
    description: str
    radar: Radar
    image: Image
    cut: Cut
    training: Training
    detector: Detector
    score: Score
    premises: Premises
    study: Study
    sites: dict[str, Site]
    questions: dict[str, str]

    @property
    def cuts(self) -> CutSettings:
        """How samples are taken: the settings of the stage that maps by forms."""
        return CutSettings(**(self.cut.model_dump() | self.training.model_dump()))


def study_recipe(quick: bool = False, world: str = OWN) -> StudyRecipe:
    """Load the packaged recipe of the study, on the lanes of a world."""
    sites = {}
    for name, site in study_world("cosgrove2004", world).sites.items():
        sites[name] = {"scene": site}
    return packaged("cosgrove2004", StudyRecipe, quick, {"sites": sites})

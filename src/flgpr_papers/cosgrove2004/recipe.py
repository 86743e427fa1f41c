"""The recipe of the study of Cosgrove et al. 2004."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from flgpr.model import Grid
from flgpr.model.bounds import AtLeastOne, NotNegative, Positive
from flgpr.stages.forms import CutSettings
from flgpr.types import BoolArray, Entries, FloatArray
from flgpr_papers.kit.settings import Span, Table, packaged
from flgpr_papers.kit.study_worlds import OWN, study_world

SOILS = ("sand", "gravel", "clay")


class Radar(Table):
    """The radar and its stops."""

    sensor: str  #: preset
    tone_step: Positive  #: Hz
    range: Positive  #: distance of the mines from the stop, m
    scatterers: Positive | None = None  #: surface scatterers per m²
    tones: Span | None = None  #: their ends, Hz; those of the image's band by default
    stop_spacing: Positive  #: m
    margin: Positive  #: simulated ground around the image, m


class Image(Table):
    """Image in the scan frame, and how it is formed."""

    x: Span  #: cross-track, m
    y: Span  #: down-track, m
    spacing: tuple[Positive, Positive]  #: of the pixels, cross-track and down-track, m
    band: Span  #: Hz
    filter: Literal["ramp", "none"]  #: weight of the tones
    calibrate: bool  #: whether the gain of the antennas is taken out
    self_signature: Literal["none", "mean", "median"]  #: how it is estimated

    def grid(self) -> Grid:
        """Return the grid of the images."""
        dx, dy = self.spacing
        x0, x1 = self.x
        y0, y1 = self.y
        return Grid(x0, y0, round((x1 - x0) / dx) + 1, round((y1 - y0) / dy) + 1, dx, dy)


class Cut(Table):
    """Range cut: polarizations stacked and number of samples of each."""

    polarizations: tuple[str, ...]
    length: AtLeastOne


class Training(Table):
    """How target and clutter samples are taken; lengths in m, steps in pixels."""

    search: NotNegative
    clear: Positive
    clutter_step: tuple[int, int]
    moments: str


class Detector(Table):
    """Ranks compared, the one scored and the divisor of Eq. 7."""

    ranks: tuple[int, ...]
    rank: int
    ddof: int


class Score(Table):
    """How detectors are scored, by boxes at the mines and away from them."""

    box: Positive  #: side of a box, m
    clearance: NotNegative  #: of clutter boxes from a mine's box, m
    quantile: Annotated[float, Field(gt=0, le=1)]  #: tried in place of the peak of a box
    pfa: Positive  #: false alarms per m² at which detectors are compared
    rock: NotNegative  #: distance at which a rock is near a box, m


class Premises(Table):
    """How the paper's premises are measured, and within what they are said to hold."""

    #: share of a cut's largest value by which a hump stands out
    hump: Annotated[float, Field(gt=0, le=1)]
    humps: Span  #: mean number of humps that is called a double hump
    #: share of clutter boxes that a visible mine exceeds
    visible: Annotated[float, Field(gt=0, lt=1)]
    visible_mines: Span  #: share of visible mines that is called "readily visible"
    wide_images: Annotated[int, Field(ge=2)]  #: images of Fig. 2's mines, by seeds
    fourth_moment: Span  #: of complex Gaussian clutter, E|z|⁴ / (E|z|²)² is 2
    humps_across: Span  #: mean number of humps across that is called no structure
    width_across: Positive  #: least width of mines across, in widths of an ideal point
    clutter_thinning: AtLeastOne  #: of so many clutter cuts one is measured


class Study(Table):
    """Number of seeds and share of the mines that are laid."""

    seeds: Annotated[int, Field(ge=2)]
    share: Annotated[float, Field(gt=0, le=1)]


class Sweeps(Table):
    """What is tried beside the study, on the lanes of its first seeds."""

    seeds: Annotated[int, Field(ge=0)]  #: number of seeds
    mines: AtLeastOne  #: of a further lane, seen twice, from which examples come
    numbers: tuple[int, ...]  #: numbers of examples
    ranks: tuple[int, ...]  #: ranks of the detectors trained on them
    bands: dict[str, Span]  #: Hz, by name; the first is held to be the best


class Site(Table):
    """A lane: soil, kind of mine and its body, and numbers of mines by depth (m)."""

    title: str
    scene: str
    kind: str
    body: str | None = None  #: packaged body; None takes the generic one of the kind
    training: dict[str, int]
    test: dict[str, int]

    def mine(self, **position: float) -> Entries:
        """Return a mine of this lane at a position, as scenes hold targets."""
        entries: Entries = {"kind": self.kind}
        if self.body is not None:
            entries["body"] = self.body
        return entries | position

    def depths(self, share: float = 1.0) -> tuple[FloatArray, BoolArray]:
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
    sweeps: Sweeps
    sites: dict[str, Site]
    questions: dict[str, str]

    @property
    def soils(self) -> dict[str, str]:
        """Title of each soil of the paper that has a lane, by the name of its site."""
        return {soil: self.sites[soil].title for soil in SOILS if soil in self.sites}

    @property
    def main(self) -> str:
        """Name of the detector that is scored."""
        return f"rank {self.detector.rank}"

    @property
    def cuts(self) -> CutSettings:
        """How samples are taken: the settings of the stage that maps by forms."""
        return CutSettings(**(self.cut.model_dump() | self.training.model_dump()))


def study_recipe(quick: bool = False, world: str = OWN) -> StudyRecipe:
    """Load the packaged recipe of the study, on the lanes of a world."""
    sites = {
        name: {"scene": site} for name, site in study_world("cosgrove2004", world).sites.items()
    }
    return packaged("cosgrove2004", StudyRecipe, quick, {"sites": sites})

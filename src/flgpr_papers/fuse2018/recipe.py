"""The recipe of the study of Fuse et al. 2018."""

from __future__ import annotations

import tomllib
from typing import Annotated

from pydantic import Field

from flgpr.chain.recipe import Recipe, recipe_text
from flgpr.model import Grid, Lane
from flgpr_papers.kit.settings import Table, packaged

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Span = tuple[float, float]


class Radar(Table):
    """Errors of the navigation (m, rad), simulated ground (m), surface scatterers per m², in X alone and in both."""

    position: NotNegative
    heading: NotNegative
    footprint: tuple[float, float, float, float]
    scatterers_x: Positive
    scatterers: Positive | None = None


class Lanes(Table):
    """The three lanes: metres, mines per depth, objects per metre."""

    length: Positive
    half_width: Positive
    depths: tuple[float, ...]
    mines: Annotated[int, Field(ge=1)]
    site: str
    bushes: NotNegative
    posts: NotNegative
    roadside: Span
    step: Span
    start: float
    wander: NotNegative
    seeds: dict[str, int]


class Image(Table):
    """Images ahead of the latest frame (m), frames summed, borders of the sub-regions in range (m)."""

    x: Span
    y: Span
    spacing: Positive
    frames: Annotated[int, Field(ge=2)]
    edges: tuple[float, ...]


class Mask(Table):
    """Radius about a calibration target (m), extent of its response (dB) and the roadside (m)."""

    halo: Positive
    response_db: Positive
    roadside: Span


class Suppress(Table):
    """Iterations, and the combination of Table II that is scored."""

    iterations: Annotated[int, Field(ge=7)]
    combination: Annotated[int, Field(ge=1, le=6)]


class Score(Table):
    """Detection area of a frame (m), halo's diameter and alarms' radius (m), false alarm rates (per m²)."""

    x: Span
    y: Span
    halo: Positive
    radius: Positive
    far_max: Positive
    far: Positive


class Boxes(Table):
    """Clutter boxes: side and distance to the image's border (m); draws of every bootstrap."""

    side: Positive
    margin: NotNegative
    draws: Annotated[int, Field(ge=100)]


class Study(Table):
    """Place of the example frame (m); steps from aperture to aperture; the looser navigation that is tried (m rms)."""

    example: float
    every: Annotated[int, Field(ge=1)]
    loose_every: Annotated[int, Field(ge=1)]
    loose_position: Positive


class FuseRecipe(Table):
    """All that the study depends on."""

    name: str
    description: str
    radar: Radar
    lanes: Lanes
    image: Image
    mask: Mask
    suppress: Suppress
    score: Score
    boxes: Boxes
    study: Study

    @property
    def lane(self) -> Lane:
        """The rectangle that is scored as a lane: as wide as the detection area."""
        return Lane(*self.score.x, 0.0, self.lanes.length)

    @property
    def area(self) -> Lane:
        """The detection area of a frame, in its scan frame."""
        return Lane(*self.score.x, *self.score.y)

    @property
    def map_grid(self) -> Grid:
        """Pixels of a lane's map, in the lane frame: more than is scored, so that peaks at the border are whole."""
        return Grid.spanning(self.image.x, (0.0, self.lanes.length + 2.0), self.image.spacing)

    def chain(self) -> Recipe:
        """Load the recipe that detection is run with, and give it the study's images and masks."""
        held, image = tomllib.loads(recipe_text("fuse2018")), self.image.model_dump()
        masks = {"edges": image.pop("edges"), "frames": image["frames"], **dict(self.mask), **dict(self.suppress)}
        held["image"] |= image
        held["clutter"] = [one | masks if one["stage"] == "masks" else one for one in held["clutter"]]
        return Recipe.model_validate(held)


def fuse_recipe(quick: bool = False) -> FuseRecipe:
    """Load the packaged recipe of the study."""
    return packaged("fuse2018", FuseRecipe, quick)

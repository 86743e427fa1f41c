"""The two worlds of each study.

Prepared lanes as its paper describes them, and the same lanes on roads as found.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import Field

from flgpr_papers.kit.findings import read_findings
from flgpr_papers.kit.settings import Table, packaged_text

OWN = "own"
AS_FOUND = "as-found"
STUDY_WORLDS = (OWN, AS_FOUND)
"""Prepared lanes as the paper describes them, and roads as they are found.

Those have stones, holes, growth and waves.
"""
Claim = tuple[str, str, str]
"""What tells a statement from others: claim, quantity and group."""


class Description(Table):
    """What a paper says of its lanes, in our words, and what that gives here."""

    paper: str  #: what it says; empty where it says nothing
    place: str  #: section or paragraph
    here: str  #: site, mines or roadside that it gives

    @property
    def row(self) -> tuple[str, str, str]:
        """Cells of the page's table."""
        return self.paper, self.place, self.here


class StudyWorld(Table):
    """Lanes of a study in one world, as its file ``lanes.toml`` declares them."""

    title: str  #: in words, for pages
    sites: dict[
        str, str
    ]  #: packaged site of each lane of the study, by the study's own name of the lane
    mixes: dict[str, str] = Field(
        default_factory=dict
    )  #: mix of bodies by kind of target; without one the kind's generic body
    described: tuple[Description, ...] = ()


@dataclass(frozen=True)
class OtherWorld:
    """What the same study gives on roads as found: read from its folder, to be shown beside."""

    page: str = ""  #: path of its page, relative to the study's; empty if it has not been run
    #: ours with its interval, and the verdict, by claim
    found: Mapping[Claim, tuple[str, str]] = field(default_factory=dict)


def check_study_world(world: str) -> None:
    """Refuse a world that no study has, with a ValueError."""
    if world not in STUDY_WORLDS:
        raise ValueError(f"world must be one of {', '.join(STUDY_WORLDS)}, got {world!r}")


def study_world(paper: str, world: str = OWN) -> StudyWorld:
    """Return the declared lanes of a study in a world.

    Raises
    ------
    ValueError
        If there is no such world.
    """
    check_study_world(world)
    tables = tomllib.loads(packaged_text(paper, "lanes"))
    return StudyWorld.model_validate(tables[world])


def world_folder(folder: Path, world: str) -> Path:
    """Return the folder in which a study works in a world.

    That of roads as found lies in the other one.
    """
    return folder if world == OWN else folder / world


def other_world(folder: Path, page: str, world: str, quick: bool) -> OtherWorld:
    """Read the findings of a study on roads as found, if it ran in a folder.

    It must have run in the same form, quick or full.

    A study that itself runs on roads as found has nothing beside it.
    """
    other_folder = world_folder(folder, AS_FOUND)
    if (
        world != OWN
        or not (other_folder / "findings.json").is_file()
        or not (other_folder / page).is_file()
    ):
        return OtherWorld()
    if json.loads((other_folder / "findings.json").read_text("utf-8"))["quick"] != quick:
        return OtherWorld()
    findings = {
        (finding.claim, finding.quantity, finding.group): (finding.ours, finding.verdict)
        for finding in read_findings(other_folder)
    }
    return OtherWorld(f"{AS_FOUND}/{page}", findings)

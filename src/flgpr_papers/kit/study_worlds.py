"""The two worlds of each study: prepared lanes as its paper describes them, and roads as found."""

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
"""Names of the worlds: prepared lanes as the paper describes them, and roads as they are found.

Roads as found have stones, holes, growth and waves.
"""
Claim = tuple[str, str, str]
"""What identifies a statement of a study: claim, quantity and group."""


class Description(Table):
    """What a paper says of its lanes, in our words, and what it becomes in the simulation."""

    paper: str  #: what the paper says; empty where it says nothing
    place: str  #: section or paragraph of the paper
    here: str  #: site, mines or roadside of the simulated lanes

    @property
    def row(self) -> tuple[str, str, str]:
        """Cells of the page's table."""
        return self.paper, self.place, self.here


class StudyWorld(Table):
    """Lanes of a study in one world, as its file ``lanes.toml`` declares them."""

    title: str  #: in words, for pages
    #: packaged site of each lane of the study, by the study's own name of the lane
    sites: dict[str, str]
    #: mix of bodies by kind of target; a kind without a mix has its generic body
    mixes: dict[str, str] = Field(default_factory=dict)
    described: tuple[Description, ...] = ()


@dataclass(frozen=True)
class OtherWorld:
    """Page and verdicts of the same study on roads as found, for the page on prepared lanes."""

    page: str = ""  #: path of its page, relative to the study's; empty if it has not been run
    #: ours with its interval, and the verdict, by statement
    found: Mapping[Claim, tuple[str, str]] = field(default_factory=dict)


def check_study_world(world: str) -> None:
    """Check that a study has a world of this name, and raise a ValueError otherwise."""
    if world not in STUDY_WORLDS:
        raise ValueError(f"world must be one of {', '.join(STUDY_WORLDS)}, got {world!r}")


def study_world(paper: str, world: str = OWN) -> StudyWorld:
    """Return the declared lanes of a study in a world.

    Parameters
    ----------
    paper : str
        Name of the paper.
    world : str
        One of ``STUDY_WORLDS``.

    Raises
    ------
    ValueError
        If there is no such world.
    """
    check_study_world(world)
    tables = tomllib.loads(packaged_text(paper, "lanes"))
    return StudyWorld.model_validate(tables[world])


def world_folder(folder: Path, world: str) -> Path:
    """Return the folder of a study in a world: for roads as found a folder within the other."""
    return folder if world == OWN else folder / world


def other_world(folder: Path, page: str, world: str, quick: bool) -> OtherWorld:
    """Read the findings of a study on roads as found, to show them on its page on prepared lanes.

    Parameters
    ----------
    folder : Path
        Folder of the study on prepared lanes.
    page : str
        File name of the study's page.
    world : str
        World in which the study runs now.
    quick : bool
        Whether the study is a quick run. Only findings of the same form are read.

    Returns
    -------
    OtherWorld
        Empty if there are no such findings, or if the study itself runs on roads as found.
    """
    as_found_folder = world_folder(folder, AS_FOUND)
    findings_file = as_found_folder / "findings.json"
    if world != OWN or not findings_file.is_file() or not (as_found_folder / page).is_file():
        return OtherWorld()
    if json.loads(findings_file.read_text("utf-8"))["quick"] != quick:
        return OtherWorld()
    findings = {
        (one.claim, one.quantity, one.group): (one.ours, one.verdict)
        for one in read_findings(as_found_folder)
    }
    return OtherWorld(f"{AS_FOUND}/{page}", findings)

"""The papers, and the settings of a study: one TOML file beside its modules."""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import TypeVar

from pydantic import BaseModel, ConfigDict

from flgpr.store import merge_tables
from flgpr.types import Entries

T = TypeVar("T", bound=BaseModel)
Span = tuple[float, float]
"""Both ends of what is long, broad or allowed; or a size in x and y."""
PAPERS = {
    "cosgrove2004": "Cosgrove, Milanfar & Kositsky 2004: trained detection by deflection",
    "flsar2004": "flsar2004: prescreeners, templates and relevance vector machines",
    "fuse2018": (
        "Fuse, Gonzalez-Valdes, Martinez-Lorenzo & Rappaport 2018: model-based clutter suppression"
    ),
    "wang2007": "Wang, Keller, Gader & Sjahputera 2007: sub-bands and ten features",
}
"""Every paper that can be run again: authors, year and subject by name."""


class Table(BaseModel):
    """A table of a study's settings; an unknown entry is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def packaged_text(paper: str, name: str = "study") -> str:
    """Read the packaged settings of a paper's study, or another TOML file beside them."""
    file = resources.files(f"flgpr_papers.{paper}") / f"{name}.toml"
    return file.read_text(encoding="utf-8")


def packaged(paper: str, kind: type[T], quick: bool = False, more: Entries | None = None) -> T:
    """Load the packaged settings of a paper's study.

    Parameters
    ----------
    paper : str
        Name of the paper.
    kind : type
        Model of the settings, which checks them.
    quick : bool
        Whether the entries of the table ``quick`` replace those of the other tables.
    more : mapping, optional
        Entries of nested tables that replace the packaged ones, as for the lanes of a world.
    """
    tables = merge_tables(tomllib.loads(packaged_text(paper)), more or {})
    quick_tables = tables.pop("quick", {})
    if quick:
        tables = merge_tables(tables, quick_tables)
    return kind.model_validate(tables)

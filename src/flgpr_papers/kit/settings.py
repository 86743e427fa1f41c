"""The settings of a study: one TOML file beside its modules, nothing unknown allowed."""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import TypeVar

from pydantic import BaseModel, ConfigDict

T = TypeVar("T", bound=BaseModel)


class Table(BaseModel):
    """A table of a study's settings."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def packaged_text(paper: str) -> str:
    """Read the packaged settings of a paper's study."""
    return (resources.files(f"flgpr_papers.{paper}") / "study.toml").read_text(encoding="utf-8")


def packaged(paper: str, kind: type[T]) -> T:
    """Load the packaged settings of a paper's study."""
    return kind.model_validate(tomllib.loads(packaged_text(paper)))

"""What the viewer and the writers of results agree on: names, formats and the seal of a score."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    field_validator,
    model_validator,
)

from flgpr.json_text import canonical_json, parse_json, sha256
from flgpr.model.faults import first_fault_of

VIEW_FORMAT = "flgpr-view"
VIEW_VERSION = 1
VIEW_SCORE = "view/score.json"
"""File of a result's score, in the result or in a folder of its own."""
_SCORE_FORMAT = "flgpr-view-score"
_SCORE_VERSION = 1
_MOST_COUNT = 2**40  # of rows, columns and values: far more than any view has


def sealed_view_score(content: Mapping[str, Any]) -> bytes:
    """Return the bytes of ``view/score.json``.

    Parameters
    ----------
    content : mapping
        What the page shows; its entry ``result_sha256`` names the result.

    Returns
    -------
    bytes
        The content behind a head with its digest.
    """
    body = canonical_json(content)
    head = {"format": _SCORE_FORMAT, "version": _SCORE_VERSION, "sha256": sha256(body)}
    return canonical_json(head)[:-1] + b',"content":' + body + b"}\n"


def view_score_body(data: bytes, identity: str) -> bytes:
    """Return the content of ``view/score.json`` as canonical JSON.

    Parameters
    ----------
    data : bytes
        Bytes of the file, from anywhere.
    identity : str
        Identity of the result that it must belong to.

    Returns
    -------
    bytes
        What :func:`sealed_view_score` sealed.

    Raises
    ------
    ValueError
        If it cannot be read, is altered or belongs to another result; a verb begins the message.
    """
    try:
        stored = parse_json(data)
        digest = stored["sha256"]
        owner = stored["content"]["result_sha256"]
        body = canonical_json(stored["content"])
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"cannot be read ({error})") from None
    if sha256(body) != digest:
        raise ValueError("differs from what was written")
    if owner != identity:
        raise ValueError("belongs to another result")
    return body


class _Entries(BaseModel):
    """What a server computes with of a table of the index; other entries are the page's."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


_Count = Annotated[int, Field(ge=0, le=_MOST_COUNT)]
_Metres = Annotated[float, Field(gt=-_MOST_COUNT, lt=_MOST_COUNT)]


class _Lane(_Entries):
    x_min: _Metres
    x_max: _Metres
    y_min: _Metres
    y_max: _Metres


class _Grid(_Entries):
    nx: Annotated[int, Field(ge=1, le=_MOST_COUNT)]


class _Level(_Entries):
    file: str
    rows: _Count


class _Layer(_Entries):
    levels: list[_Level]


class _Evidence(_Entries):
    file: str = ""
    start: list[_Count] = Field(default_factory=list)

    @field_validator("start")
    @classmethod
    def _ascends(cls, start: list[int]) -> list[int]:
        if start != sorted(start):
            raise ValueError("must ascend, got places in the file that do not")
        return start


class _Detection(_Entries):
    evidence: _Evidence = _Evidence()


class _Index(_Entries):
    title: str
    lane: _Lane
    georeference: dict[str, Any] | None = None
    grid: _Grid | None = None
    tile_rows: _Count = 0
    layers: list[_Layer]
    detections: list[_Detection]

    @model_validator(mode="after")
    def _has_tiles(self) -> _Index:
        if self.layers and (self.grid is None or not self.tile_rows):
            raise ValueError("grid and tile_rows must be given for layers")
        return self


def check_view_index(index: Any) -> dict[str, Any]:
    """Return the index of a result's view, of which all that a server computes with was checked.

    Parameters
    ----------
    index : JSON value
        Content of ``view/index.json``, from anywhere.

    Returns
    -------
    dict
        The index.

    Raises
    ------
    ValueError
        If an entry is missing or of another kind; the error names it.
    """
    head = (index.get("format"), index.get("version")) if isinstance(index, dict) else ()
    if head != (VIEW_FORMAT, VIEW_VERSION):
        raise ValueError(f"it must be {VIEW_FORMAT} version {VIEW_VERSION}")
    with first_fault_of(_Index, "it"):
        _Index.model_validate(index)
    return dict(index)

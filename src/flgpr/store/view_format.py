"""What the viewer and the writers of results agree on: names, formats and the seal of a score."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from flgpr.json_text import canonical_json, parse_json, sha256

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
    _must_be(index, dict, "it")
    if index.get("format") != VIEW_FORMAT or index.get("version") != VIEW_VERSION:
        raise ValueError(f"it must be {VIEW_FORMAT} version {VIEW_VERSION}")
    _must_be(index.get("title"), str, "title")
    lane = index.get("lane")
    _must_be(lane, dict, "lane")
    for name in ("x_min", "x_max", "y_min", "y_max"):
        value = lane.get(name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not abs(value) < _MOST_COUNT:
            raise ValueError(f"lane.{name} must be a number, got {_shown(value)}")
    if index.get("georeference") is not None:
        _must_be(index["georeference"], dict, "georeference")
    layers = _must_be(index.get("layers"), list, "layers")
    if layers:
        _count(index.get("tile_rows"), "tile_rows", least=1)
        _count(_must_be(index.get("grid"), dict, "grid").get("nx"), "grid.nx", least=1)
    for number, layer in enumerate(layers):
        where = f"layers[{number}]"
        _must_be(layer, dict, where)
        for level in _must_be(layer.get("levels"), list, f"{where}.levels"):
            _must_be(level, dict, f"{where}.levels")
            _must_be(level.get("file"), str, f"{where}.levels.file")
            _count(level.get("rows"), f"{where}.levels.rows")
    for number, detection in enumerate(_must_be(index.get("detections"), list, "detections")):
        where = f"detections[{number}]"
        _must_be(detection, dict, where)
        if "evidence" in detection:
            _check_evidence(detection["evidence"], f"{where}.evidence")
    return dict(index)


def _check_evidence(evidence: Any, where: str) -> None:
    """Refuse evidence of alarms whose places in its file are no ascending numbers."""
    _must_be(evidence, dict, where)
    _must_be(evidence.get("file"), str, f"{where}.file")
    last = 0
    for place in _must_be(evidence.get("start"), list, f"{where}.start"):
        last = _count(place, f"{where}.start", least=last)


def _must_be(value: Any, kind: type, name: str) -> Any:
    """Return a value of JSON if it is of a kind."""
    if not isinstance(value, kind):
        kinds: dict[type, str] = {dict: "an object", list: "a list", str: "text"}
        raise ValueError(f"{name} must be {kinds[kind]}, got {_shown(value)}")
    return value


def _count(value: Any, name: str, least: int = 0) -> int:
    """Return a value of JSON if it is a whole number from ``least`` on."""
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    if not is_whole or not least <= value <= _MOST_COUNT:
        raise ValueError(f"{name} must be a whole number from {least} on, got {_shown(value)}")
    return int(value)


def _shown(value: Any) -> str:
    """Return a value of JSON as a short text."""
    if isinstance(value, dict | list):
        return "an object" if isinstance(value, dict) else "a list"
    return "null" if value is None else repr(value)[:40]

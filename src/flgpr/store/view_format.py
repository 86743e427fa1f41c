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

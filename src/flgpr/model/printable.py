"""Text of files and paths, made safe for a terminal, one line of a comment or message, or a file."""

from __future__ import annotations

import re

_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufffe\uffff\ud800-\udfff]"
)
"""Characters that steer a terminal, turn the direction of text or are none; not tab and line end."""


def printable(text: str) -> str:
    """Return text in which what is not seen is written as an escape, so that a line stays one."""
    letters = []
    for letter in text:
        letters.append(letter if letter.isprintable() else repr(letter)[1:-1])
    return "".join(letters)


def for_terminal(text: str) -> str:
    r"""Return lines of text in which what steers a terminal is written as an escape.

    A title or a name of a file that somebody else made could otherwise clear the screen, write over
    what stands there, or type on behalf of the user.

    Parameters
    ----------
    text : str
        Any text; ends of lines and tabs stay.

    Returns
    -------
    str
        The text, with escapes such as ``\x1b``.
    """
    return _UNSEEN.sub(lambda found: repr(found[0])[1:-1], text)


def text_bytes(text: str) -> bytes:
    r"""Return text as UTF-8; half of a pair of surrogates, which is no character, as an escape.

    Names of files that are not UTF-8 hold such halves.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    bytes
        The text, with escapes such as ``\udcff``.
    """
    return text.encode("utf-8", "backslashreplace")


def in_one_line(error: Exception, most: int | None = None) -> str:
    """Return the message of an error in one line of ``most`` characters, or its name without one.

    Messages of other people's libraries may run over several lines and quote a file at length.
    """
    return " ".join(str(error).split())[:most] or type(error).__name__


def shortened(text: str, most: int = 100) -> str:
    """Return the beginning of a text that may come from anybody, for a message."""
    return text if len(text) <= most else f"{text[:most]}..."

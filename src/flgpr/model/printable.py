"""Text of files and paths, made safe for one line of a comment, a message or a terminal."""

from __future__ import annotations


def printable(text: str) -> str:
    """Return text in which what is not seen is written as an escape, so that a line stays one."""
    letters = []
    for letter in text:
        letters.append(letter if letter.isprintable() else repr(letter)[1:-1])
    return "".join(letters)

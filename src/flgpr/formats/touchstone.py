"""Touchstone files as their library reads them without a loss: in the order of frequency, and as text of any encoding.

In a file of two ports of version 1, lines of five numbers behind the sweep are noise parameters, and begin where the
frequency falls (Touchstone File Format Specification, version 1.1). scikit-rf takes any tone below the one before for
that, so that a sweep from high to low would come as its first tone alone.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

from flgpr.door import read_named
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.store.text import decode_text

_NOISE = 5  # numbers of a line of noise parameters
_PORTS = re.compile(r"\.s(\d+)p", re.IGNORECASE)


class TouchstoneText(io.StringIO):
    """The text of a file with its name, by which the library knows the number of ports."""

    def __init__(self, text: str, path: Path, tones: int) -> None:
        super().__init__(text)
        self.name = str(path)
        self.tones = tones  #: how many tones it holds; 0 if that is not told


def touchstone_text(path: Path, notes: list[str]) -> TouchstoneText:
    """Return a file's text with its tones in the order of frequency; ``notes`` tell of changes and of what is not read.

    Numbers that make no whole number of tones are a ValueError.
    """
    text = decode_text(read_named(path, MAX_MEMORY), path.name, notes)
    head, rows = _parts(text)
    keywords = {
        name.lower(): value
        for name, value in re.findall(r"^\s*\[(.*?)\][ \t]*(\S*)", text, re.MULTILINE)
    }
    if keywords:  # of version 2, which marks where noise begins
        stated = keywords.get("number of frequencies", "")
        noise = _noise_lines(text)
        if noise:
            notes.append(f"{noise} lines of noise parameters are not read")
        return TouchstoneText(text, path, int(stated) if stated.isdecimal() else 0)
    ports = _ports_of(path)
    size = 1 + 2 * ports**2
    noise = 0
    while ports == 2 and len(rows) > 1 and len(rows[-1]) == _NOISE:
        rows.pop()
        noise += 1
    numbers = [number for row in rows for number in row]
    if len(numbers) % size or not numbers:
        raise ValueError(
            f"its numbers must be {size} for every tone of {ports} ports, got {len(numbers)}"
        )
    tones = [numbers[at : at + size] for at in range(0, len(numbers), size)]
    ordered = sorted(tones, key=lambda tone: float(tone[0]))
    if noise:
        notes.append(f"{noise} lines of noise parameters are not read")
    if ordered != tones:
        notes.append(f"its {len(tones)} tones do not rise: they are put in the order of frequency")
    elif not noise:
        return TouchstoneText(text, path, len(tones))
    body = [" ".join(tone) for tone in ordered]
    return TouchstoneText("\n".join([*head, *body]) + "\n", path, len(tones))


def _parts(text: str) -> tuple[list[str], list[list[str]]]:
    """Part the lines of comments, options and keywords from the rows of numbers."""
    head = []
    rows = []
    for line in text.splitlines():
        plain = line.partition("!")[0].strip()
        if not plain or plain[0] in "#[":
            head.append(line)
        else:
            rows.append(plain.split())
    return head, rows


def _noise_lines(text: str) -> int:
    """Count the lines of noise parameters of version 2, which stand behind the keyword Noise Data."""
    _, keyword, behind = text.lower().partition("[noise data]")
    lines = behind.partition("[end]")[0].splitlines() if keyword else []
    return sum(bool(line.partition("!")[0].strip()) for line in lines)


def _ports_of(path: Path) -> int:
    """Return the number of ports that the ending tells."""
    ending = _PORTS.fullmatch(path.suffix)
    if ending is None or not 1 <= int(ending[1]) <= 999:
        raise ValueError(
            f"the ending must tell the number of ports, such as .s2p, got {path.suffix!r}"
        )
    return int(ending[1])

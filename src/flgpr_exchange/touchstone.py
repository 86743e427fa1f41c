"""Touchstone files as their library reads them without a loss.

In a file of two ports of version 1, lines of five numbers behind the sweep are noise parameters,
and begin where the frequency falls (Touchstone File Format Specification, version 1.1). scikit-rf
takes any tone below the one before for that, so that a sweep from high to low would come as its
first tone alone. Therefore the tones are sorted by frequency first.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from flgpr.formats.array_file import ArrayFile, from_memory
from flgpr.formats.reader import Reader
from flgpr.store.extras import optional
from flgpr.store.text import text_of
from flgpr.types import Notes

_NOISE = 5  # numbers of a line of noise parameters
_PORTS = re.compile(r"\.s(\d+)p", re.IGNORECASE)


class TouchstoneText(io.StringIO):
    """The text of a file with its name, by which the library knows the number of ports."""

    def __init__(self, text: str, path: Path, tones: int) -> None:
        super().__init__(text)
        self.name = str(path)
        self.tones = tones  #: how many tones it holds; 0 if the file does not state it


def touchstone_text(path: Path, notes: Notes) -> TouchstoneText:
    """Return a file's text, of any encoding, with its tones in the order of frequency.

    Parameters
    ----------
    path : Path
        The file.
    notes : list of str
        Changes, and what is not read, are added to it.

    Returns
    -------
    TouchstoneText
        The text as scikit-rf takes it.

    Raises
    ------
    ValueError
        If the numbers make no whole number of tones, or the ending names no number of ports.
    """
    text = text_of(path, notes)
    keywords = {
        name.lower(): value
        for name, value in re.findall(r"^\s*\[(.*?)\][ \t]*(\S*)", text, re.MULTILINE)
    }
    if keywords:  # of version 2, which marks where noise begins
        stated = keywords.get("number of frequencies", "")
        noise_lines = text.lower().partition("[noise data]")[2].partition("[end]")[0].splitlines()
        _note_noise(sum(bool(line.partition("!")[0].strip()) for line in noise_lines), notes)
        return TouchstoneText(text, path, int(stated) if stated.isdecimal() else 0)

    head = []  # lines of comments, options and keywords
    rows = []  # of numbers
    for line in text.splitlines():
        content = line.partition("!")[0].strip()
        if content[:1] == "#":
            line = _option_line(content)
        if not content or content[0] in "#[":
            head.append(line)
        else:
            rows.append(content.split())
    if not any(line.lstrip().startswith("#") for line in head):
        notes.append(
            "it has no option line: frequencies are taken in GHz, numbers as magnitude and degrees "
            "of S, as the standard has it"
        )
    ending = _PORTS.fullmatch(path.suffix)
    ports = int(ending[1]) if ending else 0
    if not 1 <= ports <= 999:
        raise ValueError(
            f"the ending must tell the number of ports, such as .s2p, got {path.suffix!r}"
        )
    noise = 0
    while ports == 2 and len(rows) > 1 and len(rows[-1]) == _NOISE:
        rows.pop()
        noise += 1
    size = 1 + 2 * ports**2  # the frequency, and two numbers for each parameter
    numbers = [number for row in rows for number in row]
    if len(numbers) % size or not numbers:
        raise ValueError(
            f"its numbers must be {size} for every tone of {ports} ports, got {len(numbers)}"
        )
    tones = [numbers[begin : begin + size] for begin in range(0, len(numbers), size)]
    ordered = sorted(tones, key=lambda tone: float(tone[0]))
    _note_noise(noise, notes)
    if ordered != tones:
        notes.append(f"its {len(tones)} tones do not rise: they are put in the order of frequency")
    lines = head + [" ".join(tone) for tone in ordered]
    return TouchstoneText("\n".join(lines) + "\n", path, len(tones))


_OPTIONS = ({"HZ", "KHZ", "MHZ", "GHZ"}, set("SYZGH"), {"DB", "MA", "RI"})
"""Words of an option line, in the order in which the library reads them: unit, parameter, format."""


def _option_line(line: str) -> str:
    """Return an option line in the order that the library reads; one of unknown words as it is.

    By the standard its words have any order, and GHz, S, MA and R 50 need not be stated.
    """
    words = line[1:].upper().split()
    resistance = "50"
    if "R" in words[:-1]:
        place = words.index("R")
        resistance = words[place + 1]
        del words[place : place + 2]
    if not all(any(word in kind for kind in _OPTIONS) for word in words):
        return line
    stated = [
        next((word for word in words if word in kind), usual)
        for kind, usual in zip(_OPTIONS, ("GHZ", "S", "MA"), strict=True)
    ]
    return " ".join(["#", *stated, "R", resistance])


def _note_noise(lines: int, notes: Notes) -> None:
    """Add a note of the lines of noise parameters, if there are any."""
    if lines:
        notes.append(f"{lines} lines of noise parameters are not read")


class TouchstoneReader(Reader):
    """Touchstone files of a network analyser, read by scikit-rf."""

    kind = "Touchstone file"
    names = "Touchstone (.s2p)"
    reads = frozenset({"arrays"})

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether the ending is that of a Touchstone file."""
        return re.fullmatch(r"\.(s\d+p|ts)", path.suffix.lower()) is not None

    def open_arrays(self, path: Path, limit: int) -> ArrayFile:
        """Open the scattering parameters, all and one by one."""
        notes: Notes = []
        library = optional("skrf", "vna")
        text = touchstone_text(path, notes)
        network = library.Network()
        network.read_touchstone(text)  # given a file, the class itself tries whether it is a pickle
        parameters = np.asarray(network.s)
        frequency = np.asarray(network.f, dtype=np.float64)
        if text.tones not in (0, frequency.size):
            raise ValueError(
                f"it holds {text.tones} tones, of which the scikit-rf library reads {frequency.size}"
            )
        arrays = {"frequency": frequency, "s": parameters}
        separator = "" if network.nports < 10 else "_"
        for row, column in np.ndindex(parameters.shape[1:]):
            arrays[f"s{row + 1}{separator}{column + 1}"] = parameters[:, row, column]
        units = dict.fromkeys(arrays, "1") | {"frequency": "Hz"}
        return ArrayFile(path, self.kind, *from_memory(arrays, units), limit, [], notes)


READER = TouchstoneReader()

"""Tables of alarms, truth and objects as other programs and other languages write them.

Columns are found by their names in English, German, French, Spanish, Italian and Portuguese, with
or without a unit, or by what the user says. Lengths in other units are converted to metres, and an
anchor takes places on the Earth to the lane. The notes list every such change.
"""

from __future__ import annotations

import csv
import io
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import pandas as pd

from flgpr.model.tables import TABLES, to_numbers
from flgpr.model.units import UNITS
from flgpr.types import ArrayLike, FloatArray

PLACES = ("longitude", "latitude", "easting", "northing")
"""Columns of a position on the Earth instead of x and y; degrees or metres."""
_SYNONYMS: dict[str, str] = {
    "x": (
        "x cross across cross_track crosstrack lateral right rechts quer querab droite "
        "travers transversal transversale trasversale derecha través destra traverso direita transverso"
    ),
    "y": (
        "y along along_track down_track downtrack forward chainage distance vorwärts längs "
        "laengs strecke station longitudinal longitudinale avant avance adelante avanti frente progressiva"
    ),
    "confidence": (
        "confidence score probability conf konfidenz wahrscheinlichkeit bewertung güte "
        "confiance probabilité confianza probabilidad puntuación confidenza probabilità "
        "punteggio confiança probabilidade pontuação"
    ),
    "kind": (
        "kind type class category art typ klasse sorte genre catégorie tipo clase "
        "clasificación classe categoria espécie"
    ),
    "depth": "depth burial_depth tiefe überdeckung profondeur profundidad profondità profundidade",
    "radius": "radius halbmesser rayon radio raggio raio",
    "height": "height höhe hoehe hauteur altura altezza",
    "lane": "lane spur gasse bahn couloir voie carril corsia faixa",
    "longitude": "longitude lon long lng länge laenge longitud longitudine",
    "latitude": "latitude lat breite latitud latitudine",
    "easting": "easting east utm_east utm_e rechtswert ostwert est este leste",
    "northing": "northing north utm_north utm_n hochwert nordwert nord norte",
}
"""Synonyms of each column in six languages, separated by blanks."""
_ID_SYNONYMS = "id nr no num number name nummer numéro número numero nome nom nombre code label"
_SYNONYMS_OF_ONE_ID = {
    "alarm_id": "alarm alarms alarme alarma allarme detection",
    "target_id": "target mine ziel mina cible objetivo bersaglio alvo",
    "object_id": "object objekt objet objeto oggetto",
}
_LINE_END = re.compile(r"\r\n|\r|\n")  # not what else a text calls one, which cells may hold
_NUMBER_OR_EMPTY = re.compile(r"[-+]?[\d.,]+([eE][-+]?\d+)?|")
_SUFFIX = re.compile(r"(?P<name>.*\w)[_ ](?P<unit>m|cm|mm|km|ft|in|deg)", re.IGNORECASE)
_LENGTHS = ("x", "y", "depth", "radius", "height", "easting", "northing")
_ANGLES = ("longitude", "latitude")
_DEGREES = [
    "deg",
    "°",
    "degree",
    "degrees",
    "grad",
    "degré",
    "degrés",
    "grado",
    "gradi",
    "grados",
    "graus",
]
_NO_UNIT = ("", "1", "-", "%")
_MARKS = ";\t,"


class EarthAnchor(Protocol):
    """Conversion of places on the Earth to a lane, such as :class:`flgpr.geo.Anchor`."""

    @property
    def origin(self) -> tuple[float, float, float]:
        """Return longitude and latitude, degrees, and height, m, of the lane's contact point."""

    def to_lonlat(self, points: ArrayLike) -> FloatArray:
        """Return longitude and latitude of easting and northing (..., 2)."""

    def from_geodetic(self, position: ArrayLike) -> FloatArray:
        """Return lane coordinates of longitude, latitude and height (..., 3)."""


@dataclass(frozen=True)
class TableReading:
    """How a user says a table is to be read."""

    #: name that flgpr knows -> name in the file
    columns: Mapping[str, str] = field(default_factory=dict)
    #: takes longitude and latitude, or easting and northing, to the lane
    anchor: EarthAnchor | None = None
    #: whether alarms may lack confidences: then all alarms of the list rank equal
    unranked: bool = False


def parse_columns_option(text: str) -> dict[str, str]:
    """Return ``x=Rechts,y=Hoch`` as a mapping.

    Parameters
    ----------
    text : str
        The text of the option.

    Returns
    -------
    dict of str to str
        The file's name of every column that flgpr knows.

    Raises
    ------
    ValueError
        If the text is anything else, or names a column twice.
    """
    columns: dict[str, str] = {}
    for pair in text.split(","):
        name, equals, column = pair.partition("=")
        name = name.strip()
        column = column.strip()
        is_pair = bool(equals and name and column)
        if not is_pair or name in columns:
            raise ValueError(
                f"columns must be NAME=COLUMN, each name once, between commas, got {text!r}"
            )
        columns[name] = column
    return columns


def without_comments(text: str, kind: str) -> tuple[str, list[str]]:
    """Return a table's text without comments, and notes on what was left out.

    Comments are lines that begin with ``#``, and a first line ``sep=;``. A commented line that has
    as many cells as the first line of numbers, and stands right before it, is the header. A row
    whose first cell is a name that begins with ``#`` stays: it has as many cells as the header,
    which begins with a column of names.

    Parameters
    ----------
    text : str
        The text of the table.
    kind : str
        "alarms", "truth" or "objects".

    Returns
    -------
    text : str
        The header and the rows.
    notes : list of str
        What was left out.
    """
    lines = _LINE_END.split(text)
    if not lines[-1]:
        lines.pop()
    first = 0
    if lines and re.fullmatch(r"\s*sep=.\s*", lines[0], re.IGNORECASE):
        first = 1
    while first < len(lines) and (not lines[first].strip() or _is_comment(lines[first])):
        first += 1
    if first == len(lines):
        return "", []
    # Lines stay where they are, and what is left out is empty: errors name lines of the file.
    commented = [number for number in range(first) if _is_comment(lines[number])]
    rows = [""] * first + lines[first:]
    notes: list[str] = []
    if commented and _is_numbers(lines[first]):
        header = lines[commented[-1]].lstrip("# \t")
        if _count_cells(header) == _count_cells(lines[first]):
            first = commented.pop()
            rows[first] = header
            notes.append(f"the header is commented out by a #: {header[:80]}")
    dropped = len(commented) + _leave_out_comments(rows, first, kind)
    if dropped:
        notes.append(f"{dropped} lines that begin with # left out")
    return "\n".join(rows) + "\n", notes


def _is_comment(line: str) -> bool:
    """Return whether a line begins with ``#``."""
    return line.lstrip().startswith("#")


def _leave_out_comments(rows: list[str], first: int, kind: str) -> int:
    """Empty the comments behind the header, which is row ``first``, and count them."""
    header = rows[first]
    width = _count_cells(header)
    names_of_rows = {_folded(name) for name in _synonyms_of_id(TABLES[kind][0].name)}
    begins_with_names = _folded(cells_of(header)[0]) in names_of_rows
    dropped = 0
    is_within = header.count('"') % 2 == 1  # a quoted cell, which may go over several lines
    for number in range(first + 1, len(rows)):
        line = rows[number]
        if is_within or not _is_comment(line):
            is_within ^= line.count('"') % 2 == 1
            continue
        is_row = begins_with_names and _count_cells(line) == width
        if not is_row:
            rows[number] = ""
            dropped += 1
    return dropped


def _is_numbers(line: str) -> bool:
    """Return whether every cell of a line is a number or empty, and not all are empty."""
    cells = [cell.strip() for cell in cells_of(line)]
    return all(_NUMBER_OR_EMPTY.fullmatch(cell) for cell in cells) and any(cells)


def separator_of(head: str) -> str:
    """Return the separator of a header's columns: semicolons, else tabs, else commas."""
    return next((mark for mark in _MARKS if mark in head), ",")


def first_line(text: str) -> str:
    """Return the first line of a table that is not empty; "" if there is none."""
    for line in io.StringIO(text, newline=None):
        if line.strip():
            return line.removesuffix("\n")
    return ""


def cells_of(line: str) -> list[str]:
    """Return the cells of a line."""
    try:
        return next(csv.reader([line], delimiter=separator_of(line)), [""])
    except csv.Error as error:
        raise ValueError(f"a line must hold cells of text: {error}") from None


def check_widths(text: str, mark: str, width: int | None = None, first: int = 1) -> None:
    """Refuse a table with a row of more or fewer cells than its header; empty lines are no rows.

    The arguments and the error are those of :func:`flgpr.store.tables.parse_csv`.
    """
    for number, count in _cell_counts(text, mark, first):
        if width is None:
            width = count
        if count != width:
            hint = (
                "decimal commas need semicolons or tabs between the columns" if mark == "," else ""
            )
            ending = f"; {hint}" if hint else ""
            raise ValueError(
                f"line {number} must have {width} cells like the header, got {count}{ending}"
            )


def _cell_counts(text: str, mark: str, first: int) -> Iterator[tuple[int, int]]:
    """Yield the number of every line that is not empty, and how many cells it has."""
    if '"' not in text:  # much faster than to parse the cells
        for number, line in enumerate(io.StringIO(text, newline=None), first):
            if line.strip(" \n"):
                yield number, line.count(mark) + 1
        return
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=mark)
    begin = first
    try:
        for cells in reader:
            number, begin = begin, first + reader.line_num
            if len(cells) > 1 or (cells and cells[0].strip(" ")):
                yield number, len(cells)
    except csv.Error as error:
        raise ValueError(f"line {begin} must hold cells of text: {error}") from None


def _count_cells(line: str) -> int:
    """Return the number of cells of a line."""
    return len(cells_of(line))


def column_targets(names: Sequence[str], kind: str, columns: Mapping[str, str]) -> dict[int, str]:
    """Return which columns of a file are which of a table's, by number in the header.

    Columns of the file that are none of the table's are left out.

    Parameters
    ----------
    names : sequence of str
        The header.
    kind : str
        "alarms", "truth" or "objects".
    columns : mapping of str to str
        What the user says: a table's name, and the file's name for it.

    Returns
    -------
    dict of int to str
        Column number, and the name that flgpr knows.

    Raises
    ------
    ValueError
        If a column that the user names is not there or unknown, or if two columns could be one.
    """
    known = [column.name for column in TABLES[kind]]
    targets = _columns_by_user(names, {*known, *PLACES}, columns)
    candidates = _columns_by_synonym(names, known, targets)
    for target, numbers in candidates.items():
        exact = [number for number in numbers if names[number] == target]
        chosen = exact or numbers
        if len({names[number].strip() for number in chosen}) < len(chosen):
            raise ValueError(
                f"{target} is {len(chosen)} times in the header: give each column a name of its own"
            )
        if len(chosen) > 1:
            choices = " or ".join(repr(names[number]) for number in chosen)
            raise ValueError(
                f"{target} could be the column {choices}: "
                f"say which by `columns` {target}={names[chosen[0]]}"
            )
        targets[chosen[0]] = target
    if not {"x", "y"} <= set(targets.values()):
        return targets
    return {number: target for number, target in targets.items() if target not in PLACES}


def _columns_by_user(
    names: Sequence[str], allowed: set[str], columns: Mapping[str, str]
) -> dict[int, str]:
    """Return the columns that the user names, by number."""
    targets: dict[int, str] = {}
    for target, column in columns.items():
        if target not in allowed:
            raise ValueError(
                f"columns must name one of {', '.join(sorted(allowed))}, got {target!r}"
            )
        numbers = [number for number, name in enumerate(names) if name.strip() == column]
        if len(numbers) > 1:
            raise ValueError(f"columns: {column!r} is {len(numbers)} times in the header")
        if not numbers:
            raise ValueError(
                f"columns: the file has no column {column!r} for {target}; it has {', '.join(names)}"
            )
        targets[numbers[0]] = target
    return targets


def _columns_by_synonym(
    names: Sequence[str], known: Sequence[str], by_user: Mapping[int, str]
) -> dict[str, list[int]]:
    """Return the columns that may be each of the table's by their names, besides ``by_user``."""
    synonyms = _synonyms_of_table(known)
    assigned = set(by_user.values())
    candidates: dict[str, list[int]] = {}
    for number, name in enumerate(names):
        if name in known:
            target = name
        else:
            bare_name, _ = _split_unit(name)
            target = synonyms.get(_folded(bare_name), "")
        if target and target not in assigned and number not in by_user:
            candidates.setdefault(target, []).append(number)
    return candidates


def named_columns(
    table: pd.DataFrame, targets: Mapping[int, str], anchor: EarthAnchor | None = None
) -> tuple[pd.DataFrame, list[str]]:
    """Return a table with the columns that flgpr knows, lengths in metres, places in the lane.

    Parameters
    ----------
    table : DataFrame
        The table as the file holds it.
    targets : mapping of int to str
        Result of :func:`column_targets` for its header.
    anchor : EarthAnchor, optional
        Where the lane lies on the Earth.

    Returns
    -------
    table, notes
        The table, and what was converted or renamed.

    Raises
    ------
    ValueError
        If a unit is none of length, or if places on the Earth come without an ``anchor`` or are
        out of range.
    """
    names = [str(name) for name in table.columns]
    notes = []
    for number, target in targets.items():
        if names[number] != target:
            notes.append(f"{target} is the column {names[number]!r}")
    renamed = table.copy()
    renamed.columns = pd.Index([targets.get(number, name) for number, name in enumerate(names)])
    replaced = [
        number
        for number, name in enumerate(names)
        if number not in targets and name in targets.values()
    ]
    for number in replaced:
        notes.append(f"the column {names[number]!r} of the file is not used")
    renamed = renamed.iloc[:, [number for number in range(len(names)) if number not in replaced]]
    for number, target in targets.items():
        name = names[number]
        if name == target:
            continue
        _, unit = _split_unit(name)
        factor = _unit_factor(target, unit, name)
        if factor != 1.0:
            renamed[target] = to_numbers(renamed[target], repr(name), unit) * factor
            notes.append(f"{target} taken from {unit} to m")
    return _in_lane_frame(renamed, anchor, notes), notes


def _in_lane_frame(
    table: pd.DataFrame, anchor: EarthAnchor | None, notes: list[str]
) -> pd.DataFrame:
    """Return a table with x and y, computed from places on the Earth where it has none."""
    columns = set(table.columns)
    if {"x", "y"} <= columns:
        return table
    if {"longitude", "latitude"} <= columns:
        pair = ["longitude", "latitude"]
    elif {"easting", "northing"} <= columns:
        pair = ["easting", "northing"]
    else:
        return table
    if anchor is None:
        raise ValueError(
            f"{pair[0]} and {pair[1]} need an anchor, which tells where the lane lies on the Earth"
        )
    sides = [to_numbers(table[name], name, "degrees or m").to_numpy() for name in pair]
    points = np.stack(sides, axis=-1)
    if not np.isfinite(points).all():
        raise ValueError(f"{pair[0]} and {pair[1]} must be finite in every row")
    lonlat = points if pair[0] == "longitude" else anchor.to_lonlat(points)
    if (np.abs(lonlat[:, 1]) > 90).any() or (np.abs(lonlat[:, 0]) > 360).any():
        raise ValueError(
            "latitudes must lie within 90 and longitudes within 360 degrees: are they swapped?"
        )
    # A table of places has no heights: all rows are taken to lie at the height of the origin.
    heights = np.full(len(lonlat), anchor.origin[2])
    lane = anchor.from_geodetic(np.column_stack([lonlat, heights]))
    notes.append(
        f"{len(table)} places taken from {pair[0]} and {pair[1]} to the lane by the anchor"
    )
    return table.drop(columns=pair).assign(x=lane[:, 0], y=lane[:, 1])


def places_have_unit(header: Sequence[str], targets: Mapping[int, str]) -> bool:
    """Return whether a header states the unit of x or y, or has places on the Earth in their stead.

    Parameters
    ----------
    header : sequence of str
        Names of the columns as the file has them.
    targets : mapping of int to str
        Result of :func:`column_targets` for them.

    Returns
    -------
    bool
        Whether it does.
    """
    stated = {target: _split_unit(header[number])[1] for number, target in targets.items()}
    return not {"x", "y"} <= stated.keys() or any(
        stated[axis].lower() not in _NO_UNIT for axis in "xy"
    )


def _split_unit(name: str) -> tuple[str, str]:
    """Return a column's name and its unit, which stands in brackets or at the end."""
    text = name.strip()
    in_brackets = _unit_in_brackets(text)
    if in_brackets is not None:
        return in_brackets
    with_suffix = _SUFFIX.fullmatch(text)
    if with_suffix is None:
        return text, ""
    return with_suffix["name"], with_suffix["unit"]


def _unit_in_brackets(text: str) -> tuple[str, str] | None:
    """Return what stands before and in the brackets at the end of a text; None if there are none.

    The brackets begin at the first one that opens after all others that close. A regular expression
    of this takes minutes for a hostile header of thousands of brackets.
    """
    if not text.endswith(("]", ")")):
        return None
    inner = text[:-1]
    begin = max(inner.rfind("]"), inner.rfind(")")) + 1
    first = re.search(r"[\[(]", inner[begin:])
    if first is None:
        return None
    bracket = begin + first.start()
    return inner[:bracket].strip(), inner[bracket + 1 :].strip()


def _unit_factor(target: str, unit: str, name: str) -> float:
    """Return the factor from a column's unit to metres, or 1 for degrees and numbers."""
    unit_key = unit.lower()
    if unit_key in _NO_UNIT:
        return 1.0
    if target in _LENGTHS:
        if unit_key not in UNITS["length"]:
            raise ValueError(
                f"the unit of {name!r} must be one of {', '.join(UNITS['length'])}, got {unit!r}"
            )
        return UNITS["length"][unit_key]
    if target in _ANGLES and unit_key not in _DEGREES:
        raise ValueError(f"the unit of {name!r} must be degrees, got {unit!r}")
    return 1.0


def _synonyms_of_table(known: Sequence[str]) -> dict[str, str]:
    """Return the column of a table of such columns that each folded synonym means."""
    targets: dict[str, str] = {}
    for target, synonyms in _SYNONYMS.items():
        if target not in known and target not in PLACES:
            continue
        for synonym in synonyms.split():
            targets[_folded(synonym)] = target
    for synonym in _synonyms_of_id(known[0]):
        targets[_folded(synonym)] = known[0]
    return targets


def _synonyms_of_id(id_column: str) -> list[str]:
    """Return the names that a table's column of names may have."""
    return [id_column, *_ID_SYNONYMS.split(), *_SYNONYMS_OF_ONE_ID[id_column].split()]


def _folded(name: str) -> str:
    """Return a name without case, accents, blanks and marks: ``Länge`` and ``LANGE`` are equal."""
    small = name.strip().casefold().replace("ß", "ss")
    # NFKD parts a letter from its accents, which then are left out.
    decomposed = unicodedata.normalize("NFKD", small)
    letters = [letter for letter in decomposed if not unicodedata.combining(letter)]
    without_accents = "".join(letters)
    return re.sub(r"[\s_.\-]+", "_", without_accents).strip("_")

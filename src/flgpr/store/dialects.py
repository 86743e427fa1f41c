"""Tables of alarms, truth and objects as other programs and other languages write them.

Columns are known by their names in English, German, French, Spanish, Italian and Portuguese, with or without a unit,
or by what the user says. Numbers are taken as they stand, but for units that are not metres and places on the Earth,
which an anchor takes to the lane. Whatever was read otherwise than it stands is in the notes.
"""

from __future__ import annotations

import csv
import io
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from flgpr.model.units import UNITS

FloatArray = NDArray[np.float64]
PLACES = ("longitude", "latitude", "easting", "northing")
"""Columns beside those of the tables: where a row lies on the Earth, degrees or metres."""
_IDS = {"alarms": "alarm_id", "truth": "target_id", "objects": "object_id"}
_SYNONYMS: dict[str, str] = {
    "x": "x cross across cross_track crosstrack lateral right rechts quer querab droite travers transversal derecha "
    "través destra traverso direita transverso",
    "y": "y along along_track down_track downtrack forward chainage distance vorwärts längs laengs strecke station "
    "avant avance adelante avanti frente progressiva",
    "confidence": "confidence score probability conf konfidenz wahrscheinlichkeit bewertung güte confiance probabilité "
    "confianza probabilidad puntuación confidenza probabilità punteggio confiança probabilidade pontuação",
    "kind": "kind type class category art typ klasse sorte genre catégorie tipo clase clasificación classe categoria "
    "espécie",
    "depth": "depth burial_depth tiefe überdeckung profondeur profundidad profondità profundidade",
    "radius": "radius halbmesser rayon radio raggio raio",
    "height": "height höhe hoehe hauteur altura altezza",
    "lane": "lane spur gasse bahn couloir voie carril corsia faixa",
    "longitude": "longitude lon long lng länge laenge longitud longitudine",
    "latitude": "latitude lat breite latitud latitudine",
    "easting": "easting east utm_east utm_e rechtswert ostwert est este leste",
    "northing": "northing north utm_north utm_n hochwert nordwert nord norte",
}
_ID_SYNONYMS = "id nr no num number name nummer numéro número numero nome nom nombre code label"
_OWN_ID_SYNONYMS = {
    "alarm_id": "alarm alarms alarme alarma allarme detection",
    "target_id": "target mine ziel mina cible objetivo bersaglio alvo",
    "object_id": "object objekt objet objeto oggetto",
}
_WITH_UNIT = re.compile(r"\s*(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]\s*")
_SUFFIX = re.compile(r"(?P<name>.*\w)[_ ](?P<unit>m|cm|mm|km|ft|in|deg)", re.IGNORECASE)
_LENGTHS = ("x", "y", "depth", "radius", "height", "easting", "northing")
_ANGLES = ("longitude", "latitude")
_DEGREES = (
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
)
_NO_UNIT = ("", "1", "-", "%")
_MARKS = ";\t,"


class EarthAnchor(Protocol):
    """What takes places on the Earth to a lane, such as :class:`flgpr.geo.Anchor`."""

    @property
    def origin(self) -> tuple[float, float, float]:
        """Longitude and latitude, degrees, and height, m, of the lane's contact point."""

    def to_lonlat(self, points: ArrayLike) -> FloatArray:
        """Return longitude and latitude of easting and northing (..., 2)."""

    def from_geodetic(self, position: ArrayLike) -> FloatArray:
        """Return lane coordinates of longitude, latitude and height (..., 3)."""


@dataclass(frozen=True)
class TableReading:
    """What a user says of a table: which column is what, and where its lane lies on the Earth."""

    columns: Mapping[str, str] = field(
        default_factory=dict
    )  #: name that flgpr knows -> the file's own
    #: takes longitude and latitude, or easting and northing, to the lane
    anchor: EarthAnchor | None = None


def parse_columns_option(text: str) -> dict[str, str]:
    """Read ``x=Rechts,y=Hoch`` as a mapping; what is no such list is a ValueError."""
    found: dict[str, str] = {}
    for part in text.split(","):
        name, equals, column = part.partition("=")
        name = name.strip()
        if not (equals and name and column.strip()) or name in found:
            raise ValueError(
                f"columns must be NAME=COLUMN, each name once, between commas, got {text!r}"
            )
        found[name] = column.strip()
    return found


def without_comments(text: str, kind: str) -> tuple[str, list[str]]:
    """Leave out lines that begin with ``#``, and a first line ``sep=;``; a header behind a ``#`` is one.

    A row whose first cell is a name that begins so stays: it has as many cells as the header, which begins with a
    column of names.
    """
    lines = text.splitlines()
    if lines and re.fullmatch(r"\s*sep=.\s*", lines[0], re.IGNORECASE):
        lines = lines[1:]
    first = next(
        (k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")),
        None,
    )
    if first is None:
        return "", []
    before = [line for line in lines[:first] if line.strip()]
    body = lines[first:]
    head = body[0]
    notes: list[str] = []
    if before and _is_numbers(head):
        behind = before[-1].lstrip("# \t")
        if _cells(behind) == _cells(head):
            before = before[:-1]
            body = [behind, *body]
            notes.append(f"the header stands behind a #: {behind[:80]}")
    named_first = _plain(_split(body[0])[0]) in {
        _plain(name) for name in _synonyms_of_id(_IDS[kind])
    }
    rows: list[str] = [body[0]]
    dropped = len(before)
    for line in body[1:]:
        if line.lstrip().startswith("#") and not (named_first and _cells(line) == _cells(body[0])):
            dropped += 1
        else:
            rows.append(line)
    if dropped:
        notes.append(f"{dropped} lines that begin with # left out")
    return "\n".join(rows) + "\n", notes


def _is_numbers(line: str) -> bool:
    cells = [cell.strip() for cell in _split(line)]
    return all(re.fullmatch(r"[-+]?[\d.,]+([eE][-+]?\d+)?|", cell) for cell in cells) and any(cells)


def mark_of(head: str) -> str:
    """Tell what parts the columns of a header: semicolons, else tabs, else commas."""
    return next((mark for mark in _MARKS if mark in head), ",")


def _split(line: str) -> list[str]:
    return next(csv.reader(io.StringIO(line), delimiter=mark_of(line)), [""])


def _cells(line: str) -> int:
    return len(_split(line))


def column_targets(
    names: Sequence[str], kind: str, known: tuple[str, ...], columns: Mapping[str, str]
) -> dict[int, str]:
    """Tell which columns of a header are which of a table's, by number; those of neither are left out.

    Parameters
    ----------
    names : sequence of str
        The header.
    kind : str
        "alarms", "truth" or "objects".
    known : tuple of str
        The names of the table's columns.
    columns : mapping of str to str
        What the user says: a table's name, and the file's own.

    Raises
    ------
    ValueError
        If a column that the user names is not there or unknown, or if two columns could be one.
    """
    wanted = {*known, *PLACES}
    found: dict[int, str] = {}
    for target, column in columns.items():
        if target not in wanted:
            raise ValueError(
                f"columns must name one of {', '.join(sorted(wanted))}, got {target!r}"
            )
        places = [k for k, name in enumerate(names) if name.strip() == column]
        if len(places) > 1:
            raise ValueError(f"columns: {column!r} stands {len(places)} times in the header")
        if places:
            found[places[0]] = target
    said = set(found.values())
    lookup = _lookup(kind, known)
    candidates: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        target = name if name in known else lookup.get(_plain(_unit_apart(name)[0]), "")
        if target and target not in said and k not in found:
            candidates.setdefault(target, []).append(k)
    for target, places in candidates.items():
        chosen = [k for k in places if names[k] == target] or places
        if len(chosen) > 1:
            told = " or ".join(repr(names[k]) for k in chosen)
            raise ValueError(
                f"{target} could be the column {told}: say which by --columns {target}={names[chosen[0]]}"
            )
        found[chosen[0]] = target
    missing = [target for target in columns if target not in found.values()]
    if missing:
        column = columns[missing[0]]
        raise ValueError(
            f"columns: the file has no column {column!r} for {missing[0]}; it has {', '.join(names)}"
        )
    return _without_needless_places(found)


def named_columns(
    table: pd.DataFrame, targets: Mapping[int, str], anchor: EarthAnchor | None = None
) -> tuple[pd.DataFrame, list[str]]:
    """Give columns the names that flgpr knows (:func:`column_targets`), their lengths metres, their places the lane's.

    Returns
    -------
    table, notes
        The table, and what was read otherwise than it stands.

    Raises
    ------
    ValueError
        If a unit is none of length, or if places on the Earth come without an ``anchor`` or cannot
        be.
    """
    names = [str(name) for name in table.columns]
    notes = [
        f"{target} is the column {names[k]!r}"
        for k, target in targets.items()
        if names[k] != target
    ]
    made = table.copy()
    made.columns = pd.Index([targets.get(k, name) for k, name in enumerate(names)])
    for k, target in targets.items():
        unit = "" if names[k] == target else _unit_apart(names[k])[1]
        factor = _factor(target, unit, names[k])
        if factor != 1.0:
            made[target] = pd.to_numeric(made[target]) * factor
            notes.append(f"{target} taken from {unit} to m")
    return _in_the_lane(made, anchor, notes), notes


def _without_needless_places(renamed: dict[int, str]) -> dict[int, str]:
    """Leave places on the Earth as they are where the table has places in the lane."""
    if not {"x", "y"} <= set(renamed.values()):
        return renamed
    return {k: target for k, target in renamed.items() if target not in PLACES}


def _in_the_lane(table: pd.DataFrame, anchor: EarthAnchor | None, notes: list[str]) -> pd.DataFrame:
    """Take places on the Earth to the lane where the table has none in it."""
    if {"x", "y"} <= set(table.columns):
        return table
    pairs = (("longitude", "latitude"), ("easting", "northing"))
    pair = next((one for one in pairs if set(one) <= set(table.columns)), None)
    if pair is None:
        return table
    if anchor is None:
        raise ValueError(
            f"{pair[0]} and {pair[1]} need an anchor, which tells where the lane lies on the Earth"
        )
    points = np.stack([pd.to_numeric(table[name]).to_numpy(np.float64) for name in pair], axis=-1)
    if not np.isfinite(points).all():
        raise ValueError(f"{pair[0]} and {pair[1]} must be finite in every row")
    lonlat = points if pair[0] == "longitude" else anchor.to_lonlat(points)
    if (np.abs(lonlat[:, 1]) > 90).any() or (np.abs(lonlat[:, 0]) > 360).any():
        raise ValueError(
            "latitudes must lie within 90 and longitudes within 360 degrees: are they swapped?"
        )
    heights = np.full(
        len(lonlat), anchor.origin[2]
    )  # of the lane's ground: a table of places has none
    lane = anchor.from_geodetic(np.column_stack([lonlat, heights]))
    notes.append(
        f"{len(table)} places taken from {pair[0]} and {pair[1]} to the lane by the anchor"
    )
    return table.drop(columns=list(pair)).assign(x=lane[:, 0], y=lane[:, 1])


def _unit_apart(name: str) -> tuple[str, str]:
    """Part a column's name from its unit, which stands in brackets or at the end."""
    found = _WITH_UNIT.fullmatch(name) or _SUFFIX.fullmatch(name.strip())
    return (found["name"], found["unit"]) if found else (name.strip(), "")


def _factor(target: str, unit: str, name: str) -> float:
    """Look up what takes a column to metres, or degrees to degrees."""
    low = unit.lower()
    if low in _NO_UNIT:
        return 1.0
    if target in _LENGTHS:
        if low not in UNITS["length"]:
            raise ValueError(
                f"the unit of {name!r} must be one of {', '.join(UNITS['length'])}, got {unit!r}"
            )
        return UNITS["length"][low]
    if target in _ANGLES and low not in _DEGREES:
        raise ValueError(f"the unit of {name!r} must be degrees, got {unit!r}")
    return 1.0


def _lookup(kind: str, known: tuple[str, ...]) -> dict[str, str]:
    found: dict[str, str] = {}
    for target, words in _SYNONYMS.items():
        if target in known or target in PLACES:
            found |= {_plain(word): target for word in words.split()}
    own = _IDS[kind]
    found |= {_plain(word): own for word in _synonyms_of_id(own)}
    return found


def _synonyms_of_id(own: str) -> list[str]:
    return [own, *_ID_SYNONYMS.split(), *_OWN_ID_SYNONYMS[own].split()]


def _plain(name: str) -> str:
    """Fold case, accents, blanks and marks: ``Länge`` and ``LANGE`` are one word, ``x`` and ``X`` too."""
    flat = unicodedata.normalize("NFKD", name.strip().casefold().replace("ß", "ss"))
    letters = "".join(one for one in flat if not unicodedata.combining(one))
    return re.sub(r"[\s_.\-]+", "_", letters).strip("_")

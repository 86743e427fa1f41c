"""Nominal frequencies of the antennas of commercial radars, by the names that their files hold.

A name is looked up in a table of its maker's models, or states its frequency with a unit. Digits
alone are a serial number as well as a frequency, and are not taken for one.

Sources: the antenna codes that readgssi collected from files and the maker's staff
(``readgssi/constants.py``, https://github.com/iannesbitt/readgssi) and those of RGPR
(``R/readDZT.R``, https://github.com/emanuelhuber/RGPR). The horns 4105 and 4108 (2000 and 1000
MHz), MALÅ's GX models and CO700 are as commonly stated: no document of their makers was at hand.
ImpulseRadar's CrossOver antennas are not in it: CO4080 is two antennas, of 400 and 800 MHz, and the
name does not say whose channel a file holds.
"""

from __future__ import annotations

import re
import tomllib
from importlib import resources

from flgpr.types import Notes

_MODELS = tomllib.loads(
    (resources.files("flgpr_exchange.gpr") / "antennas.toml").read_text("utf-8")
)
"""Frequencies, MHz, by model: of GSSI's antennas and their sets of two, and of MALÅ's."""
_WITH_UNIT = re.compile(r"(?<![\d./,])(\d+(?:[.,]\d+)?)[\s_-]*([MG])HZ")
_LEADING = re.compile(
    r"(\d{2,4})(?:[\s_-]+(?:UN)?SHIELDED(?![A-Z]).*|[\s_-]+RTA(?![A-Z]).*|[\s_-]*)", re.DOTALL
)
_MALA_MODEL = re.compile(r"(?<![A-Z])([A-Z]{2})[\s_-]?(\d+)(?![\d.])")
_HIGHEST = 6000.0  # MHz, of any such antenna
_LOWEST = 5.0


def antenna_frequency(name: str, maker: str, channel: int = 0) -> float | None:
    """Return the nominal frequency of an antenna.

    Parameters
    ----------
    name : str
        What the file calls the antenna.
    maker : {"GSSI", "MALÅ", "ImpulseRadar"}
        Its maker.
    channel : int
        Chooses between the antennas of a set of two.

    Returns
    -------
    float or None
        The frequency, Hz; None where neither a table nor the name itself states it.
    """
    return _look_up(name, maker, channel)[0]


def set_frequency(name: str, channel: int) -> float | None:
    """Return the nominal frequency of a channel's antenna in a set of GSSI's.

    Parameters
    ----------
    name : str
        Name of the first channel's antenna.
    channel : int
        Number of the channel, from 0.

    Returns
    -------
    float or None
        The frequency, Hz; None if the name is that of no set.
    """
    megahertz = _of_set(_model_name(name), channel)
    return None if megahertz is None else megahertz * 1e6


def noted_frequency(name: str, maker: str, notes: Notes, channel: int = 0) -> float | None:
    """Return what :func:`antenna_frequency` does, and note how it is known.

    There is no note where the name states it with a unit.

    Parameters
    ----------
    name : str
        Name of the antenna as the file states it.
    maker : str
        Maker of the radar.
    notes : list of str
        Takes what is assumed, replaced or not used.
    channel : int
        Number of the channel, for antennas with a frequency for each.

    Returns
    -------
    float or None
        The nominal frequency, Hz; None if it is not known.
    """
    frequency, source = _look_up(name, maker, channel)
    if not name.strip():
        notes.append("the header names no antenna: its frequency is unknown")
    elif frequency is None:
        notes.append(
            f"antenna {name[:40]!r} is in no table of models and states no frequency: it is unknown"
        )
    elif source:
        notes.append(f"antenna {name[:40]!r} is one of {frequency / 1e6:g} MHz, {source}")
    return frequency


def _look_up(name: str, maker: str, channel: int) -> tuple[float | None, str]:
    """Return an antenna's frequency, Hz, and how it is known.

    The latter is empty where the name states it with a unit.
    """
    model = _model_name(name)
    megahertz: float | None = None
    source = "by the table of models"
    if maker == "GSSI":
        megahertz = _of_set(model, channel) or _MODELS["gssi"].get(model)
    elif maker == "MALÅ":
        # The model in a name, such as GX450 HDR (v.1), if it is a single one.
        named = {letters + digits for letters, digits in _MALA_MODEL.findall(model)}
        known = named & _MODELS["mala"].keys()
        megahertz = _MODELS["mala"][known.pop()] if len(known) == 1 else None
    if megahertz is None:
        stated = {
            float(number.replace(",", ".")) * (1e3 if unit == "G" else 1.0)
            for number, unit in _WITH_UNIT.findall(model)
        }
        megahertz = stated.pop() if len(stated) == 1 else None
        source = ""
    if megahertz is None and maker in ("MALÅ", "ImpulseRadar"):
        # The field is the frequency and the kind, such as "500_shielded_0.18".
        leading = _LEADING.fullmatch(model)
        megahertz = float(leading[1]) if leading else None
        source = "by the number that its name begins with"
    if megahertz is None or not _LOWEST <= megahertz <= _HIGHEST:
        return None, ""
    return megahertz * 1e6, source


def _model_name(name: str) -> str:
    """Return a name in capitals without the serial number, which follows a number sign."""
    return re.sub(r"\s*#.*", "", name, flags=re.DOTALL).strip().upper()


def _of_set(model: str, channel: int) -> float | None:
    """Return the frequency, MHz, of a channel's antenna in a set; None if the name is no set's."""
    frequencies = _MODELS["gssi_sets"].get(model)
    return frequencies[channel] if frequencies and channel < len(frequencies) else None

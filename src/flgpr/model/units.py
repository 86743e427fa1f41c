"""Units that files are written in, by quantity, with their factors to SI units.

A foot is 0.3048 m and an inch 0.0254 m exactly (international yard and pound, 1959).
"""

from __future__ import annotations

UNITS: dict[str, dict[str, float]] = {
    "frequency": {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "km": 1e3, "ft": 0.3048, "in": 0.0254},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ps": 1e-12, "min": 60.0, "h": 3600.0},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295},
}

"""How ``flgpr info`` describes runs and models in words."""

from __future__ import annotations

import json
from typing import Any

# Height above the ground, m, from which coverage ahead of a vehicle is not what is asked for.
_AIRBORNE = 100.0


def info_lines(told: dict[str, Any]) -> list[str]:
    """Say in words what a run holds."""
    low, high = (value / 1e9 for value in told["frequency_hz"])
    spacing = told["scan_spacing_m"]
    between = f", {spacing[0]:.2f} to {spacing[1]:.2f} m between scans" if spacing else ""
    missing = f"{told['missing_sweeps']} missing" if told["missing_sweeps"] else "none missing"
    masked = f"; scans left out for it: {told['masked_scans']}" if told["masked_scans"] else ""
    even = (
        "evenly spaced"
        if told["uniform_tones"]
        else f"uneven, up to {told['largest_step_hz'] / 1e6:.3g} MHz apart"
    )
    lines = [
        f"{told['title']}" + (f" ({told['source']})" if told["source"] else ""),
        f"  scans          {told['scans']} over {told['travelled_m']:.2f} m of travel{between}",
        f"  sweeps         {told['pairs']} pairs x {', '.join(told['polarizations'])}: {missing}{masked}",
        f"  tones          {told['tones']} from {low:.4g} to {high:.4g} GHz, {even}",
    ]
    if told["unambiguous_path_m"]:
        lines.append(
            f"  range          resolution {told['range_resolution_m']:.3f} m, path unambiguous to "
            f"{told['unambiguous_path_m']:.1f} m"
        )
    heights = [
        told["height_m"] + pose[2] - sum(one[2] for one in told["pose"]) / len(told["pose"])
        for pose in told["pose"]
    ]
    across, along, _ = told["array_m"]
    lines += [
        f"  array          {len(told['tx_m'])} transmitter and {len(told['rx_m'])} receiver positions, "
        f"{across:.2f} m across and {along:.2f} m along, {min(heights):.2f} to {max(heights):.2f} m above the ground",
    ]
    vehicle = told["height_m"] <= _AIRBORNE
    if vehicle:
        lines.append(
            f"  coverage       x {told['lane']['x'][0]:.1f} to {told['lane']['x'][1]:.1f} m, "
            f"y {told['lane']['y'][0]:.1f} to {told['lane']['y'][1]:.1f} m: {told['looks']['mean']:.1f} looks on "
            f"average, at most {told['looks']['most']}, {100 * told['looks']['unseen_share']:.0f} % never seen"
        )
    lines += [
        *(f"  channels       {line}" for line in told["health"]),
        *_recipe_lines(told["recipes"]),
        *(f"  note           {line}" for line in told["import_notes"]),
        *(f"  warning        {line}" for line in told["warnings"]),
        *(["", *_coverage_map(told)] if vehicle else []),
    ]
    return lines


def model_lines(held: dict[str, Any]) -> list[str]:
    """Say in words what a model holds. Its words are somebody's: they are written as JSON, which hides no character."""
    detector = held["detector"]
    lines = [
        f"{held['path']}: {held['format']} version {held['version']}, written by flgpr {_quoted(held['flgpr'])}",
        f"  arrays         {len(held['arrays'])}, {held['bytes'] / 1e6:.3g} MB; none was loaded",
    ]
    if isinstance(detector, dict):
        lines.append(f"  detector       {_quoted(detector.get('estimator'))}")
        for name in sorted(set(detector) - {"estimator"}):
            lines.append(f"    {name:<12} {_quoted(detector[name])}")
    else:
        lines.append("  detector       none")
    lines.append(f"  stages         {_quoted(held['stages'])}")
    if isinstance(held["notes"], dict):
        for name, value in held["notes"].items():
            lines.append(f"  note           {_quoted(name)}: {_quoted(value)}")
    for one in held["arrays"]:
        lines.append(
            f"  array          {_quoted(one['name'])} {_quoted(one['dtype'])} {one['shape']}"
        )
    return lines


def _quoted(value: Any, most: int = 100) -> str:
    """Write a value of a file as JSON in ASCII, cut off where it is long."""
    text = json.dumps(value)
    return text if len(text) <= most else text[: most - 3] + "..."


def _recipe_lines(faults: dict[str, list[str]]) -> list[str]:
    """Say which recipes fit, and of the others what does not."""
    lines = [
        f"{name} fits" if not some else f"{name}: {one}"
        for name, some in faults.items()
        for one in some or [""]
    ]
    if any(faults.values()):
        lines.append("`flgpr recipe for RUN` makes one that fits")
    return [f"  {'recipe' if k == 0 else '':<15}{line}" for k, line in enumerate(lines)]


def _coverage_map(told: dict[str, Any]) -> list[str]:
    """Draw looks as a map of characters, down-track upwards, at most 24 lines."""
    rows = told["looks_map"]
    most = max(told["looks"]["most"], 1)
    stride = max(1, len(rows) // 24)
    shades = " ░▒▓█"
    low, high = told["lane"]["y"]
    drawn = []
    for index in range(0, len(rows), stride):
        y = low + (high - low) * index / max(len(rows) - 1, 1)
        cells = "".join(shades[-(-count * (len(shades) - 1) // most)] * 2 for count in rows[index])
        drawn.append(f"  y {y:7.1f} m  {cells}")
    return [*drawn[::-1], f"  {'':11}looks: blank 0 … {shades[-1]} {most}"]

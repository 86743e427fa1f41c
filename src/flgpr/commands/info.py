"""``flgpr info``: show what a run, a file or a model holds."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flgpr.commands.options import OneOrMorePaths, PathLike, ShellType, one_or_more
from flgpr.commands.shell import Arguments, command
from flgpr.model.printable import printable

if TYPE_CHECKING:
    from flgpr.types import Entries

# Height above the ground, m, above which the coverage ahead of a vehicle is not of interest.
_AIRBORNE = 100.0
_MAP_LINES = 24
_SHADES = " ░▒▓█"
_LONGEST = 100  # characters of a value that a model states


def _is_model(path: Path) -> bool:
    """Return whether a folder is a model, or a result that may have one."""
    return (path / "model.bundle").is_file() or (path / "manifest.json").is_file()


def _lines(returned: Any, call: Arguments) -> Iterator[str]:
    """Yield the text about files, a model or a run."""
    first = call.paths[0]
    if len(call.paths) > 1 or first.is_file():
        yield from _file_lines(returned, call)
    elif _is_model(first):
        yield from model_lines(returned)
    else:
        yield from info_lines(returned)
        yield f"`flgpr check {first}` says whether it is right: signs, orders, heading, units"
        if call.plot is not None:
            yield f"plot: {call.plot.resolve()}"


def _file_lines(described: Any, call: Arguments) -> Iterator[str]:
    """Yield kind and content of files, then the draft of their mapping or where it is."""
    if len(call.paths) > 1:
        yield described.kind
    else:
        yield f"{described.path}: {described.kind}"
    for line in described.lines:
        yield f"  {line}"
    if call.mapping is not None:
        guesses = described.mapping.count('?"')
        plural = "" if guesses == 1 else "s"
        yield f"wrote {call.mapping}, with {guesses} question mark{plural}"
    elif described.mapping:
        yield f"\nA mapping to begin with (flgpr import mapped):\n\n{described.mapping}"


def _as_json(returned: Any, call: Arguments) -> Any:
    """Return the report of a run or a model, or kind, content and mapping of files."""
    if len(call.paths) > 1 or call.paths[0].is_file():
        return {"kind": returned.kind, "lines": returned.lines, "mapping": returned.mapping}
    return returned


@command(lines=_lines, as_json=_as_json, quiet=False)
def info(
    paths: OneOrMorePaths,
    recipe: Annotated[PathLike | None, ShellType(str)] = None,
    recipes: bool = False,
    plot: PathLike | None = None,
    mapping: PathLike | None = None,
) -> Any:
    """Show what a run, a file or a model holds. A model is not loaded for it.

    Several files of one measurement are described together, with one draft of their mapping.

    Parameters
    ----------
    paths
        Run store, file to import, model, or result with a model; or all files of one measurement.
    recipe
        Recipe whose images and lane decide what is covered; it is checked, too.
    recipes
        Check every packaged recipe.
    plot
        PNG to write: plan, coverage and side view.
    mapping
        TOML to write: the draft of the files' mapping.

    Returns
    -------
    dict or Explanation
        For a run :func:`flgpr.commands.run_report.run_info`, for a model or a result
        :func:`flgpr.commands.run_report.model_info`, for files their kind, lines and mapping.

    Raises
    ------
    ValueError
        If a file or a store cannot be read, or a mapping is asked for that no import needs.
    """
    path_list = [Path(path) for path in one_or_more(paths)]
    first = path_list[0]
    if len(path_list) > 1 or first.is_file():
        return _explain(path_list, None if mapping is None else Path(mapping))
    if mapping is not None:
        raise ValueError(f"a mapping is drafted for files, got {first}")
    from flgpr.commands.run_report import model_info, run_info

    if _is_model(first):
        return model_info(first)
    return run_info(first, recipe, plot, recipes)


def _explain(paths: list[Path], mapping: Path | None) -> Any:
    """Describe files that are no run yet, and write the draft of their mapping to a path."""
    from flgpr.formats.explain import explain_file, explain_files

    is_group = len(paths) > 1
    described = explain_files(paths, mapping=mapping) if is_group else explain_file(paths[0])
    if mapping is None:
        return described
    if not described.mapping:
        raise ValueError(
            f"{paths[0]}: a {described.kind} needs no mapping, none is written to {mapping}"
        )
    from flgpr.commands.importing import check_parent_folder
    from flgpr.store.outputs import write_new

    write_new(check_parent_folder(mapping), described.mapping)
    return described


def info_lines(report: Entries) -> list[str]:
    """Return the text about a run, for the dict of :func:`flgpr.commands.run_report.run_info`."""
    is_on_vehicle = report["height_m"] <= _AIRBORNE
    lines = [_title(report), _scan_line(report), _sweep_line(report), _tone_line(report)]
    if report["unambiguous_path_m"]:
        lines.append(
            f"  range          resolution {report['range_resolution_m']:.3f} m, "
            f"path unambiguous to {report['unambiguous_path_m']:.1f} m"
        )
    lines.append(_array_line(report))
    if is_on_vehicle:
        lines.append(_coverage_line(report))
    for health in report["health"]:
        lines.append(f"  channels       {health}")
    for finding in report.get("findings", []):
        lines.append(f"  fault          {finding['sentence']}")
    lines += _recipe_lines(report["recipes"])
    for sentence in report["import_notes"]:
        lines.append(f"  note           {sentence}")
    for warning in report["warnings"]:
        lines.append(f"  warning        {warning}")
    if is_on_vehicle:
        lines += ["", *_coverage_map(report)]
    return lines


def _title(report: Entries) -> str:
    """Return the title of a run, and its source if that is known."""
    source = report["source"]
    title = printable(str(report["title"]))
    return f"{title} ({printable(str(source))})" if source else title


def _scan_line(report: Entries) -> str:
    """Return number of scans, distance travelled and distance between scans."""
    line = f"  scans          {report['scans']} over {report['travelled_m']:.2f} m of travel"
    spacing = report["scan_spacing_m"]
    if spacing:
        line += f", {spacing[0]:.2f} to {spacing[1]:.2f} m between scans"
    return line


def _sweep_line(report: Entries) -> str:
    """Return number of channels, and which sweeps are missing."""
    polarizations = ", ".join(report["polarizations"])
    line = f"  sweeps         {report['pairs']} pairs x {polarizations}: "
    missing = report["missing_sweeps"]
    line += f"{missing} missing" if missing else "none missing"
    if report["masked_scans"]:
        line += f"; scans left out for it: {report['masked_scans']}"
    return line


def _tone_line(report: Entries) -> str:
    """Return number of tones, band, and whether tones are evenly spaced."""
    low, high = report["frequency_hz"]
    if report["uniform_tones"]:
        spacing = "evenly spaced"
    else:
        spacing = f"uneven, up to {report['largest_step_hz'] / 1e6:.3g} MHz apart"
    band = f"{low / 1e9:.4g} to {high / 1e9:.4g} GHz"
    return f"  tones          {report['tones']} from {band}, {spacing}"


def _array_line(report: Entries) -> str:
    """Return number of antennas, size of the array, and its heights over the run."""
    pose_heights = [pose[2] for pose in report["pose"]]
    mean_pose_height = sum(pose_heights) / len(pose_heights)
    heights = [report["height_m"] + height - mean_pose_height for height in pose_heights]
    # The extent upwards is in the heights.
    across, along, _ = report["array_m"]
    return (
        f"  array          {len(report['tx_m'])} transmitter and {len(report['rx_m'])} receiver "
        f"positions, {across:.2f} m across and {along:.2f} m along, "
        f"{min(heights):.2f} to {max(heights):.2f} m above the ground"
    )


def _coverage_line(report: Entries) -> str:
    """Return the ground that is covered, and by how many looks."""
    x_min, x_max = report["lane"]["x"]
    y_min, y_max = report["lane"]["y"]
    looks = report["looks"]
    return (
        f"  coverage       x {x_min:.1f} to {x_max:.1f} m, y {y_min:.1f} to {y_max:.1f} m: "
        f"{looks['mean']:.1f} looks on average, at most {looks['most']}, "
        f"{100 * looks['unseen_share']:.0f} % never seen"
    )


def model_lines(report: Entries) -> list[str]:
    """Return the text about a model.

    Texts of the file may be anybody's: they are written as JSON, which hides no character.
    """
    size = f"{report['bytes'] / 1e6:.3g} MB"
    lines = [
        f"{report['path']}: {report['format']} version {report['version']}, "
        f"written by flgpr {_quoted(report['flgpr'])}",
        f"  arrays         {len(report['arrays'])}, {size}; none was loaded",
    ]
    detector = report["detector"]
    if isinstance(detector, dict):
        lines.append(f"  detector       {_quoted(detector.get('estimator'))}")
        for name in sorted(set(detector) - {"estimator"}):
            lines.append(f"    {name:<12} {_quoted(detector[name])}")
    else:
        lines.append("  detector       none")
    lines.append(f"  stages         {_quoted(report['stages'])}")
    if isinstance(report["notes"], dict):
        for name, value in report["notes"].items():
            lines.append(f"  note           {_quoted(name)}: {_quoted(value)}")
    for sentence in report.get("check", []):
        lines.append(f"  check          {sentence}")
    for array in report["arrays"]:
        kind = f"{_quoted(array['name'])} {_quoted(array['dtype'])}"
        lines.append(f"  array          {kind} {array['shape']}")
    return lines


def _quoted(value: Any) -> str:
    """Return a value of a file as JSON in ASCII, cut off where it is long."""
    text = json.dumps(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def _recipe_lines(faults: dict[str, list[str]]) -> list[str]:
    """Return which recipes fit, and of the others what does not."""
    sentences = []
    for name, recipe_faults in faults.items():
        if not recipe_faults:
            sentences.append(f"{name} fits")
        for fault in recipe_faults:
            sentences.append(f"{name}: {fault}")
    if any(faults.values()):
        sentences.append("`flgpr recipe for RUN` makes one that fits")
    lines: list[str] = []
    for sentence in sentences:
        heading = "" if lines else "recipe"
        lines.append(f"  {heading:<15}{sentence}")
    return lines


def _coverage_map(report: Entries) -> list[str]:
    """Return looks as a map of characters, down-track upwards, of some 24 lines."""
    rows = report["looks_map"]
    most = max(report["looks"]["most"], 1)
    stride = max(1, len(rows) // _MAP_LINES)
    y_min, y_max = report["lane"]["y"]
    lines = []
    for index in range(0, len(rows), stride):
        y = y_min + (y_max - y_min) * index / max(len(rows) - 1, 1)
        cells = "".join(_shade(count, most) for count in rows[index])
        lines.append(f"  y {y:7.1f} m  {cells}")
    legend = f"  {'':11}looks: blank 0 … {_SHADES[-1]} {most}"
    return [*reversed(lines), legend]


def _shade(count: int, most: int) -> str:
    """Return two characters, about a square on the screen, that are darker for more looks."""
    darkest = len(_SHADES) - 1
    # Rounded up: one look alone is not drawn as none.
    level = -(-count * darkest // most)
    return _SHADES[level] * 2

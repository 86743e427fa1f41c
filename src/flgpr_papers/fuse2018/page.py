"""The page of the reproduction: findings, figures and tables of the paper, and ours."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.clutter import TABLE_II
from flgpr.store import write_whole
from flgpr_papers.fuse2018.fullwave import FullwaveStudy
from flgpr_papers.fuse2018.lanes import FuseRecipe, band_sensor
from flgpr_papers.fuse2018.matches import CONVENTIONS, scored
from flgpr_papers.fuse2018.poses import PoseStudy
from flgpr_papers.fuse2018.results import LaneResult
from flgpr_papers.fuse2018.suppression import VARIANTS, Calibration
from flgpr_papers.fuse2018.twins import Drawing, Shown, own_drawings, paper_drawings
from flgpr_papers.kit.findings import Finding, by_chance
from flgpr_papers.kit.page import HEADER, Twin, draw, point_rows, study_html
from flgpr_papers.kit.study_worlds import OtherWorld, StudyWorld

Row = tuple[Any, ...]


def page_html(
    recipe: FuseRecipe,
    lanes: Sequence[LaneResult],
    loose: LaneResult,
    calibration: Calibration,
    example: Mapping[str, NDArray[Any]],
    poses: PoseStudy,
    fullwave: FullwaveStudy,
    found: Sequence[Finding],
    quick: bool,
    folder: Path,
    study_world: StudyWorld,
    other: OtherWorld,
) -> str:
    """Return the page, which needs no other file, and write its figures into a folder as PNG.

    Parameters
    ----------
    recipe : FuseRecipe
        The study.
    lanes : sequence of LaneResult
        Results of lanes A and B.
    loose : LaneResult
        Result of a lane with the presets' looser navigation.
    calibration : Calibration
        What the calibration lane teaches.
    example : mapping of str to ndarray
        What the figures show of one aperture.
    poses : PoseStudy
        Loss of the coherent sum by wrong poses.
    fullwave : FullwaveStudy
        The packaged full-wave lane.
    found : sequence of Finding
        The findings.
    quick : bool
        Whether the study is a quick run.
    folder : Path
        Folder of the study.
    study_world : StudyWorld
        World of the lanes.
    other : OtherWorld
        Findings of the same study on roads as found.
    """
    example_arrays = {**example, "box side": np.asarray(recipe.boxes.side)}
    drawn_from = Shown(recipe, lanes, loose, example_arrays, poses, fullwave, found)
    twins = [_twin(drawing, folder, quick) for drawing in paper_drawings(drawn_from)]
    own_twins = [_twin(drawing, folder, quick) for drawing in own_drawings(drawn_from)]
    write_whole(folder / "fullwave.csv", fullwave.table.to_csv(index=False))
    return study_html(
        "fuse2018.html",
        quick=quick,
        study_world=study_world,
        other=other,
        recipe=recipe,
        lanes=[_lane_row(recipe, lane) for lane in lanes],
        found=found,
        chance=by_chance(found),
        header=HEADER,
        points=list(_points(recipe, lanes)),
        regions=[f"{a:g} to {b:g} m" for a, b in pairwise(recipe.image.edges)],
        thresholds=_threshold_rows(calibration),
        courses=_course_rows(lanes),
        poses=poses,
        errors=[f"{1000 * error:g}" for error in poses.errors],
        losses=_loss_rows(poses),
        fullwave=fullwave,
        peaks=_peak_rows(fullwave.table),
        false_alarms=_false_alarm_rows(fullwave.false),
        system=_system_rows(recipe),
        combinations=[(f"#{k}", _iterations(iterations)) for k, iterations in TABLE_II.items()],
        twins=twins,
        others=own_twins,
    )


def _twin(drawing: Drawing, folder: Path, quick: bool) -> Twin:
    """Write a figure into the folder and return what the page shows of it."""
    picture = draw(drawing.figure, quick, 60 if quick else 110)
    write_whole(folder / f"{drawing.name}.png", picture)
    return Twin(drawing.number, drawing.title, picture, drawing.caption, drawing.numbers)


def _iterations(iterations: Sequence[int]) -> str:
    """Name the output images of a combination as Table II does."""
    if not any(iterations):
        return "Original SAR image"
    return f"Iterations {' and '.join(map(str, iterations))} times"


def _system_rows(recipe: FuseRecipe) -> list[Row]:
    """Tabulate both radars as Table I does."""
    sensors = [band_sensor(recipe, band) for band in ("l", "x")]
    antennas = []
    bands = []
    polarizations = []
    for sensor in sensors:
        tx, rx = (len(np.unique(side, axis=0)) for side in sensor.pairs())
        tones = sensor.tones.axis()
        antennas.append(f"{tx} transmitters, {rx} receivers")
        bands.append(f"{tones[0] / 1e9:.2f} GHz to {tones[-1] / 1e9:.2f} GHz, {len(tones)} tones")
        polarizations.append(", ".join(sensor.polarization))
    return [
        ("Antennas, L band", "8 transmitters, 8 receivers", antennas[0]),
        ("Antennas, X band", "32 transmitters, 4 receivers", antennas[1]),
        ("Frequency bandwidth, L band", "0.75 GHz to 3.2 GHz", bands[0]),
        ("Frequency bandwidth, X band", "8.4 GHz to 10.4 GHz (the text: 8 to 12 GHz)", bands[1]),
        ("Polarization, L band", "VV, HH, VH, HV", polarizations[0]),
        ("Polarization, X band", "VV", polarizations[1]),
    ]


def _points(recipe: FuseRecipe, lanes: Sequence[LaneResult]) -> Iterator[Row]:
    """Yield Pd at operating points, before and after, by both conventions of FAR."""
    for lane in lanes:
        for convention in CONVENTIONS:
            for variant in ("original", "iteration"):
                matched, _, options = scored(lane, variant, recipe, convention)
                area = {name: options[name] for name in ("area", "frame_area") if name in options}
                inside = matched.truth["inside"].to_numpy(dtype=bool)
                subsets = {f"lane {lane.name}, {convention}": inside}
                yield from point_rows({variant: matched}, subsets, shared="count", **area)


def _lane_row(recipe: FuseRecipe, lane: LaneResult) -> Row:
    """Return the row of a lane: its length, mines, frames and objects."""
    counts = [(lane.objects["kind"] == kind).sum() for kind in ("bush", "post", "rock")]
    return lane.name, f"{recipe.lanes.length:g} m", len(lane.truth), lane.frames, *counts


def _threshold_rows(calibration: Calibration) -> list[Row]:
    """Tabulate the learnt thresholds, dB."""
    names = {"VV": "vv", "VH": "vh", "X": "second", "VH, roadside": "low_vh"}
    learnt = calibration.learnt
    rows: list[Row] = []
    for title, name in names.items():
        if name in learnt:
            levels = [f"{20 * np.log10(level):.1f}" for level in learnt[name]]
            rows.append((title, *levels))
    return [*rows, ("looks at mines", *learnt["looks"])]


def _course_rows(lanes: Sequence[LaneResult]) -> list[Row]:
    """Tabulate how the residual goes by variant."""
    table = pd.concat([lane.courses for lane in lanes])
    rows = []
    for name, title in VARIANTS.items():
        rows_of_variant = table[table["variant"] == name]
        if rows_of_variant.empty or name == "original":
            continue
        counts = ["no iterations"] * 3
        if "least" not in name:
            counts = []
            for column in ("rises", "diverged", "fallen"):
                count = (rows_of_variant[column] > 0).sum()
                counts.append(f"{count} of {len(rows_of_variant)}")
        masked = f"{100 * rows_of_variant['masked'].mean():.1f}"
        residual = f"{rows_of_variant['residual'].mean():.3f}"
        seconds = f"{rows_of_variant['cpu'].median():.2f}"
        rows.append((title, masked, residual, seconds, *counts))
    return rows


def _loss_rows(study: PoseStudy) -> list[Row]:
    """Tabulate the loss by wrong poses, by formula and measured."""
    losses = {f"formula, {band.upper()} band, dB": study.predicted[band] for band in ("l", "x")}
    losses["reflectors, L band, median, dB"] = np.median(study.measured, axis=1)
    rows: list[Row] = []
    for name, values in losses.items():
        rows.append((name, *[f"{value:.1f}" for value in values]))
    return rows


def _false_alarm_rows(table: pd.DataFrame) -> list[Row]:
    """Tabulate the false alarms of the full-wave run by method."""
    rows: list[Row] = []
    for row in table.to_dict("records"):
        masked = f"{100 * row['masked']:.0f} %"
        rows.append((row["roadside"], row["method"], row["false alarms"], masked))
    return rows


def _peak_rows(table: pd.DataFrame) -> list[Row]:
    """Tabulate the peaks of the full-wave run by method."""
    rows: list[Row] = []
    for row in table[table["method"] != "none"].to_dict("records"):
        rank = ""
        false_above = ""
        if row["rank"]:
            rank = row["rank"]
            false_above = row["above"]
        rows.append(
            (
                row["roadside"],
                row["method"],
                row["object"],
                f"{row['VV']:+.1f}",
                f"{row['HH']:+.1f}",
                f"{100 * row['masked']:.0f} %",
                rank,
                false_above,
            )
        )
    return rows

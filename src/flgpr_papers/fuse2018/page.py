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
from flgpr_papers.fuse2018.process import VARIANTS, Calibration
from flgpr_papers.fuse2018.results import LaneResult
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
    """Return the page, which needs no other file, and write its figures into a folder as PNG."""
    shown = {**example, "box side": np.asarray(recipe.boxes.side)}
    drawn_from = Shown(recipe, lanes, loose, shown, poses, fullwave, found)
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
        false_alarms=[
            (r["roadside"], r["method"], r["false alarms"], f"{100 * r['masked']:.0f} %")
            for r in fullwave.false.to_dict("records")
        ],
        system=_system_rows(recipe),
        combinations=[(f"#{k}", _iterations(iterations)) for k, iterations in TABLE_II.items()],
        twins=twins,
        others=own_twins,
    )


def _twin(drawing: Drawing, folder: Path, quick: bool) -> Twin:
    """Draw a figure, leave it in the folder and give what the page shows of it."""
    picture = draw(drawing.figure, quick, 60 if quick else 110)
    write_whole(folder / f"{drawing.name}.png", picture)
    return Twin(drawing.number, drawing.title, picture, drawing.caption, drawing.numbers)


def _iterations(iterations: Sequence[int]) -> str:
    """Name the output images of a combination as Table II does."""
    return (
        f"Iterations {' and '.join(map(str, iterations))} times"
        if any(iterations)
        else "Original SAR image"
    )


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
                inside = {
                    f"lane {lane.name}, {convention}": matched.truth["inside"].to_numpy(dtype=bool)
                }
                yield from point_rows({variant: matched}, inside, shared="count", **area)


def _lane_row(recipe: FuseRecipe, lane: LaneResult) -> Row:
    """Return the row of a lane: its length, mines, frames and objects."""
    count = ((lane.objects["kind"] == kind).sum() for kind in ("bush", "post", "rock"))
    return lane.name, f"{recipe.lanes.length:g} m", len(lane.truth), lane.frames, *count


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
        rose, worse, fallen = ("no iterations",) * 3
        if "least" not in name:
            rose, worse, fallen = (
                f"{(rows_of_variant[what] > 0).sum()} of {len(rows_of_variant)}"
                for what in ("rises", "diverged", "fallen")
            )
        means = (
            f"{100 * rows_of_variant['masked'].mean():.1f}",
            f"{rows_of_variant['residual'].mean():.3f}",
            f"{rows_of_variant['cpu'].median():.2f}",
        )
        rows.append((title, *means, rose, worse, fallen))
    return rows


def _loss_rows(study: PoseStudy) -> list[Row]:
    """Tabulate the loss by wrong poses, by formula and measured."""
    losses = {f"formula, {band.upper()} band, dB": study.predicted[band] for band in ("l", "x")}
    losses["reflectors, L band, median, dB"] = np.median(study.measured, axis=1)
    rows: list[Row] = []
    for name, values in losses.items():
        rows.append((name, *[f"{value:.1f}" for value in values]))
    return rows


def _peak_rows(table: pd.DataFrame) -> list[Row]:
    """Tabulate the peaks of the full-wave run by method."""
    return [
        (
            r["roadside"],
            r["method"],
            r["object"],
            f"{r['VV']:+.1f}",
            f"{r['HH']:+.1f}",
            f"{100 * r['masked']:.0f} %",
            *((r["rank"], r["above"]) if r["rank"] else ("", "")),
        )
        for r in table[table["method"] != "none"].to_dict("records")
    ]

"""Names from files are shown as they are: no formulas, no markup, nothing that keeps a command from its end."""

import re
import warnings
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
import typer
from matplotlib.figure import Figure
from rich.table import Table
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.bars import Bars
from flgpr.commands.info import _title
from flgpr.commands.messages import plain_errors
from flgpr.commands.shell import ErrorStreamText, print_lines
from flgpr.commands.simulation import write_preview
from flgpr.geo.anchor import fit_anchor
from flgpr.geo.points import georeference
from flgpr.model.printable import for_terminal
from flgpr.report import figure_png
from flgpr.simulate import load_scene
from flgpr.store.notes import log_note
from flgpr.store.writing import csv_text
from flgpr.trials import figure_bytes
from flgpr_exchange.maps.points import write_gpx, write_kml
from flgpr_exchange.maps.qgis import project
from io_geodesy import LANE, on_the_ellipsoid
from sources import ROOT

NAMES = ("$\\frac{$", "[/red]", "[bold]", ":smile:", "$x$ & $y_{$", "<b>b</b>")


@pytest.mark.slow("draws all figures of a score")
def test_a_score_shows_names_as_they_are(tmp_path):
    truth = tmp_path / "truth.csv"
    rows = [f"{name},{k + 0.5},5.0,{name},0.1" for k, name in enumerate(NAMES)]
    truth.write_text("\n".join(["target_id,x,y,kind,depth", *rows]) + "\n")
    (tmp_path / "alarms.csv").write_text("x,y,confidence\n0.5,5.0,2.0\n3.0,9.0,1.0\n")
    (tmp_path / "lane.toml").write_text("x_min = 0.0\nx_max = 6.5\ny_min = 0.0\ny_max = 30.0\n")
    words = ["score", str(tmp_path / "alarms.csv"), "--truth", str(truth)]
    words += ["--lane", str(tmp_path / "lane.toml"), "-o", str(tmp_path / "score")]
    ran = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert ran.exit_code == 0, ran.output
    for name in NAMES:
        assert f"{name}: {name}, 10.0 cm" in ran.output
    page = (tmp_path / "score" / "report.html").read_text()
    assert "$\\frac{$" in page
    assert "<b>b</b>" not in page
    assert {path.suffix for path in (tmp_path / "score").iterdir()} >= {".png", ".pdf"}


def test_a_preview_shows_the_name_of_its_scene(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        "name = '$\\frac{$'\nsite = 'gravel'\nlength = 6.0\n[track]\npositions = [0.0]\n"
    )
    assert write_preview(load_scene(scene), 3, tmp_path / "a.png", force=False).is_file()


def draw(text, scale="linear"):
    figure = Figure(figsize=(2, 2))
    axes = figure.subplots()
    axes.set(title=text, xscale=scale, xlim=(1, 100))
    axes.plot([1, 100], [0, 1], label=text)
    axes.legend()
    return figure


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_a_figure_is_drawn_whatever_its_names_are(kind):
    for name in NAMES:
        assert figure_bytes(draw(name), kind)


def test_a_picture_is_drawn_whatever_its_names_are():
    for name in NAMES:
        assert figure_png(draw(name), dpi=50)


def test_labels_of_logarithmic_axes_stay_formulas():
    figure = draw("$x$", "log")
    figure_bytes(figure)
    figure_bytes(figure)  # now the labels have their text before the figure is drawn
    labels = figure.axes[0].xaxis.get_ticklabels()
    assert all(label.get_parse_math() for label in labels)
    assert "mathdefault" in labels[0].get_text()
    assert not figure.axes[0].title.get_parse_math()


def test_bars_show_names_as_they_are():
    with Bars() as bars:
        assert list(bars(np.arange(2), "lane [/red]", 2)) == [0, 1]


HOSTILE = (
    "\x1b]0;owned\x07",  # sets the title of the window
    "\x1b[2J\x1b[1;1H",  # clears the screen
    "a\rb",
    "\x9b31m",
    "\u202egnp.exe",
    "\udcff",
    "\ufffe\uffff",
)
"""Names that steer a terminal, turn the direction of text or are no characters."""


def steering(text):
    """Return the characters of a text that steer a terminal."""
    return [letter for letter in text if not letter.isprintable() and letter not in "\n\t"]


@pytest.mark.parametrize("name", HOSTILE, ids=ascii)
def test_what_steers_a_terminal_is_written_as_an_escape(name):
    shown = for_terminal(f"a\n{name}\tb")
    assert steering(shown) == []
    assert shown.startswith("a\n")
    assert shown.endswith("\tb")
    assert for_terminal("Größe 3 m², 5\u202f%, ж 字") == "Größe 3 m², 5\u202f%, ж 字"


@pytest.mark.parametrize("name", [name for name in HOSTILE if name != "\udcff"], ids=ascii)
@pytest.mark.parametrize("stream", ["out", "err"])
def test_a_command_prints_no_sign_that_steers(name, stream, capfd):
    print_lines([name] if stream == "out" else [ErrorStreamText(name)])
    with pytest.raises(typer.Exit), plain_errors():
        raise ValueError(f"{name}: bad")
    with plain_errors():
        log_note(f"note of {name}")
        warnings.simplefilter("always")
        warnings.warn(f"warning of {name}", stacklevel=1)
    printed = capfd.readouterr()
    assert steering(printed.out + printed.err) == []
    assert len(printed.out + printed.err) > 30


@pytest.mark.parametrize("name", HOSTILE, ids=ascii)
def test_a_table_and_a_bar_show_no_sign_that_steers(name, capfd):
    table = Table(title=name)
    table.add_column(name)
    table.add_row(name)
    print_lines([table])
    with Bars() as bars:
        assert list(bars([1], name, 1)) == [1]
    printed = capfd.readouterr()
    assert steering(printed.out) == []
    for sign in name:
        assert sign in "gnp.exeab31m;]0[2JHowned" or sign not in printed.err.replace("\x1b[", "")


def test_nothing_is_printed_by_another_way():
    """The one door is ``say``: the rest of the commands does not call ``echo`` or ``print``."""
    others = []
    for path in sorted(ROOT.parent.rglob("commands/*.py")):
        text = path.read_text(encoding="utf-8")
        if re.search(r"typer\.s?echo\(|(?<![\w.])print\(|\bConsole\(", text):
            others.append(path.name)
    assert others == ["messages.py"]


@pytest.mark.slow("draws all figures of a score")
@pytest.mark.parametrize("name", HOSTILE, ids=ascii)
def test_a_score_of_hostile_names_comes_to_its_end(name, tmp_path):
    table = pd.DataFrame({"target_id": [name], "x": [0.5], "y": [5.0], "kind": [name]})
    data = csv_text(table.assign(depth=0.1)).encode("utf-8", "replace")
    (tmp_path / "truth.csv").write_bytes(data)
    alarms = tmp_path / "al\udcff.csv"
    alarms.write_text("x,y,confidence\n0.5,5.0,2.0\n3.0,9.0,1.0\n")
    (tmp_path / "lane.toml").write_text("x_min = 0.0\nx_max = 6.5\ny_min = 0.0\ny_max = 30.0\n")
    words = ["score", str(alarms), "--truth", str(tmp_path / "truth.csv")]
    words += ["--lane", str(tmp_path / "lane.toml"), "-o", str(tmp_path / "score")]
    ran = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert ran.exit_code == 0, ran.output
    assert steering(ran.output) == []


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
@pytest.mark.parametrize("name", HOSTILE, ids=ascii)
def test_a_figure_of_hostile_names_is_drawn(kind, name):
    assert figure_bytes(draw(name), kind)


def test_the_title_of_a_run_is_one_line():
    report = {"title": "a\nwarning: \x1b[1mb", "source": "c\nd"}
    assert _title(report) == "a\\nwarning: \\x1b[1mb (c\\nd)"


@pytest.mark.parametrize("name", HOSTILE, ids=ascii)
def test_documents_of_maps_are_xml_whatever_their_names_are(name, tmp_path):
    rows = pd.DataFrame(
        {"target_id": [name], "x": [0.5], "y": [5.0], "kind": [name], "depth": [0.1]}
    )
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)
    points = georeference(rows, anchor, "truth", name, "2026-11-21T10:00:00+00:00")
    write_kml(points, tmp_path / "a.kml", name)
    write_gpx(points, tmp_path / "a.gpx")
    (tmp_path / "a.qgs").write_bytes(project(name, name, "EPSG:32633", (0, 0, 1, 1), []))
    for path in tmp_path.iterdir():
        ElementTree.parse(path)

"""Names from files are shown as they are: no formulas, no markup, nothing that keeps a command from its end."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.bars import Bars
from flgpr.commands.simulation import write_preview
from flgpr.report import figure_png
from flgpr.simulate import load_scene
from flgpr.trials import figure_bytes

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

"""The page on an array, from a made-up study."""

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.design.array import Design, Question
from flgpr.model import load_sensor
from flgpr.report import design_report
from flgpr.report.design_page import design_html

FACTS = {
    "transmitters": 2, "receivers": 18, "pairs": 36, "aperture": 3.9, "height": 5, "lowest": 442.5e6, "highest": 3e9,
    "tones": 1024, "unambiguous_range": 60, "widest_gap": 0.1, "grating_angle": float("nan"),
}  # fmt: skip


def made_up():
    x = np.linspace(-3, 3, 7)
    y = np.linspace(6, 14, 9)
    dips = np.linspace(-60, 0, 63).reshape(9, 7)
    lobe = {"distance": 10.0, "down": 0.07, "cross": 0.3, "level": -14.2, "x": 1.25, "y": -0.5}
    return Design(
        load_sensor("sri-array"), FACTS, x, y, np.full((9, 7), 0.07) + x / 1e3, np.full((9, 7), 0.3) + x / 1e2,
        lobes=[lobe, lobe | {"level": -11.0}, lobe], responses=dict.fromkeys((7.0, 10.0, 13.0), (y, x, dips)),
        close=dict.fromkeys((7.0, 10.0, 13.0), (y - 10, x, dips)),
        ratio={("metal", "HH"): dips, ("plastic", "HH"): dips}, ratio_x=x, ratio_y=y,
    )  # fmt: skip


@pytest.mark.slow("draws all figures of a design")
def test_the_page_needs_nothing_beside_it():
    page = design_html([made_up(), made_up()], Question(depth=0.1))
    assert page.count("data:image/png;base64") == 7
    assert 'src="http' not in page
    assert "href" not in page
    for words in (
        "Point spread",
        "Resolution over the ground",
        "Lobes",
        "Expected signal to clutter",
        "leaves out",
    ):
        assert words in page
    told = " ".join(page.split())
    assert "0.4425 to 3 GHz: 7 cm down-range by 30 cm cross-range at 10 m." in told
    assert "at most -11 dB, +1.2 m across and -0.5 m along from a point 10 m ahead." in told
    assert "mines 10 cm deep" in told
    assert told.count("sri-array: no signal to clutter by formula, for it was not asked for.") == 2
    assert told.index("no signal to clutter") < told.index("cm down-range"), (
        "the answer comes first"
    )
    assert told.count("<td class=n>none</td>") == 2, "no grating lobes"
    assert "nan" not in told.split("</table>")[0]


@pytest.mark.slow("draws all figures of a design")
def test_faults_are_told(tmp_path):
    for sensors in ([], ["sri-array"] * 5):
        with pytest.raises(ValueError, match="sensors must be one to four"):
            design_report(sensors, tmp_path / "a.html")
    (tmp_path / "there.html").write_text("")
    with pytest.raises(FileExistsError):
        design_report(["sri-array"], tmp_path / "there.html")
    told = CliRunner().invoke(app, ["design", "no-such-array", "-o", str(tmp_path / "a.html")])
    assert told.exit_code == 2
    assert "sensor must be" in told.stderr
    assert not (tmp_path / "a.html").exists()

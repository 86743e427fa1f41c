"""A result as a notebook shows it."""

import base64
import re

import pytest

from flgpr.model import Lane
from flgpr.results.notebook_html import detection_html
from flgpr.results.result import read_result
from small_results import LANE, small_result

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def main(tmp_path):
    return read_result(small_result(tmp_path / "result")).detections[0]


def test_the_table_holds_the_strongest_alarms_in_their_order(main):
    html = detection_html(main, LANE, "small")
    cells = re.findall(r"<td>(.*?)</td>", html)
    assert cells == ["0.1", "3", "9", "-0.7", "3.5", "4", "0.9", "2.2", "2.5"]
    assert "3 alarms in 4 m² of small" in html


def test_the_picture_is_a_png_within_the_page(main):
    picture = re.search(r'src="data:image/png;base64,([^"]+)"', detection_html(main, LANE, "s"))[1]
    assert base64.b64decode(picture, validate=True).startswith(PNG)


def test_titles_are_text_and_no_markup(main):
    html = detection_html(main, Lane(-1.0, 1.0, 2.0, 4.0), "<script>alert(1)</script>")
    assert "<script>" not in html
    assert "&lt;script&gt;" in html

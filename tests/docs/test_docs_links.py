"""The check of the built pages' links notices what leads nowhere."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
import links
import pytest

pytestmark = pytest.mark.slow("checks of pages")


def test_links_that_lead_nowhere_are_listed(tmp_path):
    (tmp_path / "api").mkdir()
    (tmp_path / "picture.png").touch()
    (tmp_path / "index.html").write_text(
        '<h1 id="top">a</h1><a href="api/a.html#roc"></a><a href="#top"></a><a href="https://elsewhere.org/x#y"></a>'
        '<img src="picture.png"><a href="mailto:a@b.c"></a><a href="api/a.html#gone"></a><img src="lost.png">'
    )
    (tmp_path / "api" / "a.html").write_text(
        '<p id="roc"></p><a href="../index.html#top"></a><a href="b.html"></a>'
    )
    assert links.broken(tmp_path) == [
        "api/a.html: b.html",
        "index.html: api/a.html#gone",
        "index.html: lost.png",
    ]

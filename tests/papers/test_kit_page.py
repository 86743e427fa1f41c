"""What the pages of the studies share."""

import pytest

from flgpr.report import kit
from flgpr_papers.kit.page import Twin

pytestmark = pytest.mark.slow("studies of papers")


def test_a_figure_of_the_paper_stands_beside_its_numbers():
    one = Twin(
        "Fig. 8",
        "Clutter & iterations",
        b"png",
        "two boxes",
        [("clutter falls by", "26.5 dB", "23 dB")],
    )
    macro = '{% import "study.html" as study with context %}{{ study.twin(one) }}'
    text = kit._environment("flgpr_papers").from_string(macro).render(one=one, quick=True)
    assert "Fig. 8. Clutter &amp; iterations" in text
    assert "<td>26.5 dB</td><td>23 dB</td>" in text
    assert Twin("", "Ours alone", b"", "").heading == "Ours alone"

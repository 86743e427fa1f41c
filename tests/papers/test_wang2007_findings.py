"""Judging single statements of the paper."""

import numpy as np
import pytest

from flgpr.features import FEATURES
from flgpr_papers.kit.findings import all_of
from flgpr_papers.wang2007.findings import contrast_lead

pytestmark = pytest.mark.slow("studies of papers")


def test_the_lead_of_local_contrast():
    scores = np.full(10, 0.3)
    scores[[FEATURES.index("C_VV"), FEATURES.index("M_HH")]] = 0.8, 0.5
    assert contrast_lead(scores) == pytest.approx(0.3)
    np.testing.assert_allclose(contrast_lead(np.stack([scores, 1 - scores])), [0.3, 0.7 - 0.7])


def test_a_claim_of_several_parts_holds_if_all_do():
    assert all_of(["agrees", "cannot say"]) == "cannot say"
    assert all_of(["agrees", "disagrees", "cannot say"]) == "disagrees"
    assert all_of(["agrees", "agrees"]) == "agrees"

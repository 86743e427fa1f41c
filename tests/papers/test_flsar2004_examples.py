"""Templates and examples of flsar2004."""

import numpy as np
import pytest

from flgpr_papers.flsar2004 import findings as fi

pytestmark = pytest.mark.slow("studies of papers")


def test_templates_of_one_signature_have_one_component():
    rng = np.random.default_rng(4)
    signature = rng.random((1, 2, 3, 9, 7))
    alike = signature * rng.uniform(1, 5, (30, 1, 1, 1, 1))
    share, cosine = fi.component_interval(alike, 20)
    assert share[0] == pytest.approx(1)
    assert cosine[0] == pytest.approx(1)
    different = rng.normal(size=(30, 2, 3, 9, 7))
    assert fi.component_interval(different, 20)[0][0] < 0.3
    assert fi.likeness_interval(alike, 3 * alike, 20)[0] == pytest.approx(1)

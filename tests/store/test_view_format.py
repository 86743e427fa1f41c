"""The seal of a score that the viewer shows."""

import json

import pytest

from flgpr.json_text import canonical_json
from flgpr.store.view_format import sealed_view_score, view_score_body

CONTENT = {"result_sha256": "of-a-result", "halo": 0.5}


def test_a_sealed_score_is_read_as_it_was_written():
    sealed = sealed_view_score(CONTENT)
    assert json.loads(sealed)["format"] == "flgpr-view-score"
    assert view_score_body(sealed, "of-a-result") == canonical_json(CONTENT)


@pytest.mark.parametrize(
    ("data", "identity", "reason"),
    [
        (sealed_view_score(CONTENT), "of-another", "belongs to another result"),
        (sealed_view_score(CONTENT).replace(b"0.5", b"0.4"), "of-a-result", "differs from what"),
        (b"{", "of-a-result", "cannot be read"),
        (b'{"sha256": ""}', "of-a-result", "cannot be read"),
        (b"[]", "of-a-result", "cannot be read"),
    ],
)
def test_a_score_that_is_not_the_results_own_is_refused(data, identity, reason):
    with pytest.raises(ValueError, match=f"^{reason}"):
        view_score_body(data, identity)

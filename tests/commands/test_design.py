"""Options of ``flgpr design`` that go together, and the table of signal to clutter."""

import json

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.design import design

TABLE = ["design", "sri-array", "--signal-to-clutter", "--site", "gravel", "--body", "m19"]
TABLE += ["--depth", "0.05", "--band", "0.75e9", "0.95e9"]


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({"body": ["m19"]}, "`body` goes with signal_to_clutter, got it without"),
        ({"distance": 9.0}, "`distance` goes with signal_to_clutter, got it without"),
        ({"measure": 0}, "`measure` goes with signal_to_clutter, got it without"),
        ({"depth": [0.0, 0.1]}, ".depth. must be given once .*, got it 2 times"),
    ],
)
def test_options_of_the_table_have_no_effect_on_the_page(options, rule, tmp_path):
    with pytest.raises(ValueError, match=rule):
        design("sri-array", output=tmp_path / "design.html", **options)
    assert not (tmp_path / "design.html").exists()


def test_a_page_beside_the_table_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"`output` is of the page, .* got .*a\.html"):
        design("sri-array", output=tmp_path / "a.html", signal_to_clutter=True)


def test_the_page_has_no_json(tmp_path):
    done = CliRunner().invoke(
        app, ["design", "sri-array", "--json", "-o", str(tmp_path / "a.html")]
    )
    assert done.exit_code == 2
    assert "--json goes with --signal-to-clutter" in done.output
    assert not list(tmp_path.iterdir())


def test_the_ground_of_the_table_is_a_site_or_permittivity_and_loss_together():
    with pytest.raises(ValueError, match="got 'moon'"):
        design("sri-array", signal_to_clutter=True, site="moon")
    with pytest.raises(ValueError, match="loss_tangent must be given with permittivity"):
        design("sri-array", signal_to_clutter=True, permittivity=6.0)


def test_the_table_is_printed_and_given_as_json():
    words = CliRunner().invoke(app, TABLE)
    assert words.exit_code == 0, words.output
    assert "Signal to clutter (dB): " in words.output
    assert "m19" in words.output
    rows = json.loads(CliRunner().invoke(app, [*TABLE, "--json"]).stdout)["signal_to_clutter"]
    assert {row["body"] for row in rows} == {"m19"}
    assert {row["depth"] for row in rows} == {0.05}
    assert len({row["polarization"] for row in rows}) == len(rows)
    for row in rows:
        assert f"{row['signal_to_clutter_db']:.1f}" in words.output

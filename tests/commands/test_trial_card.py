"""What a score states of its trial, and what is said before anything is asked for."""

import json
import re

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.entrants import (
    UNRANKED,
    Entrant,
    TrialCard,
    checked_vendors,
    day_of_score,
    stated_vendor,
)
from flgpr.commands.scoring import _read_lists
from flgpr.model import Lane
from scored import compare_alarms, find_entrant, score_alarms

DAY = "2026-05-04"


def card(*vendors):
    return TrialCard(vendors, DAY)


@pytest.mark.parametrize(
    ("head", "vendor"),
    [
        ("# site: north\n# Vendor : ACME Radar,,\nx,y,confidence\n", "ACME Radar"),
        ("\ufeff#hersteller=Söhne & Co\nx;y;confidence\n", "Söhne & Co"),
        ("x,y,confidence\n# vendor: after the header\n", ""),
        ("# made by a vendor: no entry of its own\nx,y,confidence\n", ""),
    ],
)
def test_a_list_names_its_vendor_at_its_head(tmp_path, head, vendor):
    path = tmp_path / "a.csv"
    path.write_text(head + "1,2,3\n", encoding="utf-8")
    assert stated_vendor(find_entrant(path)) == vendor


def test_vendors_are_one_line_names_one_for_each_list():
    assert checked_vendors([" A ", "B"], 2) == ("A", "B")
    assert checked_vendors([], 2) == ()
    with pytest.raises(ValueError, match="vendor must be given once per alarm list, got 1 for 2"):
        checked_vendors(["A"], 2)
    for name in ("", "a\nb", "a\u202eb", "x" * 121):
        with pytest.raises(ValueError, match="vendor must be a name of 1 to 120 characters"):
            checked_vendors([name], 1)


@pytest.mark.slow("runs a whole command more than once")
def test_the_page_bears_vendor_file_day_lane_and_rules_also_in_its_margins(scoring_files):
    hostile = 'ACME "</style><script>alert(1)</script>'
    folder = scoring_files / "scored"
    files = [scoring_files / name for name in ("alarms.csv", "truth.csv", "lane.toml")]
    score_alarms(*files, folder, card=card(hostile))
    page = (folder / "report.html").read_text()
    notes = json.loads((folder / "roc.json").read_text())["notes"]
    assert (notes["vendor"], notes["scored_on"]) == (hostile, DAY)
    assert "<script>" not in page
    block = re.search(r"<section class=trial.*?</section>", page, re.DOTALL)[0]
    for text in (
        "ACME &#34;&lt;/style&gt;", "alarms.csv, 3 alarms", notes["alarms_sha256"],
        notes["truth_sha256"], DAY, "x -2 to 2 m, y 0 to 60 m (240 m²)", "halo radius 1 m",
        "area rule union", "95 % intervals",
    ):  # fmt: skip
        assert text in block, text
    for place in ("top-left", "top-right", "bottom-left", "bottom-right"):
        assert f"@{place}" in page
    margin = re.search(r"@top-left \{ content: \"(.*?)\";", page)[1]
    unescaped = re.sub(r"\\([0-9a-f]{6})", lambda match: chr(int(match[1], 16)), margin)
    assert unescaped == f"{hostile}: alarms.csv ({notes['alarms_sha256'][:12]})"


@pytest.mark.slow("runs a whole command more than once")
def test_without_a_card_a_page_says_that_nothing_is_stated(scoring_files):
    folder = scoring_files / "scored"
    files = [scoring_files / name for name in ("alarms.csv", "truth.csv", "lane.toml")]
    score_alarms(*files, folder)
    assert "vendor" not in json.loads((folder / "roc.json").read_text())["notes"]
    assert "<dt>vendor</dt><dd>not stated</dd>" in (folder / "report.html").read_text()


@pytest.mark.slow("runs a whole command more than once")
def test_lists_without_confidences_rank_equal_and_have_one_operating_point(scoring_files):
    files = [scoring_files / name for name in ("truth.csv", "lane.toml")]
    bare = scoring_files / "bare.csv"
    bare.write_text("x,y\n0.1,10.2\n-1,50\n1,20\n1,40\n")
    gaps = scoring_files / "gaps.csv"
    gaps.write_text("x,y,confidence\n0.1,10.2,3\n-1,50,\n1,30,1\n")
    for path, rows in ((bare, "columns confidence"), (gaps, "got 1 of 3 rows")):
        with pytest.raises(ValueError, match=f"{rows}.*`unranked` takes"):
            score_alarms(path, *files, scoring_files / "refused")

    from flgpr.commands.positions import table_reading

    reading = table_reading(unranked=True)
    folder = scoring_files / "scored"
    [scored] = score_alarms(bare, *files, folder, reading=reading)
    assert len(scored.curve) == 2
    assert scored.far == scored.curve["far"].iloc[-1] > 0
    assert scored.point["n_detected"] == 1
    page = (folder / "report.html").read_text()
    assert "one operating point" in page
    notes = json.loads((folder / "roc.json").read_text())["notes"]
    assert notes["ranking"] == UNRANKED
    assert "4 of 4 alarms have no confidence" in notes["alarms_read"][0]
    # A rate that the user names is kept, and a list with all its confidences is ranked by them.
    [at_rate] = score_alarms(bare, *files, scoring_files / "rate", reading=reading, far=0.02)
    assert at_rate.rules.far == 0.02
    [ranked] = score_alarms(
        scoring_files / "alarms.csv", *files, scoring_files / "ranked", reading=reading
    )
    assert len(ranked.curve) == 4


def test_a_comparison_draws_all_lists_and_says_whose_they_are(scoring_files):
    from flgpr.commands.positions import table_reading

    bare = scoring_files / "bare.csv"
    bare.write_text("x,y\n0.1,10.2\n-1,50\n1,20\n1,40\n")
    lists = [scoring_files / "alarms.csv", bare]
    comparison = compare_alarms(
        lists,
        scoring_files / "truth.csv",
        scoring_files / "both",
        scoring_files / "lane.toml",
        reading=table_reading(unranked=True),
        card=card("ACME", "Bravo"),
    )
    # The one operating point of the list without ranks is compared, too.
    own = comparison.points[comparison.points["n_false"] == 3]
    assert len(own[own["detector"] == "bare"])
    page = (scoring_files / "both" / "comparison.html").read_text()
    for text in ("<td>ACME</td>", "<td>Bravo</td>", "<td>bare.csv</td>", "<td>equal</td>", DAY):
        assert text in page, text
    assert "one operating point, at its last alarm: bare" in page


@pytest.mark.slow("runs a whole command more than once")
def test_the_same_score_made_on_a_later_day_keeps_its_day(scoring_files, monkeypatch):
    folder = scoring_files / "scored"
    today = day_of_score(folder, "roc.json", overwrite=False)
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", today)
    files = [scoring_files / name for name in ("alarms.csv", "truth.csv", "lane.toml")]
    score_alarms(*files, folder, card=card())
    assert day_of_score(folder, "roc.json", overwrite=False) == DAY
    assert day_of_score(folder, "roc.json", overwrite=True) == today
    before = (folder / "report.html").read_bytes()
    score_alarms(*files, folder, card=card(), overwrite=False)
    assert (folder / "report.html").read_bytes() == before
    (folder / "roc.json").write_text('{"notes": {"scored_on": "<b>"}}')
    assert day_of_score(folder, "roc.json", overwrite=False) == today


def test_a_list_that_is_not_there_is_said_first(tmp_path):
    told = CliRunner().invoke(app, ["score", str(tmp_path / "vendor.csv")])
    assert told.exit_code == 2
    assert f"alarm list or result not found: {tmp_path / 'vendor.csv'}" in told.output
    told = CliRunner().invoke(app, ["score", "--seal", str(tmp_path / "truth.csv")])
    assert f"truth file not found: {tmp_path / 'truth.csv'}" in told.output


def test_rules_of_a_passphrase_are_shown_before_it_is_typed(scoring_files):
    pytest.importorskip("cryptography")
    truth, lane, sealed = (str(scoring_files / name) for name in ("truth.csv", "lane.toml", "s"))
    arguments = ["score", "--seal", truth, "--lane", lane, "-o", sealed]
    told = CliRunner().invoke(app, arguments, input="short\n")
    assert told.exit_code == 2
    rule = told.output.index("at least 8 characters and hard to guess")
    assert rule < told.output.index("asked for twice") < told.output.index("passphrase:")

    phrase = "gravel otter seven lamps\n"
    assert CliRunner().invoke(app, arguments, input=phrase * 2).exit_code == 0
    alarms = str(scoring_files / "alarms.csv")
    told = CliRunner().invoke(
        app, ["score", alarms, "--sealed", sealed, "-o", f"{sealed}-b", "--vendor", "ACME"],
        input=phrase,
    )  # fmt: skip
    assert told.exit_code == 0, told.output
    assert told.output.index("counted in its log") < told.output.index("passphrase:")
    page = (scoring_files / "s-b" / "report.html").read_text()
    assert "<dt>vendor</dt><dd>ACME</dd>" in page
    assert "sealed with the truth" in page
    assert "x -2 to 2 m" not in page


def test_a_list_of_a_result_is_named_with_its_folder(tmp_path):
    path = tmp_path / "first" / "alarms.csv"
    data = b"alarm_id,x,y,confidence\na,9,5,1\n"
    with pytest.raises(ValueError, match=r"all 1 of first/alarms\.csv lie outside"):
        _read_lists([Entrant(path, data, of_result=True)], Lane(-1.0, 1.0, 0.0, 9.0))
    assert Entrant(path, data).file == "alarms.csv"

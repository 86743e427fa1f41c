"""Tables as spreadsheets of other countries write them."""

import pandas as pd
import pytest

from flgpr.store import read_table

PLAIN = "target_id,x,y,kind,depth\n001,-0.5,10.25,metal,0.05\nb,1,30,plastic,\n"


@pytest.mark.parametrize(
    "text",
    [
        PLAIN.replace(",", ";"),
        PLAIN.replace(",", ";").replace(".", ","),
        "\ufeff" + PLAIN.replace(",", ";").replace(".", ","),
        PLAIN.replace(",", ";").replace(".", ",").replace("\n", "\r\n"),
    ],
)
def test_semicolons_and_decimal_commas_are_read(text, tmp_path):
    (tmp_path / "plain.csv").write_text(PLAIN)
    (tmp_path / "other.csv").write_text(text, encoding="utf-8", newline="")
    want = read_table(tmp_path / "plain.csv", "truth")
    pd.testing.assert_frame_equal(read_table(tmp_path / "other.csv", "truth"), want)
    assert want["target_id"].tolist() == ["001", "b"]


def test_a_name_with_a_comma_is_no_number(tmp_path):
    (tmp_path / "t.csv").write_text("target_id;x;y;kind;depth\n1,5;0.5;3;metal, old;0.05\n")
    row = read_table(tmp_path / "t.csv", "truth").iloc[0]
    assert (row["target_id"], row["x"], row["kind"]) == ("1,5", 0.5, "metal, old")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y;confidence\n1,2;3\n", "by commas or by semicolons, got both"),
        ("x;y;confidence\n1,5;2.5;3\n", "decimal commas or decimal points, got both"),
        ("x;y;confidence\n1.234,5;2;3\n", "alarms.x must be numbers"),
        ("x;y\n1;2\n", "must have the columns confidence; got x, y"),
        ("x,y,confidence\n1,2,True\n", "alarms.confidence must be numbers .* got 'True' in row 1"),
    ],
)
def test_what_could_be_read_in_two_ways_is_refused(text, message, tmp_path):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ValueError, match=f"a.csv: .*{message}"):
        read_table(tmp_path / "a.csv", "alarms")

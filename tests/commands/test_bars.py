"""Progress bars are drawn on the error stream and leave the items as they are."""

import pytest

from flgpr.commands.bars import Bars


def test_items_pass_in_their_order_and_the_bar_is_on_the_error_stream(capsys):
    with Bars() as bars:
        assert list(bars(iter("abc"), "reading scans", 3)) == ["a", "b", "c"]
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "reading scans" in shown.err
    assert "3/3" in shown.err


def test_every_piece_of_work_has_a_bar_of_its_own(capsys):
    with Bars() as bars:
        list(bars(range(2), "first", 2))
        list(bars(range(5), "second", 5))
    shown = capsys.readouterr().err
    assert "2/2" in shown
    assert "5/5" in shown


def test_without_work_nothing_is_drawn(capsys):
    with Bars():
        pass
    assert capsys.readouterr().err == ""


def test_labels_from_files_are_no_markup(capsys):
    with Bars() as bars:
        list(bars([1], "[red]lane[/red]", 1))
    assert "[red]lane[/red]" in capsys.readouterr().err


def test_a_bar_of_work_that_fails_shows_how_far_it_came(capsys):
    def scans():
        yield 1
        raise ValueError("scan 2 is damaged")

    with pytest.raises(ValueError, match="scan 2 is damaged"), Bars() as bars:
        list(bars(scans(), "reading", 7))
    assert "1/7" in capsys.readouterr().err

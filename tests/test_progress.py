"""Progress that nobody wants to see."""

from flgpr.progress import silent


def test_items_pass_through_one_by_one(capsys):
    taken = []

    def items():
        for number in range(3):
            taken.append(number)
            yield number

    passed = silent(items(), "scans", 3)
    assert taken == []
    assert next(iter(passed)) == 0
    assert taken == [0]
    assert list(passed) == [1, 2]
    assert capsys.readouterr() == ("", "")

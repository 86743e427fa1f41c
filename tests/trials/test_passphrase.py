"""Passphrases: what a program guesses soon is refused, and no error repeats it."""

import pytest

from flgpr.trials import check_passphrase


def test_four_words_are_accepted():
    check_passphrase("gravel otter seven lamps")


@pytest.mark.parametrize("weak", ["short", "password", "12345678", "qwertzuiop", "aaaaaaaaaaaa"])
def test_a_weak_passphrase_is_refused_and_not_repeated(weak):
    with pytest.raises(ValueError, match="passphrase must") as caught:
        check_passphrase(weak)
    assert weak not in str(caught.value)


def test_a_very_long_passphrase_takes_no_time():
    check_passphrase("gravel otter seven lamps " * 10_000)

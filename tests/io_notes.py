"""What notes of a reader must say: every difference from the file once, with its count, and nothing else."""

from hypothesis import strategies as st


def check_notes(notes, *expected):
    """Fail unless each of ``expected`` is in a note of its own, and every note has one of them; None expects none."""
    left = list(notes)
    for words in expected:
        if words is None:
            continue
        found = [note for note in left if words in note]
        assert len(found) == 1, (words, list(notes))
        left.remove(found[0])
    assert not left, left


def if_any(items, words):
    """Return what a note says of items; None, for no note, if there are none."""
    return words if items else None


def some(first, last, most=4):
    """Draw up to ``most`` traces from ``first`` to ``last``."""
    return st.sets(st.integers(first, last), max_size=most)

"""What decoding of one thing may take: memory and work, checked before they are taken.

A few bytes of a file can claim any amount: counts, nested types, packed zeros, separators alone.
Whoever decodes something of unknown origin makes a :class:`Budget` for it and spends it as it goes,
each part before it is made. Sizes that a file declares are checked by
:func:`flgpr.door.check_expansion`.
"""

from __future__ import annotations

MOST_MEMORY = 2 * 10**9
"""Memory that one thing may take when it is decoded, bytes."""
VALUE = 100
"""Memory of a value of Python with its place in a list or a dict, bytes: a little less, mostly."""


class Budget:
    """Memory that decoding of one thing may take.

    Parameters
    ----------
    what : str
        What is decoded, for errors.
    most : int, optional
        Bytes; by default :data:`MOST_MEMORY`.
    """

    def __init__(self, what: str, most: int | None = None) -> None:
        self.what = what
        self.most = MOST_MEMORY if most is None else most
        self.spent = 0

    def spend(self, size: int) -> None:
        """Spend bytes that are about to be taken; more than there are is a ValueError."""
        self.spent += size
        if self.spent > self.most:
            raise ValueError(
                f"{self.what} would take {self.spent / 1e6:.4g} MB of memory or more when it is "
                f"read, and may take {self.most / 1e6:g} MB"
            )

    def spend_values(self, count: int) -> None:
        """Spend the memory of so many values of Python."""
        self.spend(VALUE * count)

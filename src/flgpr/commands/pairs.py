"""Values that belong together on the command line: ``--x -3,3`` is the same as ``--x -3 3``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from typer.core import TyperCommand


class PairCommand(TyperCommand):
    """A command whose options of several numbers also take them as one word with commas."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words behind the command."""
        several = [parameter for parameter in self.params if parameter.nargs > 1]
        counts = {name: parameter.nargs for parameter in several for name in parameter.opts}
        return super().parse_args(ctx, split_numbers(args, counts))


def split_numbers(arguments: Sequence[str], counts: Mapping[str, int]) -> list[str]:
    """Return the words of a command with numbers that are joined by commas as a word each.

    Parameters
    ----------
    arguments : sequence of str
        Words as they were typed.
    counts : mapping of str to int
        Number of values of each option that takes several.

    Returns
    -------
    list of str
        The words. Those that are no such numbers, or not so many, are left as they are.
    """
    split: list[str] = []
    option = ""  # the option whose values are next
    for number, word in enumerate(arguments):
        if word == "--":  # all that follows are arguments
            return [*split, *arguments[number:]]
        name, equals, joined = word.partition("=")
        if equals and name in counts and _has_numbers(joined, counts[name]):
            split += [name, *joined.split(",")]
        elif option and _has_numbers(word, counts[option]):
            split += word.split(",")
        else:
            split.append(word)
        option = word if word in counts else ""
    return split


def _has_numbers(word: str, count: int) -> bool:
    """Return whether a word is so many numbers with commas between them."""
    numbers = word.split(",")
    try:
        for number in numbers:
            float(number)
    except ValueError:
        return False
    return len(numbers) == count

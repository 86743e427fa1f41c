"""How long work reports its progress."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, TypeVar

T = TypeVar("T")


class Track(Protocol):
    """Passes items through and shows how far they have come."""

    def __call__(self, items: Iterable[T], label: str, total: int) -> Iterable[T]:
        """Iterate over items under a label."""


def silent(items: Iterable[T], label: str, total: int) -> Iterable[T]:  # noqa: ARG001
    """Pass items through and show nothing."""
    return items

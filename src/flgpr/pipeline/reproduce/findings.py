"""A statement of a paper beside what the simulated lanes show, and the rules by which it is judged.

A claim that something is larger agrees if the 95 % interval of the difference lies above zero, disagrees if it lies
below, and is undecided otherwise. A figure of the paper agrees if it lies in the 95 % interval of ours.
"""

from __future__ import annotations

from dataclasses import dataclass

AGREES, DISAGREES, UNDECIDED = "agrees", "disagrees", "undecided"


@dataclass(frozen=True)
class Finding:
    """One statement of the paper beside ours.

    Attributes
    ----------
    claim, paper, ours : str
        What the paper says, its figure ("not tried" where the question is ours) and ours with its interval.
    verdict : {"agrees", "disagrees", "undecided"}
        By the module's rules, or by those that the paper's own module adds.
    note : str
        What stands behind it, and why it may differ.
    """

    claim: str
    paper: str
    ours: str
    verdict: str
    note: str = ""


def larger(low: float, high: float) -> str:
    """Judge a claim that a difference is positive by its interval.

    Parameters
    ----------
    low, high : float
        Interval of the difference.

    Returns
    -------
    str
        The verdict.
    """
    return AGREES if low > 0 else DISAGREES if high < 0 else UNDECIDED


def within(figure: float, low: float, high: float) -> str:
    """Judge a figure of the paper by our interval.

    Parameters
    ----------
    figure : float
        The paper's.
    low, high : float
        Interval of ours.

    Returns
    -------
    str
        The verdict.
    """
    return AGREES if low <= figure <= high else DISAGREES

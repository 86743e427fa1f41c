"""What ``flgpr score`` and ``flgpr compare`` ask of a trial: see :mod:`flgpr.commands.trials`.

The entry point of the group "flgpr.trials" names this module.
"""

from __future__ import annotations

from collections.abc import Iterator

import typer

from flgpr.commands.messages import say
from flgpr_trials.blind import BlindScore
from flgpr_trials.commands.registering import open_registered_truth as open_truth
from flgpr_trials.commands.seal import ask_new_passphrase, seal
from flgpr_trials.commands.sealed_scoring import score_sealed

__all__ = ["ask_new_passphrase", "ask_passphrase", "lines", "open_truth", "score_sealed", "seal"]

_BEFORE_OPENING = (
    "The passphrase is the one that this truth was sealed with. Nothing is shown while you type. "
    "A right one makes this score a look at the truth, which is counted in its log for good; a "
    "wrong one changes nothing."
)


def ask_passphrase() -> str:
    """Ask for the passphrase of a sealed truth on the terminal, after its rules."""
    say(_BEFORE_OPENING, err=True)
    return str(typer.prompt("passphrase", hide_input=True, err=True))


def lines(blind: BlindScore) -> Iterator[str]:
    """Yield what a score against a sealed truth shows: points, counts, looks and log heads."""
    yield blind.points.to_string(index=False, float_format=_three_digits)
    if blind.targets is not None:
        yield blind.targets.to_string(index=False, na_rep="never", float_format=_three_digits)
    counts = []
    for name, value in blind.counts.items():
        text = f"{value:.6g}" if isinstance(value, float) else value
        counts.append(f"{name} {text}")
    yield ", ".join(counts)
    yield (
        f"look {blind.looks} at this truth, different alarm lists so far: {blind.lists}; "
        "the seal guards against accidents, not against the holder of the passphrase"
    )
    for name, head in blind.heads.items():
        yield f"{name}: {head['lines']} lines, the last is {head['head']}"


def _three_digits(value: float) -> str:
    """Return a number to three digits."""
    return f"{value:.3g}"

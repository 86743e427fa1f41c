"""The rule that passphrases must be hard to guess."""

from __future__ import annotations

import importlib.util
import math

_SHORTEST = 8  # characters
_LEAST_GUESSES = 10**8  # at half a second each, some years of one processor
_JUDGED = 72  # characters that are judged: more can only be harder to guess
PASSPHRASE_RULE = (
    f"at least {_SHORTEST} characters and hard to guess, such as four words that do not belong "
    "together; whoever loses it cannot open the truth again"
)


def require_seal() -> None:
    """Refuse, before anybody types a passphrase, where a library for sealing is missing."""
    for library in ("cryptography", "zxcvbn"):
        if importlib.util.find_spec(library) is None:
            raise ModuleNotFoundError(
                f"sealed truth needs the library {library}: pip install 'flgpr[seal]'"
            )


def check_passphrase(passphrase: str) -> None:
    """Refuse a passphrase that a program guesses soon.

    The number of guesses is that of zxcvbn (Wheeler 2016), which knows common passwords, names,
    dates, keyboard rows and repetitions. The errors do not contain the passphrase.

    Parameters
    ----------
    passphrase : str
        The passphrase.

    Raises
    ------
    ValueError
        If it is shorter than 8 characters, or is found in fewer than 10⁸ guesses.
    ModuleNotFoundError
        Without the library zxcvbn, the extra ``seal``.

    Examples
    --------
    >>> from flgpr.trials import check_passphrase
    >>> check_passphrase("gravel otter seven lamps")
    >>> check_passphrase("12345678")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    ValueError: passphrase must be hard to guess: a program finds it in about 10^1 guesses...
    """
    if len(passphrase) < _SHORTEST:
        raise ValueError(
            f"passphrase must have at least {_SHORTEST} characters, got {len(passphrase)}"
        )
    require_seal()
    from zxcvbn import zxcvbn  # type: ignore[import-untyped]

    guesses = float(zxcvbn(passphrase[:_JUDGED])["guesses"])
    if guesses < _LEAST_GUESSES:
        exponent = max(round(math.log10(guesses)), 0)
        raise ValueError(
            f"passphrase must be hard to guess: a program finds it in about 10^{exponent} guesses, "
            "10^8 at least are asked for; take four words or more that do not belong together"
        )

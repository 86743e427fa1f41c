"""Agreement of analysts: the verdicts of ``flgpr view``, compared two by two."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

from flgpr.scoring import Agreement, agreement
from flgpr.store import VERDICTS, read_verdicts, verdict_key

PathLike = str | Path
Verdicts = dict[tuple[str, str, str], str]
PairAgreement = tuple[Agreement, int, int]
"""Agreement of two analysts, and how many alarms the first alone and the second alone judged."""


def analyst_agreement(files: Sequence[PathLike]) -> dict[tuple[str, str], PairAgreement]:
    """Compare the verdicts of every two analysts on the alarms that both of them judged.

    Parameters
    ----------
    files : sequence of path
        Verdicts, the JSON of ``flgpr view``, a file for each analyst.

    Returns
    -------
    dict
        For each pair of names :class:`flgpr.scoring.Agreement`, and the numbers of alarms that the
        first alone and the second alone judged.

    Raises
    ------
    ValueError
        If there are fewer than two files, one holds no verdicts, or two have no alarm in common.
    """
    if len(files) < 2:
        raise ValueError(
            f"agreement needs the verdicts of two analysts or more, got {len(files)} file"
        )
    judged = {}
    for name, path in zip(_analyst_names(files), files, strict=True):
        judged[name] = _verdicts_in(path)
    pairs = {}
    for first, second in itertools.combinations(judged, 2):
        pairs[first, second] = _pair_agreement(first, second, judged)
    return pairs


def _analyst_names(files: Sequence[PathLike]) -> list[str]:
    """Name analysts by their files, or by full paths where file names are equal."""
    stems = [Path(path).stem for path in files]
    if len(set(stems)) == len(stems):
        return stems
    names = [str(path) for path in files]
    if len(set(names)) < len(names):
        raise ValueError(f"verdicts must be different files to be compared, got {', '.join(names)}")
    return names


def _verdicts_in(path: PathLike) -> Verdicts:
    """Read the verdict on every alarm that was judged."""
    verdicts = {}
    for record in read_verdicts(path):
        if record["verdict"]:
            verdicts[verdict_key(record)] = record["verdict"]
    return verdicts


def _pair_agreement(first: str, second: str, judged: Mapping[str, Verdicts]) -> PairAgreement:
    """Compare two analysts; a pair without a common alarm is a ValueError."""
    first_verdicts = judged[first]
    second_verdicts = judged[second]
    common = [key for key in first_verdicts if key in second_verdicts]
    if not common:
        raise ValueError(
            f"verdicts must have alarms in common, got {len(first_verdicts)} of {first} and "
            f"{len(second_verdicts)} of {second}: none"
        )
    result = agreement(
        [first_verdicts[key] for key in common],
        [second_verdicts[key] for key in common],
        VERDICTS,
    )
    return result, len(first_verdicts) - len(common), len(second_verdicts) - len(common)

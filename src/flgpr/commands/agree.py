"""``flgpr agree``: the verdicts of analysts, made with ``flgpr view``, compared two by two."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flgpr.commands.options import PathLike, Paths
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr.scoring import Agreement
    from flgpr.types import Entries

Verdicts = dict[tuple[str, str, str], str]
PairAgreement = tuple["Agreement", int, int]
"""Agreement of two analysts, and how many alarms the first alone and the second alone judged."""
Pairs = Mapping[tuple[str, str], PairAgreement]


def agreement_json(pairs: Pairs, _: Arguments | None = None) -> list[Entries]:
    """Return how far every two analysts agree as ``--json`` prints it; undefined is null."""
    entries = []
    for (first, second), (agreement, only_first, only_second) in pairs.items():
        entry: Entries = {
            "first": first,
            "second": second,
            "only_first": only_first,
            "only_second": only_second,
        }
        for name, value in vars(agreement).items():
            if name != "table":
                entry[name] = None if math.isnan(value) else value
        entry["table"] = agreement.table.to_dict("index")
        entries.append(entry)
    return entries


def agreement_lines(pairs: Pairs, _: Arguments | None = None) -> Iterator[str]:
    """Yield how far every two analysts agree, with a table of their verdicts."""
    yield "95 % intervals in brackets; kappa is what of the agreement chance does not explain"
    for pair in agreement_json(pairs):
        kappa = "not defined: one verdict throughout"
        if pair["kappa"] is not None:
            kappa = "{kappa:.2f} ({kappa_low:.2f} to {kappa_high:.2f})".format_map(pair)
        yield ""
        yield (
            "{first} and {second}: {agreed} of {n} alarms judged alike, "
            "{share:.2f} ({share_low:.2f} to {share_high:.2f}); by chance {expected:.2f}"
        ).format_map(pair)
        yield f"  Cohen's kappa {kappa}"
        yield (
            "  judged by {first} alone {only_first}, by {second} alone {only_second}"
        ).format_map(pair)
        yield from _verdict_lines(pair)


def _verdict_lines(pair: Mapping[str, Any]) -> Iterator[str]:
    """Yield a table of counts, verdicts of the first (rows) by those of the second (columns)."""
    table = pair["table"]
    width = max(len(pair["first"]), *map(len, table)) + 2
    heading = "".join(f"{verdict:>9}" for verdict in next(iter(table.values())))
    yield f"  {pair['first']:{width}}{heading}  {pair['second']}"
    for verdict, counts in table.items():
        cells = "".join(f"{count:9d}" for count in counts.values())
        yield f"  {verdict:{width}}{cells}"


@command(lines=agreement_lines, as_json=agreement_json)
def agree(
    verdicts: Paths,
) -> dict[tuple[str, str], PairAgreement]:
    """Compare the verdicts of every two analysts on the alarms that both of them judged.

    Parameters
    ----------
    verdicts
        Verdicts (JSON of flgpr view), a file for each analyst.

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
    if len(verdicts) < 2:
        raise ValueError(
            f"agreement needs the verdicts of two analysts or more, got {len(verdicts)} file"
        )
    judged = {}
    for name, path in zip(_analyst_names(verdicts), verdicts, strict=True):
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
    from flgpr.store import read_verdicts, verdict_key

    verdicts = {}
    for record in read_verdicts(path):
        if record["verdict"]:
            verdicts[verdict_key(record)] = record["verdict"]
    return verdicts


def _pair_agreement(first: str, second: str, judged: Mapping[str, Verdicts]) -> PairAgreement:
    """Compare two analysts; a pair without a common alarm is a ValueError."""
    from flgpr.scoring import agreement
    from flgpr.store import VERDICTS

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

"""One draft of a mapping for all files of an own array together.

It finds scans, antennas, frequencies and positions. Each file adds what the others do not hold: the
list of antennas shows which axis has the antennas, the list of tones which has the tones, and the
list of positions how many scans there are. What follows from lengths, names and stated units is
certain; a guess ends in a question mark, as in a draft of one file (:mod:`flgpr.formats.explain`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flgpr.formats.array_file import LIMIT
from flgpr.formats.draft_groups import group_files
from flgpr.formats.draft_mapping import MappingDraft
from flgpr.formats.draft_roles import Roles
from flgpr.formats.explain import explain_file
from flgpr.formats.reader import Explanation
from flgpr.store.files import existing


def explain_files(
    paths: Sequence[str | Path], limit: int = LIMIT, mapping: str | Path | None = None
) -> Explanation:
    """Return what several files of one measurement hold, with a draft of one mapping for all.

    Parameters
    ----------
    paths : sequence of path
        The files: scans, one or many, and what belongs to them, in any order.
    limit : int
        Bytes that a file and an array may take.
    mapping : path, optional
        The mapping that will be written; its file names are relative to its folder. By default they
        are relative to the folder of the first file.

    Returns
    -------
    Explanation
        ``lines`` are of every group of files; ``mapping`` is the draft.

    Raises
    ------
    ValueError
        If a file cannot be read, files of one group differ in their arrays, or no file holds a
        signal.
    """
    files = [existing(path) for path in paths]
    if not files:
        raise ValueError("paths must name at least one file, got none")
    groups = group_files(files, limit)
    lines: list[str] = []
    for group in groups:
        first = group.paths[0]
        count = len(group.paths)
        if count == 1:
            lines.append(f"{first.name} ({group.opened.kind})")
        else:
            lines.append(f"{count} files like {first.name} ({group.opened.kind}), each")
        lines += [f"  {line}" for line in explain_file(first, limit).lines]
    folder = files[0].parent if mapping is None else Path(mapping).parent
    draft = MappingDraft(Roles(groups), folder)
    return Explanation(files[0], f"{len(files)} files", lines, draft.text())

"""The reader of commercial radars' recordings, as the instrument asks it."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from flgpr.formats.reader import Explanation, Reader
from flgpr.formats.section import GprSection
from flgpr.store.store_layout import MAX_MEMORY
from flgpr_exchange.gpr.files import READERS, is_gpr, read_gpr
from flgpr_exchange.gpr.line_run import explain_gpr, preview_run


class GprReader(Reader):
    """Recordings of commercial radars, known by their endings (:mod:`flgpr_exchange.gpr.files`)."""

    kind = "recording of a commercial radar"
    reads = frozenset({"traces"})
    endings = tuple(READERS)
    names = f"a recording of a commercial radar ({', '.join(endings)})"

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether the ending is that of a recording, or of a file that lies beside one."""
        return is_gpr(path)

    def explain(self, path: Path, limit: int) -> Explanation:
        """Return what the headers say, and the command that imports the recording."""
        kind, lines = explain_gpr(path, limit)
        return Explanation(path, kind, lines, needs_mapping=False)

    def read_section(self, path: Path, max_memory: int = MAX_MEMORY) -> GprSection:
        """Read a line of traces."""
        return read_gpr(path, max_memory)

    def preview(self, path: Path, max_memory: int = MAX_MEMORY) -> xr.Dataset:
        """Return a line of traces as a run to be viewed."""
        return preview_run(path, max_memory)


READER = GprReader()

"""The readers that ``flgpr`` finds by the entry points of the group "flgpr.formats".

Each loads what it needs when it is asked, so that knowing a file costs nothing.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.formats.array_file import ArrayFile, ArrayInfo, from_memory
from flgpr.formats.reader import Explanation, Reader
from flgpr.formats.section import GprSection
from flgpr.store.store_layout import MAX_MEMORY

ARRAYS = frozenset({"arrays"})
_CONVERTED = {
    b"SQLite format 3": "a ROS 2 bag (or another file) in SQLite",
    b"#ROSBAG": "a ROS 1 bag",
}
"""Beginnings of files that must be converted, and what these are."""


class GprReader(Reader):
    """Recordings of commercial radars, known by their endings (:mod:`flgpr_exchange.gpr.files`)."""

    kind = "recording of a commercial radar"
    reads = frozenset({"traces"})

    @property
    def endings(self) -> Sequence[str]:  # type: ignore[override]
        """The endings of recordings."""
        from flgpr_exchange.gpr.files import READERS

        return list(READERS)

    @property
    def names(self) -> str:  # type: ignore[override]
        """How an error lists them."""
        return f"a recording of a commercial radar ({', '.join(self.endings)})"

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether the ending is that of a recording, or of a file that lies beside one."""
        from flgpr_exchange.gpr.files import is_gpr

        return is_gpr(path)

    def explain(self, path: Path, limit: int) -> Explanation:
        """Return what the headers say, and the command that imports the recording."""
        from flgpr_exchange.gpr.line_run import explain_gpr

        kind, lines = explain_gpr(path, limit)
        return Explanation(path, kind, lines, needs_mapping=False)

    def read_section(self, path: Path, max_memory: int = MAX_MEMORY) -> GprSection:
        """Read a line of traces."""
        from flgpr_exchange.gpr.files import read_gpr

        return read_gpr(path, max_memory)

    def preview(self, path: Path, max_memory: int = MAX_MEMORY) -> xr.Dataset:
        """Return a line of traces as a run to be viewed."""
        from flgpr_exchange.gpr.channels import preview_run

        return preview_run(path, max_memory)


class CphdReader(Reader):
    """Compensated Phase History Data, imported by a command of their own."""

    kind = "CPHD file"
    names = "CPHD"

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether the file begins with the signature."""
        return head.startswith(b"CPHD/")

    def explain(self, path: Path, limit: int) -> Explanation:  # noqa: ARG002
        """Return channels, band and collector."""
        from flgpr_exchange.cphd.phase_history import explain_cphd

        return Explanation(path, self.kind, explain_cphd(path), needs_mapping=False)


class GprmaxReader(Reader):
    """Results of gprMax, a layout of HDF5."""

    kind = "result of gprMax"
    within = "HDF5 file"

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether a sound HDF5 file says that it is of gprMax."""
        from flgpr_exchange.gprmax.output import is_gprmax

        return is_gprmax(path)

    def explain(self, path: Path, limit: int) -> Explanation:  # noqa: ARG002
        """Return what the model recorded, and of a merged B-scan the draft of a mapping."""
        from flgpr_exchange.gprmax.explain import explain_gprmax, explain_merged

        lines, mapping = explain_merged(path)
        return Explanation(path, self.kind, lines or explain_gprmax(path), mapping, bool(mapping))


class McapReader(Reader):
    """Recordings in MCAP, read chunk by chunk."""

    kind = "MCAP recording"
    names = "MCAP"
    reads = ARRAYS
    is_stream = True

    def owns(self, path: Path, head: bytes) -> bool:
        """Return whether the file begins with the signature; refuse bags that must be converted."""
        if head.startswith(b"\x89MCAP"):
            return True
        for beginning, kind in _CONVERTED.items():
            if head.startswith(beginning):
                raise ValueError(
                    f"{path}: {kind} is not read as it is: make MCAP of it, "
                    f"mcap convert {path.name} OUT.mcap"
                )
        if path.suffix.lower() == ".mcap":
            raise ValueError(
                f"{path}: an MCAP recording must begin with its signature: it is empty or damaged"
            )
        return False

    def open_arrays(self, path: Path, limit: int) -> ArrayFile:
        """Open the fields of all topics as arrays over their messages."""
        from flgpr_exchange.bags.recording import Recording

        recording = Recording(path, limit)
        arrays = {array[0]: ArrayInfo(*array) for array in recording.arrays}
        about = recording.lines
        return ArrayFile(path, self.kind, arrays, recording.read, limit, about, recording.notes)

    def explain(self, path: Path, limit: int) -> Explanation:
        """Return the topics: the arrays are too many, and take too long, to read them all."""
        from flgpr.formats.arrays import open_arrays
        from flgpr.formats.draft_single import draft_of_file

        opened = open_arrays(path, limit)
        return Explanation(path, opened.kind, opened.about + opened.notes, draft_of_file(opened))


class MotiveReader(Reader):
    """Takes of motion capture by OptiTrack Motive."""

    kind = "take of OptiTrack Motive"
    reads = frozenset({"arrays", "poses"})

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether the file begins as a take does."""
        return head.removeprefix(b"\xef\xbb\xbf").lstrip(b'"').startswith(b"Format Version")

    def open_arrays(self, path: Path, limit: int) -> ArrayFile:
        """Open positions and rotations of all bodies."""
        from flgpr_exchange.motive import read_motive

        arrays, units, about = read_motive(path)
        return ArrayFile(path, self.kind, *from_memory(arrays, units), limit, about)

    def explain(self, path: Path, limit: int) -> Explanation:
        """Return what the bodies are, and how the take is read as a track."""
        from flgpr.formats.arrays import open_arrays
        from flgpr.formats.explain import array_lines

        lines = array_lines(open_arrays(path, limit))
        lines.append("read as a track: --track FILE --body NAME --axes x,-z,y")
        return Explanation(path, self.kind, lines, needs_mapping=False)

    def read_poses(
        self, path: Path, body: str | None, axes: Sequence[str] | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times and poses of a rigid body."""
        from flgpr_exchange.motive import poses_of_take

        return poses_of_take(path, body, axes)


class SigmfReader(Reader):
    """Recordings in SigMF, whose metadata and samples are two files."""

    kind = "SigMF recording"
    names = "SigMF (.sigmf-meta)"
    reads = ARRAYS

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether the ending is that of one of the two files; refuse sets of recordings."""
        suffix = path.suffix.lower()
        if suffix in (".sigmf", ".sigmf-collection"):
            raise ValueError(
                f"{path}: an archive or a collection of SigMF names other files: unpack it "
                "(tar -xf), and give the .sigmf-meta of one recording, or of several"
            )
        return suffix in (".sigmf-meta", ".sigmf-data")

    def open_arrays(self, path: Path, limit: int) -> ArrayFile:
        """Open samples, sweeps and the numbers of the metadata."""
        from flgpr_exchange.sigmf.reading import SigmfRecording

        notes: list[str] = []
        recording = SigmfRecording(path, limit, notes)
        arrays = {array[0]: ArrayInfo(*array) for array in recording.arrays}
        about = recording.lines
        opened = ArrayFile(path, self.kind, arrays, recording.read, limit, about, notes)
        if "sweeps" in arrays:
            opened.signal = "sweeps"
            opened.repeated = "captures/"  # what the captures state is there for the sweeps as well
        return opened


class TouchstoneReader(Reader):
    """Touchstone files of a network analyser, read by scikit-rf."""

    kind = "Touchstone file"
    names = "Touchstone (.s2p)"
    reads = ARRAYS

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether the ending is that of a Touchstone file."""
        return re.fullmatch(r"\.(s\d+p|ts)", path.suffix.lower()) is not None

    def open_arrays(self, path: Path, limit: int) -> ArrayFile:
        """Open the scattering parameters, all and one by one."""
        from flgpr_exchange.touchstone import read_touchstone

        notes: list[str] = []
        arrays, units = read_touchstone(path, notes)
        return ArrayFile(path, self.kind, *from_memory(arrays, units), limit, [], notes)


GPR = GprReader()
CPHD = CphdReader()
GPRMAX = GprmaxReader()
MCAP = McapReader()
MOTIVE = MotiveReader()
SIGMF = SigmfReader()
TOUCHSTONE = TouchstoneReader()

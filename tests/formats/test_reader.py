"""The table of readers: formats of other packages, asked as those of the house are."""

from types import SimpleNamespace

import numpy as np
import pytest

from flgpr.commands.exports import Wish, export_formats, write_export
from flgpr.formats.array_file import ArrayFile, from_memory
from flgpr.formats.arrays import open_arrays
from flgpr.formats.explain import explain_file
from flgpr.formats.reader import (
    Explanation,
    NmeaLog,
    Reader,
    is_recording,
    reader_of,
    readers,
    recording_reader,
)

GGA = "$GPGGA,120000,4800.0,N,01100.0,E,4,12,1,500,M,45,M,,*00\n"


class LogReader(Reader):
    kind = "log of a radar"
    names = "logs (.rlog)"
    reads = frozenset({"arrays", "poses"})

    def owns(self, path, head):
        if head.startswith(b"OLD"):
            raise ValueError(f"{path}: convert it first")
        return head.startswith(b"RLOG")

    def open_arrays(self, path, limit):
        values = np.array(path.read_text().split()[1:], dtype=float)
        return ArrayFile(path, self.kind, *from_memory({"a": values}), limit)


@pytest.fixture
def offered(monkeypatch):
    """Let another package offer a reader."""
    one = SimpleNamespace(name="log", load=LogReader)
    monkeypatch.setattr("flgpr.formats.reader.entry_points", lambda group: [one])
    readers.cache_clear()
    yield
    readers.cache_clear()


@pytest.mark.usefixtures("offered")
def test_a_file_of_another_package_s_format_is_read_and_explained(tmp_path):
    path = tmp_path / "a.csv"  # known by its content, whatever its ending says
    path.write_text("RLOG 1 2 3")
    np.testing.assert_array_equal(open_arrays(path).read("a"), [1.0, 2.0, 3.0])
    told = explain_file(path)
    assert told.kind == "log of a radar"
    assert told.lines == ["a: 3 float64, 1 to 3"]
    assert reader_of(path, "traces") is None
    assert not is_recording(path)
    with pytest.raises(ValueError, match=r"a\.csv: this is no recording of a radar"):
        recording_reader(path)


@pytest.mark.usefixtures("offered")
def test_sizes_are_checked_before_a_reader_is_asked_and_its_faults_name_the_file(tmp_path):
    path = tmp_path / "a.rlog"
    path.write_text("RLOG one two")
    with pytest.raises(ValueError, match=r"a\.rlog: cannot be read as a log of a radar"):
        open_arrays(path)
    with pytest.raises(ValueError, match=r"a file must hold at most 8e-09 GB"):
        open_arrays(path, limit=8)
    path.write_text("OLD")
    with pytest.raises(ValueError, match="convert it first"):
        open_arrays(path)
    (tmp_path / "a.what").write_text("x")
    with pytest.raises(ValueError, match=r"\.csv, \.txt, logs \(\.rlog\), got the ending '\.what'"):
        open_arrays(tmp_path / "a.what")


def test_a_log_of_a_satellite_receiver_is_known_by_its_first_sentence(tmp_path):
    path = tmp_path / "a.nmea"
    path.write_text(2 * GGA + "$GPHDT,30.0,T*00\nnoise\n")
    assert isinstance(reader_of(path), NmeaLog)
    told = explain_file(path)
    assert isinstance(told, Explanation)
    assert not told.needs_mapping
    assert told.lines[0] == "2 GGA, 1 HDT"


def test_a_format_that_nobody_writes_is_refused(tmp_path):
    assert export_formats() == sorted(export_formats())
    with pytest.raises(ValueError, match=r"to must be one of .*got 'dxf'"):
        write_export(Wish(tmp_path, tmp_path / "a.dxf", "dxf"))

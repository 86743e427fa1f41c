"""OpenGPR, Seismic Unix, and files that are not what their ending says or that nobody reads."""

import zipfile

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.formats import explain_file, gpr_run, open_arrays, read_gpr
from io_gpr import INTERVAL, STEP, section
from io_open import (
    write_su,
)


@pytest.mark.parametrize("order", ["<", ">"])
def test_every_sample_of_a_file_of_seismic_unix_is_read(order, tmp_path):
    counts = section(15)
    line = read_gpr(write_su(tmp_path / "a.su", counts, order))
    np.testing.assert_array_equal(line.traces[:, 0], counts)
    np.testing.assert_allclose(line.delay, INTERVAL * np.arange(counts.shape[1]))
    np.testing.assert_allclose(line.distance, STEP * np.arange(15), atol=0.02)
    assert any("byte order is taken as" in note for note in line.history)
    assert gpr_run(line).sizes["scan"] == 15


def test_a_file_of_seismic_unix_without_an_interval_is_refused(tmp_path):
    with pytest.raises(ValueError, match="must tell samples and interval"):
        read_gpr(write_su(tmp_path / "a.su", section(3), interval=0.0))


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"a" * 64 + b"\nsize 12345\n"


@pytest.mark.parametrize("name", ["a.DZT", "a.mcap", "a.npz", "a.csv", "a.h5", "a.nobody"])
def test_a_pointer_of_git_lfs_is_called_what_it_is(name, tmp_path):
    (tmp_path / name).write_bytes(POINTER)
    with pytest.raises(
        ValueError, match="is a pointer of Git LFS to a file of 12345 bytes that was not fetched"
    ):
        explain_file(tmp_path / name)


def test_a_project_in_a_zip_is_to_be_unzipped(tmp_path):
    with zipfile.ZipFile(tmp_path / "proj.GPZ", "w") as bundle:
        bundle.writestr("line0.DT1", "x")
    told = explain_file(tmp_path / "proj.GPZ")
    assert any("unzip it, and give a DT1 file" in line for line in told.lines)
    with pytest.raises(ValueError, match="unzip it"):
        read_gpr(tmp_path / "proj.GPZ")


def test_an_unknown_ending_lists_what_is_read(tmp_path):
    (tmp_path / "a.gpr").write_bytes(b"what")
    done = CliRunner().invoke(app, ["info", str(tmp_path / "a.gpr")])
    assert done.exit_code == 2
    for one in (
        "HDF5",
        "MCAP",
        ".dt1",
        ".dzt",
        ".rd3",
        ".sgy",
        ".su",
        ".ogpr",
        "got the ending '.gpr'",
    ):
        assert one in done.output


@pytest.mark.parametrize("content", [b"", b"\0" * 64])
def test_an_mcap_file_without_its_signature_is_told_so(content, tmp_path):
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(ValueError, match="an MCAP recording must begin with its signature"):
        open_arrays(tmp_path / "a.mcap")

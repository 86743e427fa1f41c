"""The files of a detection: all are read before one is parsed, and damaged arrays are refused."""

import io

import numpy as np
import pytest

from flgpr.door import listed_files
from flgpr.method.detection import MAIN
from flgpr.results.detection_files import parse_detection, parse_view, read_detection_files
from flgpr.results.manifest import ResultError, read_result_manifest
from small_results import small_result


def test_a_view_whose_arrays_do_not_fit_is_refused():
    arrays = {
        "polarization": np.array(["HH"]),
        "subband": np.array(["low"]),
        "y": np.zeros(4),
        "x": np.zeros(3),
        "looks": np.zeros((4, 3)),
        "magnitude": np.zeros((1, 1, 4, 3), np.float32),
    }

    def packed(**change):
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **(arrays | change))
        return buffer.getvalue()

    assert parse_view(packed()).sizes == {"polarization": 1, "subband": 1, "y": 4, "x": 3}
    with pytest.raises(ValueError, match="magnitude and looks must fit"):
        parse_view(packed(looks=np.zeros((3, 3))))
    with pytest.raises(ValueError, match="must be lists"):
        parse_view(packed(x=np.zeros((3, 1))))


def test_files_are_read_by_the_name_of_the_detection(tmp_path):
    folder = small_result(tmp_path / "result")
    files = listed_files(folder, read_result_manifest(folder))
    read = read_detection_files(files, MAIN)
    assert read.alarms == (folder / "alarms.csv").read_bytes()
    assert (read.prefix, read.frames, read.recipe) == ("", None, None)
    with pytest.raises(FileNotFoundError, match=r"variants/other/run_view\.npz"):
        read_detection_files(files, "other")


def test_a_view_that_is_no_archive_is_named(tmp_path):
    folder = small_result(tmp_path / "result")
    files = listed_files(folder, read_result_manifest(folder))
    read = read_detection_files(files, MAIN)
    entry = {"name": MAIN, "title": "title", "notes": {}}
    assert parse_detection(read, entry).view.sizes["polarization"] == 1
    damaged = type(read)(**(vars(read) | {"view": b"no archive"}))
    with pytest.raises(ResultError, match=r"run_view\.npz cannot be read"):
        parse_detection(damaged, entry)

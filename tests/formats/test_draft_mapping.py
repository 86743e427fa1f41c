"""The mapping that is drafted of files whose roles are known."""

import tomllib

import numpy as np
import pytest

from flgpr.formats.arrays import LIMIT
from flgpr.formats.draft_arrays import group_files
from flgpr.formats.draft_mapping import MappingDraft
from flgpr.formats.draft_roles import Roles

TONES = np.linspace(0.5, 3.0, 7)


@pytest.fixture
def files(tmp_path):
    """Three scans of two pairs in a file each, the tones and antennas in another."""
    paths = []
    for number in range(3):
        paths.append(tmp_path / f"scan_{number}.npy")
        np.save(paths[-1], np.ones((2, 7), np.complex64))
    np.savez(tmp_path / "array.npz", freq=TONES, antenna=np.zeros((2, 3)), unused=np.arange(99.0))
    return [*paths, tmp_path / "array.npz"]


def draft_of(files, folder):
    return MappingDraft(Roles(group_files(files, LIMIT)), folder).text()


def test_a_draft_is_toml_that_names_every_file_it_uses(files, tmp_path):
    text = draft_of(files, tmp_path)
    draft = tomllib.loads(text)
    assert draft["files"] == {"data": "scan_*.npy", "array": "array.npz"}
    assert draft["signal"]["dims"] == ["pair", "frequency"]
    assert draft["frequency"] == {"file": "array", "variable": "freq", "unit": "GHz?"}
    assert draft["join"] == "new scan"
    assert text.startswith("# Draft for 4 files together.\n")


def test_files_are_named_from_the_folder_of_the_mapping(files, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    draft = tomllib.loads(draft_of(files, tmp_path / "elsewhere"))
    assert draft["files"]["data"] == "../scan_*.npy"


def test_some_of_alike_files_are_listed(files, tmp_path):
    draft = tomllib.loads(draft_of([files[0], files[2], files[3]], tmp_path))
    assert draft["files"]["data"] == ["scan_0.npy", "scan_2.npy"]


def test_one_file_is_not_joined(files, tmp_path):
    draft = tomllib.loads(draft_of([files[0], files[3]], tmp_path))
    assert "join" not in draft

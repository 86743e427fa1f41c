"""The manifest of a result: sealed, and refused where its entries are of another type."""

import pytest

from flgpr.door import added_versions
from flgpr.results.manifest import ResultError, read_result_manifest, sealed_manifest
from flgpr.store import parse_with_digest
from small_results import small_result


def test_what_is_no_result_is_an_error_that_names_the_folder(tmp_path):
    with pytest.raises(ResultError, match=f"{tmp_path}: not a complete result folder"):
        read_result_manifest(tmp_path)
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(ResultError, match=r"manifest.json is altered"):
        read_result_manifest(tmp_path)


def test_an_entry_of_another_type_is_named(tmp_path):
    folder = small_result(tmp_path / "result")
    content = read_result_manifest(folder)
    for name in ("identity", "added", "added_sizes", "sha256"):
        del content[name]
    content["run"]["masked_scans"] = ["first"]
    (folder / "manifest.json").write_bytes(sealed_manifest(content, {}))
    with pytest.raises(ResultError, match=r"run\.masked_scans must be a list of scan numbers"):
        read_result_manifest(folder)


def test_versions_of_added_files_are_read_as_they_were_listed():
    added = {"report.html": [("a", 1), (None, None)]}
    sealed = parse_with_digest(sealed_manifest({"format": "any"}, added))
    assert added_versions(sealed) == added
    del sealed["added_sizes"]
    assert added_versions(sealed) == {"report.html": [("a", None), (None, None)]}

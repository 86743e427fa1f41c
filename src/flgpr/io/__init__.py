"""Stores and tables on disk, import and export."""

from flgpr.io.files import canonical_json, sha256, write_whole
from flgpr.io.fullwave import FullwaveLane, import_fullwave
from flgpr.io.run_store import RunStoreError, RunWriter, open_run, read_manifest, save_run
from flgpr.io.sample import sample_lane
from flgpr.io.tables import read_lane, read_table, write_geojson, write_table

__all__ = [
    "FullwaveLane",
    "RunStoreError",
    "RunWriter",
    "canonical_json",
    "import_fullwave",
    "open_run",
    "read_lane",
    "read_manifest",
    "read_table",
    "sample_lane",
    "save_run",
    "sha256",
    "write_geojson",
    "write_table",
    "write_whole",
]

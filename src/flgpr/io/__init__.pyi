from flgpr.io.anchor import Anchor, fit_anchor, own_anchor, read_anchor
from flgpr.io.arrays import ArrayFile, ArrayInfo, open_arrays
from flgpr.io.backdrop import map_backdrop
from flgpr.io.bundle import Bundle, BundleError, write_bundle
from flgpr.io.cphd import read_cphd, write_cphd
from flgpr.io.declared import MAX_MEMORY
from flgpr.io.explain import Explanation, explain_file, propose_mapping
from flgpr.io.extras import MissingExtraError
from flgpr.io.files import canonical_json, check_free_folder, laid_over, replace_folder, sha256, write_whole
from flgpr.io.fullwave import FullwaveLane, import_fullwave
from flgpr.io.georeferenced import (
    georeference,
    write_earth_csv,
    write_earth_geojson,
    write_geopackage,
    write_geotiff,
    write_gpx,
    write_kml,
)
from flgpr.io.gpr_files import GprSection, read_gpr
from flgpr.io.gpr_import import gpr_run
from flgpr.io.gprmax import GprmaxOutput, GprmaxRun, read_gprmax
from flgpr.io.mapped import Imported, import_mapped, impulse_to_frequency
from flgpr.io.run_store import RunStoreError, RunWriter, open_run, read_manifest, save_run
from flgpr.io.sample import sample_lane
from flgpr.io.scan_file import (
    RunDescription,
    Scan,
    ScanFileError,
    as_run,
    decode_frame,
    describe_for_live,
    encode_frame,
    encode_scan,
    parse_description,
    read_description,
    scan_of,
    write_description,
)
from flgpr.io.sealed import inside, read_limited, seal, unseal
from flgpr.io.tables import lane_text, read_lane, read_table, write_geojson, write_table
from flgpr.io.tracks import read_nmea, read_survey, read_track
from flgpr.io.verdicts import (
    MOST_VERDICT_BYTES,
    VERDICTS,
    check_verdicts,
    parse_verdicts,
    read_verdicts,
    verdict_bytes,
    verdict_key,
)

__all__ = [
    "MAX_MEMORY",
    "MOST_VERDICT_BYTES",
    "VERDICTS",
    "Anchor",
    "ArrayFile",
    "ArrayInfo",
    "Bundle",
    "BundleError",
    "Explanation",
    "FullwaveLane",
    "GprSection",
    "GprmaxOutput",
    "GprmaxRun",
    "Imported",
    "MissingExtraError",
    "RunDescription",
    "RunStoreError",
    "RunWriter",
    "Scan",
    "ScanFileError",
    "as_run",
    "canonical_json",
    "check_free_folder",
    "check_verdicts",
    "decode_frame",
    "describe_for_live",
    "encode_frame",
    "encode_scan",
    "explain_file",
    "fit_anchor",
    "georeference",
    "gpr_run",
    "import_fullwave",
    "import_mapped",
    "impulse_to_frequency",
    "inside",
    "laid_over",
    "lane_text",
    "map_backdrop",
    "open_arrays",
    "open_run",
    "own_anchor",
    "parse_description",
    "parse_verdicts",
    "propose_mapping",
    "read_anchor",
    "read_cphd",
    "read_description",
    "read_gpr",
    "read_gprmax",
    "read_lane",
    "read_limited",
    "read_manifest",
    "read_nmea",
    "read_survey",
    "read_table",
    "read_track",
    "read_verdicts",
    "replace_folder",
    "sample_lane",
    "save_run",
    "scan_of",
    "seal",
    "sha256",
    "unseal",
    "verdict_bytes",
    "verdict_key",
    "write_bundle",
    "write_cphd",
    "write_description",
    "write_earth_csv",
    "write_earth_geojson",
    "write_geojson",
    "write_geopackage",
    "write_geotiff",
    "write_gpx",
    "write_kml",
    "write_table",
    "write_whole",
]

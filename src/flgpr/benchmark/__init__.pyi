from flgpr.benchmark.ground import Ground, load_ground
from flgpr.benchmark.oracle import run_oracle
from flgpr.benchmark.running import find_entry, packaged_entries, run_benchmark
from flgpr.benchmark.table import listing, score_entries, write_table

__all__ = [
    "Ground",
    "find_entry",
    "listing",
    "load_ground",
    "packaged_entries",
    "run_benchmark",
    "run_oracle",
    "score_entries",
    "write_table",
]

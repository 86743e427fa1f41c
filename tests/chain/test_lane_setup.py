"""What the passes over one lane share."""

import numpy as np
import pandas as pd

from flgpr.chain.engine import (
    bundle_groups,
    group_of,
)
from flgpr.chain.lane_setup import array_table, table_arrays


def test_tables_go_through_arrays_unchanged():
    table = pd.DataFrame({"x": [1.5, np.nan], "scans": [3, 4]})
    both = bundle_groups({"a": table_arrays(table), "ab": {"x": np.zeros(3)}}) | {"x": np.ones(2)}
    assert array_table(group_of(both, "a")).equals(table)

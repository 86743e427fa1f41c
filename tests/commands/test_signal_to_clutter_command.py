"""Signal to clutter for several arrays: a table each."""

import numpy as np
import pandas as pd
import pytest

from flgpr.commands.design import design
from flgpr.design import signal_to_clutter
from flgpr.design.grounds import ground_model
from flgpr.design.signal_to_clutter import DEPTHS, Viewing, expected_signal_to_clutter
from flgpr.model import load_sensor

ASKED = {"permittivity": 6.0, "loss_tangent": 0.02, "band": (0.75e9, 0.95e9)}
GROUND = ground_model("arid-sand", permittivity=6.0, loss_tangent=0.02)
BAND = Viewing(subbands={"band": (0.75e9, 0.95e9)}, window="hann")


def tables(sensor="sri-array", **options):
    return design(sensor, signal_to_clutter=True, **ASKED, **options)


def test_each_sensor_has_the_table_of_the_formula():
    [table] = tables(body=["m19"], depth=[0.05])
    expected = expected_signal_to_clutter(load_sensor("sri-array"), GROUND, ["m19"], [0.05], BAND)
    pd.testing.assert_frame_equal(table, expected)
    assert "measured_db" not in table


def test_what_is_measured_stands_beside_the_formula(monkeypatch):
    asked = []

    def measured(sensor, ground, bodies, depths, viewing, *, seeds, track):
        table = expected_signal_to_clutter(sensor, ground, bodies, depths, viewing)
        asked.append((seeds, depths))
        level = table["signal_to_clutter_db"] + 1.0
        return table.assign(signal_to_clutter_db=level, low_db=level - 2, high_db=level + 2)

    monkeypatch.setattr(signal_to_clutter, "measure_signal_to_clutter", measured)
    [table] = tables(body=["m19"], measure=4)
    assert asked == [(4, list(DEPTHS))]
    np.testing.assert_allclose(table["measured_db"] - table["signal_to_clutter_db"], 1.0)
    np.testing.assert_allclose(table["high_db"] - table["low_db"], 4.0)


def test_a_sensor_that_is_not_there_is_refused():
    with pytest.raises((ValueError, OSError), match="no-array"):
        tables("no-array")

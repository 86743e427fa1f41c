"""What is said of results of gprMax, and the draft of a merged B-scan."""

import json
import re

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.formats.explain import explain_file
from flgpr.store import open_run


@pytest.fixture
def merged(tmp_path):
    """A B-scan laid out as gprMax's tools/outputfiles_merge.py writes it: 200 steps of 0.02 ns, 20 traces."""
    path = tmp_path / "model_merged.out"
    with h5py.File(path, "w") as file:
        file.attrs.update(
            {"Title": "lane", "gprMax": "3.1.7", "Iterations": 200, "dt": 2e-11, "nrx": 1}
        )
        group = file.create_group("rxs/rx1")
        group.attrs["Name"] = "Rx(50,50,0)"
        for name in ("Ez", "Hx", "Hy"):
            group[name] = np.random.default_rng(1).normal(size=(200, 20)).astype(np.float32)
    return path


def test_a_merged_b_scan_is_told_and_imported_by_its_draft(merged, tmp_path):
    told = explain_file(merged)
    assert "merged B-scan of 20 traces x 200 steps of 0.02 ns" in told.lines
    assert 'variable = "rxs/rx1/Ez"\ndims = ["sample", "scan"]  # of 200 x 20' in told.mapping
    draft = told.mapping.replace("band = []", "band = [1.0, 5.0]").replace(
        'unit = "m?"', 'unit = "m"'
    )
    checked = re.sub(r'"([^"]*)\?"', lambda found: json.dumps(found[1] or "0"), draft)
    (tmp_path / "m.toml").write_text(checked)
    (tmp_path / "s.csv").write_text(
        "x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg\n"
        + "".join(f"0,{0.05 * k},0,0,0,0\n" for k in range(20))
    )
    words = ["import", "mapped", str(tmp_path / "m.toml"), "-o", str(tmp_path / "a.zarr")]
    done = CliRunner().invoke(app, [*words, "--survey", str(tmp_path / "s.csv")])
    assert done.exit_code == 0, done.output
    run = open_run(tmp_path / "a.zarr")
    assert run.sizes["scan"] == 20
    with h5py.File(merged) as file:
        trace = file["rxs/rx1/Ez"][:, 7]
    spectrum = np.fft.fft(trace.astype(np.float64))
    tones = np.fft.fftfreq(200, 2e-11)
    wanted = spectrum[np.isclose(tones[:, None], run["frequency"].values).any(axis=1)]
    np.testing.assert_allclose(run["signal"].values[7, 0, 0], wanted, rtol=1e-4, atol=1e-4)


def number_of_an_odd_type():
    """Return a type of floating point with an exponent's bias that no type of NumPy has."""
    kind = h5py.h5t.IEEE_F64LE.copy()
    kind.set_ebias(20_000)
    return kind


def text_of_two_lines():
    kind = h5py.h5t.C_S1.copy()
    kind.set_size(8)
    return kind


@pytest.mark.parametrize("kind", [number_of_an_odd_type, text_of_two_lines])
def test_a_merged_b_scan_whose_step_is_no_number_is_named(kind, merged):
    """What h5py raises on such an attribute is a ValueError that names no file."""
    with h5py.File(merged, "r+") as file:
        del file.attrs["dt"]
        scalar = h5py.h5s.create(h5py.h5s.SCALAR)
        attribute = h5py.h5a.create(file.id, b"dt", kind(), scalar)
        attribute.write(np.array(b"two\nway"), attribute.get_type())
    with pytest.raises(ValueError, match=re.escape(str(merged))) as caught:
        explain_file(merged)
    assert "\n" not in str(caught.value)

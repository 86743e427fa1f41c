import re

import numpy as np
import pytest

from alone import needs
from flgpr.formats import import_fullwave
from flgpr.formats.explain import explain_file, propose_mapping
from flgpr.formats.mapped import import_mapped
from flgpr.formats.mapping import parse_mapping


def put(text, path):
    path.write_text(text, encoding="utf-8")
    return path


def test_a_full_wave_archive_needs_only_its_guesses_checked(fullwave_archive, tmp_path):
    draft = propose_mapping(fullwave_archive)
    with pytest.raises(ValueError, match=r"lane\?|frame"):
        parse_mapping(draft)
    checked = put(draft.replace("?", ""), tmp_path / "m.toml")
    run = import_mapped(checked, fullwave_archive).run
    want = import_fullwave(fullwave_archive).run
    for name in want.variables:
        if want[name].dtype.kind in "fc":
            np.testing.assert_allclose(run[name].values, want[name].values, rtol=0, atol=1e-15)
        else:
            np.testing.assert_array_equal(run[name].values, want[name].values)


def test_guessed_units_stop_an_import(tmp_path):
    tones = np.linspace(500, 3000, 7)
    np.savez(
        tmp_path / "a.npz",
        field=np.ones((7, 2), complex),
        f=tones,
        tx=np.zeros((2, 3)),
        rx=np.zeros((2, 3)),
    )
    draft = propose_mapping(tmp_path / "a.npz")
    assert 'unit = "MHz?"' in draft
    assert 'dims = ["frequency", "pair"]' in draft
    text = re.sub(r'= "\?"', "= 0", draft).replace('["HH?"]', '["HH"]')
    with pytest.raises(ValueError, match="guess, got 'MHz\\?'"):
        import_mapped(put(text, tmp_path / "m.toml"), tmp_path / "a.npz")
    run = import_mapped(put(text.replace("?", ""), tmp_path / "m.toml"), tmp_path / "a.npz").run
    np.testing.assert_allclose(run["frequency"].values, tones * 1e6)


def test_content_is_told_in_words(tmp_path):
    np.savez(tmp_path / "a.npz", field=np.array([[3 + 4j, np.nan]]), name=np.array("x"))
    told = explain_file(tmp_path / "a.npz")
    assert told.kind == "NumPy archive"
    assert told.lines[0] == "field: 1 x 2 complex128, magnitude 5 to 5, 1 not finite"
    log = put("$GPGGA,1,2*33\n$GPGGA,1,2*33\n$GPHDT,3,T*11\n", tmp_path / "n.log")
    assert explain_file(log).lines[0] == "2 GGA, 1 HDT"
    with pytest.raises(ValueError, match="without a mapping"):
        propose_mapping(log)
    with pytest.raises(FileNotFoundError):
        explain_file(tmp_path / "no")


@needs("flgpr_exchange")
def test_a_cphd_file_is_told(small_run, tmp_path):
    pytest.importorskip("sarkit")
    from flgpr.geo.anchor import fit_anchor
    from flgpr_exchange.cphd.phase_history import write_cphd
    from io_geodesy import LANE, on_the_ellipsoid

    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02)
    told = explain_file(write_cphd(small_run, tmp_path / "a.cphd", anchor))
    assert told.lines[0] == "4 channels of 4 vectors x 5 samples, FX domain"
    assert "HH, VV" in told.lines[1]
    assert "anchor" not in told.lines[2]

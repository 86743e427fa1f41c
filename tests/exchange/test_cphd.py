import warnings

import numpy as np
import pytest

pytest.importorskip("sarkit")

from flgpr.geo.anchor import fit_anchor
from flgpr.model import make_run, vehicle_to_lane
from flgpr.store import open_run, sample_lane
from flgpr_exchange.cphd.phase_history import read_cphd, write_cphd
from io_geodesy import LANE, on_the_ellipsoid


@pytest.fixture(scope="module")
def anchor():
    return fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [300.0] * 4)


@pytest.fixture(scope="module")
def lane():
    return open_run(sample_lane() / "run.zarr").load().isel(pair=slice(0, 5))


def failures(path):
    consistency = pytest.importorskip("sarkit.verification").CphdConsistency
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the checker fits polynomials of its own
        checker = consistency.from_file(file)
        checker.check()
    return checker.failures()


def test_a_run_comes_back(lane, anchor, tmp_path):
    back = read_cphd(write_cphd(lane, tmp_path / "a.cphd", anchor))
    assert back.drop_vars("signal").identical(lane.drop_vars("signal"))
    scale = np.abs(lane["signal"].values)
    assert (np.abs(back["signal"].values - lane["signal"].values) <= 5e-7 * scale).all()


@pytest.mark.slow("sarkit checks every rule of the standard")
def test_sarkit_finds_the_file_consistent(lane, small_run, anchor, tmp_path):
    assert failures(write_cphd(lane, tmp_path / "a.cphd", anchor)) == {}
    small_run["pose"][:, 3] = 0.1
    assert failures(write_cphd(small_run, tmp_path / "b.cphd", anchor)) == {}
    assert failures(write_cphd(small_run.isel(scan=[0]), tmp_path / "c.cphd", anchor)) == {}


def test_missing_sweeps_stay_missing(small_run, anchor, tmp_path):
    small_run["signal"][1, 0, 1] = np.nan
    small_run["valid"][1, 0, 1] = False
    path = write_cphd(small_run, tmp_path / "a.cphd", anchor)
    assert failures(path) == {}
    back = read_cphd(path)
    np.testing.assert_array_equal(back["valid"].values, small_run["valid"].values)
    assert np.isnan(back["signal"].values[1, 0, 1]).all()


def write_as_another_maker(ours, path, change=None):
    """Write a file again without our own parameters; ``change`` takes the vectors of each channel and its number."""
    import sarkit.cphd as skcphd

    with ours.open("rb") as file, skcphd.Reader(file) as reader:
        tree = reader.metadata.xmltree
        parts = {
            n: reader.read_channel(n)
            for n in [e.text for e in tree.findall("{*}Data/{*}Channel/{*}Identifier")]
        }
    added = tree.find("{*}Channel/{*}AddedParameters")
    added.getparent().remove(added)
    with (
        path.open("wb") as file,
        skcphd.Writer(file, skcphd.Metadata(xmltree=tree)) as writer,
    ):
        for number, (name, (signal, pvp)) in enumerate(parts.items()):
            if change is not None:
                change(pvp, number)
            writer.write_signal(name, signal)
            writer.write_pvp(name, pvp)
    return path


def test_another_makers_file_is_read_by_its_geometry(small_run, anchor, tmp_path):
    """The same file without our own parameters: positions, phases and tones must follow from the standard's alone."""
    small_run["pose"][:, 3] = 0.2
    ours = write_cphd(small_run, tmp_path / "a.cphd", anchor)
    write_as_another_maker(ours, tmp_path / "b.cphd")
    with pytest.raises(ValueError, match="anchor is needed"):
        read_cphd(tmp_path / "b.cphd")
    back = read_cphd(tmp_path / "b.cphd", anchor)
    assert back.attrs["import_notes"] == [
        "the file states no heading, pitch and roll: 0 is taken, as the array lies"
    ]
    for scan in range(4):
        for side in ("tx_position", "rx_position"):
            want = vehicle_to_lane(small_run[side].values, small_run["pose"].values[scan])
            got = vehicle_to_lane(back[side].values, back["pose"].values[scan])
            np.testing.assert_allclose(got, want, atol=1e-6)
    np.testing.assert_allclose(back["signal"].values, small_run["signal"].values, rtol=2e-6)
    np.testing.assert_allclose(back["frequency"].values, small_run["frequency"].values, rtol=1e-12)


def test_what_another_makers_file_states_and_is_not_used_is_counted(small_run, anchor, tmp_path):
    def change(vectors, number):
        if number < 2:
            vectors["TDTropoSRP"][1] = 2e-9
            vectors["SIGNAL"][:3] = 0

    ours = write_cphd(small_run, tmp_path / "a.cphd", anchor)
    path = write_as_another_maker(ours, tmp_path / "b.cphd", change)
    back = read_cphd(path, anchor)
    total = small_run["valid"].size
    assert back.attrs["import_notes"][1:] == [
        f"6 of {total} vectors hold no signal (SIGNAL)",
        f"the delays of the atmosphere of 2 of {total} vectors (TDTropoSRP and TDIonoSRP) are not taken off",
    ]
    assert int((~back["valid"].values).sum()) == 6


def test_the_signal_is_referenced_to_the_scene_as_the_standard_has_it(anchor, tmp_path):
    """A scatterer at the reference point has a flat phase in the file (NGA.STND.0068, signal model)."""
    import sarkit.cphd as skcphd

    from flgpr.model import Grid

    target = np.array([1.0, 12.0, 0.0])
    tones = np.linspace(1e9, 2e9, 21)
    tx = np.array([[-0.5, 0, 0]])
    rx = np.array([[0.5, 0, 0]])
    pose = np.zeros((3, 6))
    pose[:, 1] = [0.0, 1.0, 2.0]
    pose[:, 2] = 1.5
    path = [
        np.linalg.norm(vehicle_to_lane(tx, p) - target)
        + np.linalg.norm(vehicle_to_lane(rx, p) - target)
        for p in pose
    ]
    signal = np.exp(-2j * np.pi * np.outer(path, tones) / 299_792_458.0)[:, None, None]
    run = make_run(signal, tones, ["HH"], tx, rx, pose)
    file = write_cphd(
        run, tmp_path / "a.cphd", anchor, Grid.spanning((-4.0, 6.0), (7.0, 17.0), 0.1)
    )
    with file.open("rb") as handle, skcphd.Reader(handle) as reader:
        held, pvp = reader.read_channel("0_HH")
    np.testing.assert_allclose(held, 1.0, atol=1e-5)
    np.testing.assert_allclose(anchor.from_geocentric(pvp["SRPPos"][0]), target, atol=1e-6)


def test_uneven_tones_and_foreign_files_are_refused(small_run, anchor, tmp_path):
    with pytest.raises(ValueError, match="evenly spaced"):
        write_cphd(small_run.isel(frequency=[0, 1, 4]), tmp_path / "a.cphd", anchor)
    with pytest.raises(ValueError, match="two tones"):
        write_cphd(small_run.isel(frequency=[0]), tmp_path / "a.cphd", anchor)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "x.cphd").write_bytes(b"CPHD/1.1.0\n")
    with pytest.raises(ValueError, match="cannot be read as CPHD"):
        read_cphd(tmp_path / "x.cphd")
    with pytest.raises(FileNotFoundError):
        read_cphd(tmp_path / "y.cphd")


def test_truncated_files_are_refused(small_run, anchor, tmp_path):
    whole = write_cphd(small_run, tmp_path / "a.cphd", anchor).read_bytes()
    for share in (0.01, 0.3, 0.6, 0.9, 0.999):
        (tmp_path / "b.cphd").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(ValueError, match=r"b\.cphd"):
            read_cphd(tmp_path / "b.cphd")

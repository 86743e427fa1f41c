"""One draft for all files of an own array: what it says, how many questions it leaves, and the run it gives."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.formats import explain_files, import_mapped
from flgpr.formats.mapping import parse_mapping
from flgpr.store import open_run

SCANS = 20
TX = 4
RX = 16
TONES = 401
RNG = np.random.default_rng(8)
FREQUENCY = np.linspace(0.5e9, 2.5e9, TONES)
SENDERS = np.stack([np.linspace(-0.6, 0.6, TX), np.zeros(TX), np.full(TX, 1.2)], axis=-1)
RECEIVERS = np.stack([np.linspace(-1, 1, RX), np.full(RX, 0.2), np.full(RX, 1.2)], axis=-1)
SIGNAL = (
    RNG.normal(size=(SCANS, TX, RX, TONES)) + 1j * RNG.normal(size=(SCANS, TX, RX, TONES))
).astype(np.complex64)


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def scans(folder):
    paths = [folder / f"scan_{k}.npy" for k in range(SCANS)]
    for path, signal in zip(paths, SIGNAL, strict=True):
        np.save(path, signal)
    return paths


def rows(path, header, table, *texts):
    lines = [header]
    for k, row in enumerate(table):
        lines.append(",".join([*(text[k] for text in texts), *(f"{value:.9f}" for value in row)]))
    path.write_text("\n".join(lines) + "\n")
    return path


def questions(draft):
    return [line for line in draft.splitlines() if re.search(r'\?"', line)]


def geodetic(count=SCANS):
    return np.stack(
        [52 + np.arange(count) * 4.5e-6, np.full(count, 13.1), np.full(count, 80.0)], axis=-1
    )


def test_an_own_array_takes_one_draft_with_three_questions(tmp_path):
    """4 x 16 antennas, 401 tones, a file per scan, an archive of the array, and a table of fixes."""
    paths = scans(tmp_path)
    np.savez(tmp_path / "array.npz", tx=SENDERS, rx=RECEIVERS, frequency=FREQUENCY)
    stamps = [f"2024-05-01T10:00:{k:02d}Z" for k in range(SCANS)]
    rtk = rows(tmp_path / "rtk.csv", "time,lat,lon,height", geodetic(), stamps)
    done = run(
        "info", *reversed(paths), rtk, tmp_path / "array.npz", "--mapping", tmp_path / "own.toml"
    )
    assert done.exit_code == 0, done.output
    assert "20 files like scan_0.npy (NumPy array), each" in done.output
    assert "with 3 question marks" in done.output
    draft = (tmp_path / "own.toml").read_text()
    polarization, height, heading = questions(draft)
    assert polarization == 'polarization = ["HH?"]'
    assert 'above_ground = "?"' in height
    assert heading == 'heading = "course?"  # along the way'
    assert 'dims = ["tx", "rx", "frequency"]  # of 4 x 16 x 401' in draft
    assert draft.index('join = "new scan"') < draft.index("[files]")  # where a mapping takes it
    assert 'data = "scan_*.npy"' in draft
    answered = draft.replace('above_ground = "?"', "above_ground = 1.8").replace("?", "")
    (tmp_path / "own.toml").write_text(answered)
    words = ["import", "mapped", tmp_path / "own.toml", "-o", tmp_path / "own.zarr"]
    made = run(*words)
    assert made.exit_code == 2
    assert "pose.geodetic needs an anchor" in made.output
    # The receiver's altitude says nothing of the height over the ground: what was measured does.
    made = run(*words, "--anchor-from-track")
    assert made.exit_code == 0, made.output
    np.testing.assert_allclose(open_run(tmp_path / "own.zarr")["pose"].values[:, 2], 1.8)


@pytest.mark.parametrize("form", ["roles", "two tables", "one archive"])
def test_the_draft_imports_every_number_as_it_was_measured(form, tmp_path):
    paths = scans(tmp_path)
    np.save(tmp_path / "frequency.npy", FREQUENCY)
    more = [tmp_path / "frequency.npy"]
    if form == "roles":
        names = ["tx"] * TX + ["rx"] * RX
        more.append(
            rows(
                tmp_path / "antennas.csv",
                "kind,x_m,y_m,z_m",
                np.concatenate([SENDERS, RECEIVERS]),
                names,
            )
        )
    elif form == "two tables":
        np.save(tmp_path / "tx.npy", SENDERS)
        np.save(tmp_path / "rx.npy", RECEIVERS)
        more += [tmp_path / "tx.npy", tmp_path / "rx.npy"]
    else:
        np.savez(tmp_path / "places.npz", transmitters=SENDERS, receivers=RECEIVERS)
        more.append(tmp_path / "places.npz")
    way = np.stack(
        [np.zeros(SCANS), 0.5 * np.arange(SCANS), np.zeros(SCANS), np.full(SCANS, 3.0)], axis=-1
    )
    more.append(rows(tmp_path / "way.csv", "x_m,y_m,z_m,heading_deg", way))
    draft = explain_files([*paths, *more]).mapping
    assert questions(draft) == ['polarization = ["HH?"]']
    (tmp_path / "own.toml").write_text(draft.replace("?", ""))
    made = import_mapped(tmp_path / "own.toml").run
    np.testing.assert_array_equal(made["signal"].values[:, 0], SIGNAL.reshape(SCANS, -1, TONES))
    np.testing.assert_allclose(made["frequency"].values, FREQUENCY)
    np.testing.assert_allclose(
        made["tx_position"].values, np.repeat(SENDERS, RX, axis=0), atol=1e-8
    )
    np.testing.assert_allclose(made["rx_position"].values, np.tile(RECEIVERS, (TX, 1)), atol=1e-8)
    np.testing.assert_allclose(made["pose"].values[:, :3], way[:, :3], atol=1e-8)
    np.testing.assert_allclose(made["pose"].values[:, 3], np.radians(3.0), atol=1e-8)


def test_a_list_of_antennas_without_kinds_is_split_and_asked_for_once(tmp_path):
    plain = rows(tmp_path / "plain.csv", "x,y,z", np.concatenate([SENDERS, RECEIVERS]))
    np.save(tmp_path / "freq.npy", FREQUENCY)
    draft = explain_files([*scans(tmp_path)[:3], plain, tmp_path / "freq.npy"]).mapping
    assert 'unit = "m?"  # transmitters first in the list?' in draft
    assert draft.count('unit = "m?"') == 1


def test_antennas_that_send_and_receive_are_one_list_for_both_axes(tmp_path):
    np.save(tmp_path / "a_0.npy", np.ones((RX, RX, TONES), complex))
    np.save(tmp_path / "a_1.npy", np.ones((RX, RX, TONES), complex))
    np.savez(tmp_path / "array.npz", positions=RECEIVERS, freq=FREQUENCY)
    draft = explain_files(
        [tmp_path / "a_0.npy", tmp_path / "a_1.npy", tmp_path / "array.npz"]
    ).mapping
    assert 'dims = ["tx", "rx", "frequency"]' in draft
    assert "[antenna_position]" in draft


def test_as_many_antennas_as_tones_take_no_axis_from_the_tones(tmp_path):
    np.save(tmp_path / "signal.npy", SIGNAL[:, 0, :, :RX].reshape(SCANS * RX, RX))
    np.save(tmp_path / "frequency.npy", FREQUENCY[:RX])
    np.save(tmp_path / "elements.npy", RECEIVERS)
    draft = explain_files(
        [tmp_path / f"{name}.npy" for name in ("signal", "frequency", "elements")]
    )
    assert 'dims = ["scan?", "frequency"]  # of 320 x 16' in draft.mapping


def test_files_of_many_scans_continue_one_another(tmp_path):
    for k in range(2):
        np.save(tmp_path / f"part{k}.npy", np.ones((10, TX, TONES), complex))
    np.savez(tmp_path / "array.npz", tx=SENDERS, rx=SENDERS, frequency=FREQUENCY)
    way = rows(tmp_path / "way.csv", "x_m,y_m,z_m", np.cumsum(np.ones((20, 3)), axis=0))
    draft = explain_files(
        [tmp_path / "part0.npy", tmp_path / "part1.npy", tmp_path / "array.npz", way]
    ).mapping
    assert 'join = "scan"  # 2 files: each file continues the scans of the one before' in draft
    assert 'dims = ["scan", "pair", "frequency"]' in draft


def test_more_fixes_than_scans_are_a_track_whose_clock_is_asked_for(tmp_path):
    np.savez(tmp_path / "array.npz", tx=SENDERS, rx=RECEIVERS, frequency=FREQUENCY)
    way = rows(tmp_path / "way.csv", "time_s,x_m,y_m,z_m", np.cumsum(np.ones((90, 4)), axis=0))
    draft = explain_files([*scans(tmp_path), tmp_path / "array.npz", way]).mapping
    assert "[track]  # 90 fixes of 20 scans" in draft
    assert 'span = ["?", "?"]' in draft
    with pytest.raises(ValueError, match="still a guess"):
        parse_mapping(draft)


def test_a_size_that_could_be_another_unit_is_asked_for(tmp_path):
    np.savez(
        tmp_path / "array.npz", tx=100 * SENDERS, rx=100 * RECEIVERS, frequency=FREQUENCY / 1e6
    )
    draft = explain_files([*scans(tmp_path)[:2], tmp_path / "array.npz"]).mapping
    assert draft.count('unit = "m?"') == 2  # 200: could well be centimetres
    assert 'unit = "MHz?"' in draft


def test_a_part_of_the_files_of_a_folder_is_named_one_by_one(tmp_path):
    paths = scans(tmp_path)
    draft = explain_files(paths[:2], mapping=tmp_path / "sub" / "own.toml").mapping
    assert 'data = ["../scan_0.npy", "../scan_1.npy"]' in draft


def test_a_draft_is_for_files_and_never_written_over(tmp_path):
    np.savez(tmp_path / "array.npz", tx=SENDERS, rx=RECEIVERS, frequency=FREQUENCY)
    paths = [*scans(tmp_path)[:2], tmp_path / "array.npz"]
    (tmp_path / "own.toml").write_text("mine")
    done = run("info", *paths, "--mapping", tmp_path / "own.toml")
    assert done.exit_code == 2
    assert (tmp_path / "own.toml").read_text() == "mine"
    assert run("info", tmp_path, "--mapping", tmp_path / "b.toml").exit_code == 2


def test_antennas_in_the_file_of_every_scan_join_no_pairs(tmp_path):
    for k in range(2):
        np.savez(tmp_path / f"a_{k}.npz", s=SIGNAL[k], tx=SENDERS, rx=RECEIVERS, freq=FREQUENCY)
    draft = explain_files([tmp_path / "a_0.npz", tmp_path / "a_1.npz"]).mapping
    assert 'join = "new scan"' in draft
    assert 'dims = ["tx", "rx", "frequency"]' in draft


def test_the_delays_of_the_samples_may_lie_in_another_file(tmp_path):
    np.save(tmp_path / "traces.npy", np.ones((SCANS, 50)))
    np.savez(tmp_path / "axis.npz", time=np.linspace(0, 50e-9, 50))
    way = rows(tmp_path / "way.csv", "time,x_m,y_m,z_m", np.cumsum(np.ones((SCANS, 4)), axis=0))
    draft = explain_files([tmp_path / "traces.npy", tmp_path / "axis.npz", way]).mapping
    assert '[samples]\nfile = "axis"\nvariable = "time"' in draft
    assert 'dims = ["scan", "sample"]' in draft


def test_longitude_and_latitude_of_a_table_go_before_x_and_y_of_any_frame(tmp_path):
    table = np.column_stack([geodetic()[:, :2], np.cumsum(np.ones((SCANS, 2)), axis=0)])
    way = rows(tmp_path / "fixes.csv", "lat,lon,x,y", table)
    np.savez(tmp_path / "array.npz", tx=SENDERS, rx=RECEIVERS, frequency=FREQUENCY)
    draft = explain_files([*scans(tmp_path), tmp_path / "array.npz", way]).mapping
    assert 'geodetic = {file = "fixes", longitude = "lon", latitude = "lat"' in draft


def test_positions_in_an_array_of_their_own_file_are_the_vehicles(tmp_path):
    np.save(tmp_path / "signal.npy", SIGNAL)
    np.save(tmp_path / "way.npy", np.cumsum(np.ones((SCANS, 3)), axis=0))
    np.savez(tmp_path / "array.npz", tx=SENDERS, rx=RECEIVERS, frequency=FREQUENCY)
    paths = [tmp_path / name for name in ("signal.npy", "way.npy", "array.npz")]
    draft = explain_files(paths).mapping
    assert 'position = {file = "way", variable = "array", unit = "m?"}' in draft
    assert 'dims = ["scan", "tx", "rx", "frequency"]' in draft
    (tmp_path / "own.toml").write_text(draft.replace("?", ""))
    made = import_mapped(tmp_path / "own.toml").run
    np.testing.assert_allclose(made["pose"].values[:, 0], 1.0 + np.arange(SCANS))

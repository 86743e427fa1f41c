"""MCAP recordings."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bag import EPOCH, MAPPING, drive
from flgpr.commands.app import app
from flgpr.formats.arrays import open_arrays
from flgpr.formats.explain import explain_file
from flgpr.formats.mapped import import_mapped

pytest.importorskip("mcap_ros2")


@pytest.fixture(scope="module")
def made():
    return drive()


@pytest.fixture
def path(made, tmp_path):
    (tmp_path / "drive.mcap").write_bytes(made)
    return tmp_path / "drive.mcap"


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_fields_are_stacked_over_the_messages(compression, tmp_path):
    path = tmp_path / "drive.mcap"
    path.write_bytes(drive(compression=compression))
    opened = open_arrays(path)
    assert opened.kind == "MCAP recording"
    step = np.arange(40)
    np.testing.assert_allclose(
        opened.read("/pose/header.stamp"), EPOCH + 0.1 * step, rtol=0, atol=1e-6
    )
    np.testing.assert_allclose(opened.read("/pose@log_time"), EPOCH + 0.1 * step, rtol=0, atol=1e-6)
    np.testing.assert_allclose(opened.read("/pose/pose.position.x"), 0.2 * step)
    np.testing.assert_allclose(
        opened.read("/pose/pose.position"),
        np.stack([0.2 * step, 0 * step - 0.1, 0 * step + 1.5], 1),
    )
    assert opened.read("/pose/pose.orientation").shape == (40, 4)
    np.testing.assert_allclose(opened.read("/tf/map>mast/transform.translation.y"), 0.9)
    assert opened.read("/fix/position_covariance").shape == (40, 9)
    np.testing.assert_array_equal(opened.read("/fix/altitude"), 300.0 + step)
    echo = opened.read("/radar/iq")
    assert echo.dtype == np.int16
    np.testing.assert_array_equal(echo, np.arange(12) + 100 * np.arange(5)[:, None])
    np.testing.assert_array_equal(opened.read("/radar/found.cell"), np.arange(5)[:, None] * [1, -1])
    np.testing.assert_array_equal(opened.read("/level/level"), [[1, 0.5], [1, 1.5], [1, 2.5]])
    np.testing.assert_array_equal(opened.read("/level/list"), [[1, 2, np.nan]] * 3)
    assert not [
        name for name in opened.arrays if "label" in name or "name" in name or "note" in name
    ]


def test_a_recording_is_told_by_topic(path):
    told = explain_file(path)
    lines = {line.split(":")[0]: line for line in told.lines}
    assert lines["/pose"].startswith(
        "/pose: 40 geometry_msgs/msg/PoseStamped over 3.9 s; header.stamp"
    )
    assert "pose.position 3" in lines["/pose"]
    assert lines["/tf/map>base"].startswith("/tf/map>base: 40 transforms")
    assert "not read: protobuf" in lines["/proto"]
    for line in (
        'variable = "/radar/iq"',
        '[time]\nvariable = "/radar/header.stamp"',
        'time = {variable = "/pose/header.stamp", unit = "s"}',
        'position = {variable = "/pose/pose.position", unit = "m?"}',
        'orientation = {variable = "/pose/pose.orientation"',
    ):
        assert line in told.mapping
    assert "tx_position" not in told.mapping


def test_a_drive_becomes_a_run(path):
    (path.parent / "m.toml").write_text(MAPPING)
    run = import_mapped(path.parent / "m.toml", path).run
    want = np.array([1 + 100 * 0, 3, 5]) * 1j + [0, 2, 4]
    np.testing.assert_array_equal(run["signal"].values[0, 0, 0], want.astype(np.complex64))
    pose = run["pose"].values
    np.testing.assert_allclose(pose[:, :3], [[0.1, 1.0 + k, 1.5] for k in range(5)], atol=1e-5)
    np.testing.assert_allclose(
        pose[:, 3], 0.05 * (0.5 + 0.5 * np.arange(5)), atol=1e-6
    )  # it turns to the right
    other = MAPPING.replace("/pose/pose.position", "/tf/map>base/transform.translation")
    (path.parent / "n.toml").write_text(other.replace("/pose/pose.orient", "/tf/map>base/transform.rot").replace(
        "transform.rotation", "transform.rotation"
    ))  # fmt: skip
    again = import_mapped(path.parent / "n.toml", path).run
    np.testing.assert_allclose(again["pose"].values, pose, atol=1e-9)


def test_messages_of_several_lengths_are_refused_when_they_are_asked_for(tmp_path):
    path = tmp_path / "drive.mcap"
    path.write_bytes(drive(iq=lambda k: np.arange(12 if k != 3 else 10)))
    opened = open_arrays(path)
    assert opened.read("/radar/antennas").tolist() == [2] * 5
    with pytest.raises(
        ValueError,
        match=r"/radar: iq must have the shape \(12,\) in all messages, got .*\(10,\) in message 3",
    ):
        opened.read("/radar/iq")
    path.write_bytes(drive(poses=80))
    small = open_arrays(
        path, limit=4000
    )  # less than a topic takes, so that a field is read at a time
    np.testing.assert_allclose(
        small.read("/pose/pose.position"), open_arrays(path).read("/pose/pose.position")
    )
    with pytest.raises(ValueError, match="at most"):
        small.read("/fix/position_covariance")


def test_damaged_recordings(path, made):
    def said(data):
        path.write_bytes(data)
        with pytest.raises(ValueError) as error:
            open_arrays(path)
        assert str(path) in str(error.value)
        return str(error.value)

    assert "mcap recover" in said(made[:60])
    assert "version 0" in said(b"\x89MCAP9\r\n" + made[8:])
    assert "mcap convert" in said(b"SQLite format 3\0" + bytes(100))
    assert "mcap convert" in said(b"#ROSBAG V2.0\n")


def test_chunks_that_expand_beyond_reason_are_refused(path):
    import zstandard

    def bag(declared, content):
        chunk = struct.pack("<QQQI", 0, 0, declared, 0) + struct.pack("<I", 4) + b"zstd"
        chunk += struct.pack("<Q", len(content)) + content
        return b"\x89MCAP0\r\n" + b"\x06" + struct.pack("<Q", len(chunk)) + chunk

    bomb = zstandard.compress(bytes(2**27))
    for declared, words in (
        (2**27, "would expand"),
        (2**40, "at most 2 GB"),
        (1000, "1000 bytes that it declares"),
    ):
        path.write_bytes(bag(declared, bomb))
        with pytest.raises(ValueError, match=words):
            open_arrays(path)


MAPPING_OF_A_DRIVE = """
title = "drive"
files.data = "drive.mcap"
polarization = ["VV"]
signal = {variable = "/radar/iq", interleaved = true, shape = [-1, 2, 256], dims = ["scan", "pair", "frequency"]}
frequency = {span = [0.5, 3.0], unit = "GHz"}
antenna_position = {values = [[-0.4, 0.0, 0.0], [0.4, 0.0, 0.0]], unit = "m"}
time = {variable = "/radar/header.stamp", unit = "s"}
[track]
time = {variable = "/pose/header.stamp", unit = "s"}
position = {variable = "/pose/pose.position", unit = "m"}
orientation = {variable = "/pose/pose.orientation", body = ["-y", "x", "z"]}
axes = ["-y", "x", "z"]
clock_offset = 0.0
"""


def test_a_drive_focuses_to_a_reflector_at_its_place(tmp_path, monkeypatch):
    """The commands of the exchange page: two of them to the first picture."""
    monkeypatch.chdir(tmp_path)
    reflector = np.array([0.3, 7.0, 0.0])
    tones = np.linspace(0.5e9, 3.0e9, 256)

    def iq(k):
        """Antennas at 1.5 m, driving at 2 m/s along x = 0.1 m and turning to the right by 0.05 rad/s."""
        time = 0.5 + 0.5 * k
        heading = 0.05 * time
        side = np.array([[-0.4], [0.4]]) * [np.cos(heading), -np.sin(heading)]
        away = np.linalg.norm(
            np.column_stack([side + [0.1, 2 * time], [1.5, 1.5]]) - reflector, axis=1
        )
        field = 9000 * np.exp(-4j * np.pi * away[:, None] * tones / 299_792_458.0)
        return np.round(np.stack([field.real, field.imag], axis=-1)).astype(np.int16).ravel()

    Path("drive.mcap").write_bytes(drive(6, 60, iq=iq))
    Path("drive.toml").write_text(MAPPING_OF_A_DRIVE)
    for command in (
        "import mapped drive.toml -o drive.zarr",
        "image drive.zarr --json -o drive.png",
    ):
        done = CliRunner().invoke(app, command.split())
        assert done.exit_code == 0, done.output
    first = json.loads(done.stdout)["peaks"][0]
    assert np.hypot(first["x"] - 0.3, first["y"] - 7.0) < 0.05
    assert first["over_median"] > 15
    assert Path("drive.png").stat().st_size > 10_000

"""Messages that Foxglove shows: members, axes, cells, and the file that holds them."""

import base64
import json

import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from flgpr_exchange.bags import foxglove
from flgpr_exchange.bags.writer import mcap_file
from foxglove_schemas import REQUIRED, REQUIRED_IN, faults, titled

TIME = 1_700_000_000_250_000_000
TIMES = {"sec": 1_700_000_000, "nsec": 250_000_000}
POSE = [0.5, 12.0, 2.0, 0.0, 0.0, 0.0]
ALARM = {
    "alarm_id": "alarm-3", "state": "new", "x": 0.5, "y": 14.0, "confidence": 2.345,
    "longitude": 11.0, "latitude": 48.0,
}  # fmt: skip


def messages():
    levels = np.array([[0.0, 12.5, np.nan], [40.0, -9.0, 5.0]], np.float16)
    return {
        "foxglove.PoseInFrame": foxglove.pose_message(TIME, POSE),
        "foxglove.FrameTransform": foxglove.transform_message(TIME, POSE),
        "foxglove.Grid": foxglove.grid_message(TIME, levels, (-0.1, 3.0), (0.1, 0.2), 0.0),
        "foxglove.SceneUpdate": foxglove.alarms_message(TIME, [ALARM], ["alarm-2"]),
        "foxglove.GeoJSON": foxglove.geojson_message([ALARM], "points alone"),
    }


def test_schemas_require_what_foxgloves_own_require():
    assert set(foxglove.SCHEMAS) == set(REQUIRED)
    seen = set()
    for name, schema in foxglove.SCHEMAS.items():
        assert schema["title"] == name
        assert set(schema["required"]) == REQUIRED[name]
        for inner in titled(schema):
            title = inner["title"].removeprefix("foxglove.")
            if inner is not schema:
                assert set(inner["required"]) == REQUIRED_IN[title]
                seen.add(title)
    assert seen == set(REQUIRED_IN)


def test_messages_keep_to_their_schemas():
    for name, message in messages().items():
        assert not list(faults(message, foxglove.SCHEMAS[name])), name
    broken = messages()["foxglove.SceneUpdate"]
    del broken["entities"][0]["texts"]
    broken["deletions"][0]["type"] = "0"
    found = list(faults(broken, foxglove.SCHEMAS["foxglove.SceneUpdate"]))
    assert len(found) == 2


@pytest.mark.parametrize(
    ("attitude", "ahead", "left"),
    [
        ((0.0, 0.0, 0.0), (0, 1, 0), (-1, 0, 0)),
        ((np.pi / 2, 0.0, 0.0), (1, 0, 0), (0, 1, 0)),  # a turn to the right
        ((0.0, 0.2, 0.0), (0, np.cos(0.2), np.sin(0.2)), (-1, 0, 0)),  # its nose up
        ((0.0, 0.0, 0.2), (0, 1, 0), (-np.cos(0.2), 0, np.sin(0.2))),  # its right side down
    ],
)
def test_an_arrow_along_x_points_where_the_vehicle_drives(attitude, ahead, left):
    turn = foxglove.pose_message(TIME, [0.5, 12.0, 2.0, *attitude])["pose"]["orientation"]
    rotation = Rotation.from_quat([turn[name] for name in "xyzw"])
    np.testing.assert_allclose(rotation.apply([1, 0, 0]), ahead, atol=1e-9)
    np.testing.assert_allclose(rotation.apply([0, 1, 0]), left, atol=1e-9)
    transform = foxglove.transform_message(TIME, [0.5, 12.0, 2.0, *attitude])
    assert transform["rotation"] == turn
    assert transform["translation"] == {"x": 0.5, "y": 12.0, "z": 2.0}
    assert transform["timestamp"] == TIMES


def test_cells_of_a_grid_hold_levels_and_greys():
    grid = messages()["foxglove.Grid"]
    assert grid["pose"]["position"] == pytest.approx({"x": -0.15, "y": 2.9, "z": 0.0})
    assert (grid["column_count"], grid["row_stride"], grid["cell_stride"]) == (3, 24, 8)
    data = base64.b64decode(grid["data"])
    offsets = {field["name"]: field["offset"] for field in grid["fields"]}
    values = []
    for start in range(0, len(data), grid["cell_stride"]):
        cell = data[start : start + grid["cell_stride"]]
        level = np.frombuffer(cell, "<f4", 1, offsets["db"])[0]
        values.append((level, cell[offsets["red"]], cell[offsets["alpha"]]))
    np.testing.assert_array_equal(
        values,
        [(0, 0, 255), (12.5, 128, 255), (np.nan, 0, 0), (40, 255, 255), (-9, 0, 255), (5, 51, 255)],
    )
    kinds = {field["name"]: field["type"] for field in grid["fields"]}
    assert kinds == {"db": 7, "red": 1, "green": 1, "blue": 1, "alpha": 1}  # FLOAT32, UINT8


def test_an_alarm_that_the_vehicle_cannot_stop_before_has_another_colour():
    scene = foxglove.alarms_message(TIME, [ALARM | {"in_time": False}, ALARM], ["alarm-2"])
    near, far = scene["entities"]
    assert near["spheres"][0]["color"] != far["spheres"][0]["color"]
    assert far["spheres"][0]["pose"]["position"] == {"x": 0.5, "y": 14.0, "z": 0.0}
    assert far["texts"][0]["text"] == "2.35"
    assert {"key": "state", "value": "new"} in far["metadata"]
    assert scene["deletions"] == [{"timestamp": TIMES, "type": 0, "id": "alarm-2"}]


def test_points_of_a_map_have_the_longitude_first():
    collection = json.loads(messages()["foxglove.GeoJSON"]["geojson"])
    [feature] = collection["features"]
    assert feature["geometry"] == {"type": "Point", "coordinates": [11.0, 48.0]}
    assert feature["properties"]["alarm_id"] == "alarm-3"
    assert "longitude" not in feature["properties"]
    assert collection["statement"] == "points alone"


TOPICS = {f"/{name}": name for name in foxglove.SCHEMAS}


def write(path):
    with mcap_file(path, TOPICS) as writer:
        for number in range(3):
            for name, message in messages().items():
                writer.add(f"/{name}", TIME + number, message)
        writer.describe("flgpr", {"source": "test"})


def test_a_file_is_read_by_the_library_and_has_the_same_bytes_again(tmp_path):
    write(tmp_path / "a.mcap")
    write(tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        read = list(reader.iter_messages())
        assert [record.metadata for record in reader.iter_metadata()] == [{"source": "test"}]
    assert len(read) == 15
    for schema, channel, message in read:
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        assert channel.topic == f"/{schema.name}"
        assert json.loads(schema.data) == foxglove.SCHEMAS[schema.name]
        assert json.loads(message.data) == messages()[schema.name]
        assert message.log_time == message.publish_time == TIME + message.sequence


def test_a_number_that_is_not_finite_is_refused_and_a_file_that_exists_stays(tmp_path):
    path = tmp_path / "a.mcap"
    pose = foxglove.pose_message(TIME, POSE)
    pose["pose"]["position"]["x"] = np.nan
    with mcap_file(path, TOPICS) as writer, pytest.raises(ValueError, match="not JSON compliant"):
        writer.add("/foxglove.PoseInFrame", TIME, pose)
    (tmp_path / "b.mcap").write_bytes(b"mine")
    with pytest.raises(FileExistsError), mcap_file(tmp_path / "b.mcap", TOPICS):
        pass
    assert (tmp_path / "b.mcap").read_bytes() == b"mine"

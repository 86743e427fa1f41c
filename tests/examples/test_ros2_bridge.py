"""The ROS 2 bridge as far as it goes without ROS: a stand-in for rclpy calls it as ROS would."""

import json
import runpy
import socket
import sys
import threading
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.live.sockets import TcpAddress, listening_tcp
from flgpr.model.frames import pose_matrix
from flgpr.store import decode_frame, describe_for_live, save_run
from flgpr.store.scan_file import frame_size
from live_lane import make_lane_run, small_recipe

PACKAGE = Path(__file__).parents[2] / "examples" / "ros2_bridge"
SCANS = 8
RUN = make_lane_run(scans=SCANS)
CLOCK = SimpleNamespace(nanoseconds=0)


class FakeNode:
    """Holds what a node of ROS holds: parameters, subscriptions, a clock and a logger."""

    overrides: ClassVar[dict] = {}

    def __init__(self, name):
        self.name = name
        self.parameters = {}
        self.subscriptions = {}
        self.logged = []

    def declare_parameter(self, name, default):
        self.parameters[name] = self.overrides.get(name, default)

    def get_parameter(self, name):
        return SimpleNamespace(value=self.parameters[name])

    def create_subscription(self, kind, topic, callback, qos):
        assert qos == "sensor data"
        self.subscriptions[topic] = (kind, callback)

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=CLOCK.nanoseconds))

    def get_logger(self):
        return SimpleNamespace(warning=self.logged.append, info=self.logged.append)

    def destroy_node(self):
        self.logged.append("destroyed")


@pytest.fixture
def ros(monkeypatch):
    """The bridge's module, imported beside stand-ins for the packages of ROS."""
    calls = []
    contents = {
        "rclpy": {
            "init": lambda args: calls.append("init"),
            "try_shutdown": lambda: calls.append("shutdown"),
        },
        "rclpy.node": {"Node": FakeNode},
        "rclpy.qos": {"qos_profile_sensor_data": "sensor data"},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"PoseStamped": "PoseStamped"},
        "std_msgs": {},
        "std_msgs.msg": {"Float32MultiArray": "Float32MultiArray"},
    }
    for name, members in contents.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(str(PACKAGE))
    import flgpr_bridge.bridge as bridge

    bridge.rclpy.calls = calls
    yield bridge
    for name in [name for name in sys.modules if name.startswith("flgpr_bridge")]:
        del sys.modules[name]


@pytest.fixture
def described(tmp_path):
    path = tmp_path / "run.json"
    path.write_text(json.dumps(describe_for_live(RUN).as_json()))
    return path


def node_of(ros, monkeypatch, **parameters):
    overrides = {name: str(value) for name, value in parameters.items()}
    monkeypatch.setattr(FakeNode, "overrides", overrides)
    return ros.Bridge()


def pose_message(pose):
    """Return a pose of the lane as ROS has it where the map's x is ahead and its y to the left."""
    to_map = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    body = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    place = to_map @ pose[:3]
    turn = Rotation.from_matrix(to_map @ pose_matrix(pose) @ body).as_quat()
    position = SimpleNamespace(**dict(zip("xyz", place.tolist(), strict=True)))
    orientation = SimpleNamespace(**dict(zip("xyzw", turn.tolist(), strict=True)))
    return SimpleNamespace(pose=SimpleNamespace(position=position, orientation=orientation))


def scan_message(scan):
    samples = RUN["signal"].values[scan].astype(np.complex64)
    return SimpleNamespace(data=samples.view(np.float32).ravel().tolist())


def publish(node, scans=range(SCANS)):
    """Call the node as ROS does: the pose of every scan, then the scan."""
    _, take_pose = node.subscriptions["/vehicle/pose"]
    _, take_scan = node.subscriptions["/radar/scan"]
    for scan in scans:
        CLOCK.nanoseconds = round(1e9 * (1000 + RUN["time"].values[scan]))
        take_pose(pose_message(RUN["pose"].values[scan]))
        take_scan(scan_message(scan))


def frames(data):
    found = []
    while data:
        size = frame_size(data)
        found.append(decode_frame(data[:size]))
        data = data[size:]
    return found


def taken(server):
    """Take one connection's bytes, up to its end."""
    connection, _ = server.accept()
    with connection:
        data = b""
        while piece := connection.recv(2**20):
            data += piece
    return data


@pytest.mark.parametrize("attitude", [(0, 0, 0), (0.4, 0.1, -0.2), (-2.8, -0.3, 0.5), (1.6, 0, 0)])
def test_poses_of_ros_become_poses_of_the_lane(ros, attitude):
    pose = np.array([0.3, 12.0, 2.0, *attitude])
    message = pose_message(pose).pose
    position = [getattr(message.position, name) for name in "xyz"]
    turn = [getattr(message.orientation, name) for name in "xyzw"]
    assert position[0] == 12.0
    found = ros.lane_pose(position, turn, ["-y", "x", "z"])
    np.testing.assert_allclose(found, pose, atol=1e-12)


def test_every_scan_is_sent_with_its_pose(ros, described, monkeypatch):
    with listening_tcp(TcpAddress("127.0.0.1", 0), 1) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
        node = node_of(ros, monkeypatch, description=described, address=address)
        kinds = {topic: kind for topic, (kind, _) in node.subscriptions.items()}
        assert kinds == {"/vehicle/pose": "PoseStamped", "/radar/scan": "Float32MultiArray"}
        data = []
        thread = threading.Thread(target=lambda: data.append(taken(server)))
        thread.start()
        publish(node)
        CLOCK.nanoseconds += round(1e9)
        node.take_scan(scan_message(0))  # a second behind the last pose
        node.end()
        thread.join(60)
    first, *scans, last = frames(data[0])
    assert (first.kind, last.kind) == ("run", "end")
    assert first.header == {"kind": "run", **describe_for_live(RUN).as_json()}
    for number, scan in enumerate(scans[:-1]):
        assert scan.header["scan"] == number
        assert scan.header["time"] == pytest.approx(1000 + RUN["time"].values[number])
        np.testing.assert_allclose(scan.header["pose"], RUN["pose"].values[number], atol=1e-9)
        assert scan.payload == RUN["signal"].values[number].astype("<c8").tobytes()
    assert (scans[-1].header["scan"], scans[-1].header["pose"]) == (SCANS, None)


def test_scans_are_left_out_while_nobody_listens_and_go_on_afterwards(ros, described, monkeypatch):
    with listening_tcp(TcpAddress("127.0.0.1", 0), 1) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
    node = node_of(ros, monkeypatch, description=described, address=address)
    publish(node, range(2))
    assert node.left_out == 2
    assert "scan left out, 2 in all" in node.logged[-1]
    port = int(address.rpartition(":")[2])
    with listening_tcp(TcpAddress("127.0.0.1", port), 1) as server:
        data = []
        thread = threading.Thread(target=lambda: data.append(taken(server)))
        thread.start()
        publish(node, range(2, 4))
        node.end()
        thread.join(60)
    assert [frame.header.get("scan") for frame in frames(data[0])] == [None, 2, 3, None]


def test_a_live_run_takes_what_the_bridge_sends(ros, described, monkeypatch, tmp_path):
    save_run(RUN, tmp_path / "run.zarr")
    (tmp_path / "recipe.toml").write_text(small_recipe())
    feed(tmp_path / "run.zarr", tmp_path / "incoming", float("inf"))
    recipe = tmp_path / "recipe.toml"
    watched = LiveRun(LiveOptions(recipe, tmp_path / "watched", tmp_path / "incoming")).run()

    run = LiveRun(LiveOptions(recipe, tmp_path / "out", tcp="0"))
    reports = []
    thread = threading.Thread(target=lambda: reports.append(run.run()))
    thread.start()
    while run.listens_on is None:
        thread.join(0.01)
    node = node_of(ros, monkeypatch, description=described, address=run.listens_on)
    publish(node)
    node.end()
    thread.join(300)
    assert reports[0].counts == watched.counts
    assert reports[0].alarms == watched.alarms > 0


def test_the_node_ends_in_good_order(ros, described, monkeypatch):
    made = []

    def spin(node):
        made.append(node)
        raise KeyboardInterrupt

    ros.rclpy.spin = spin
    monkeypatch.setattr(FakeNode, "overrides", {"description": str(described)})
    ros.main()
    assert ros.rclpy.calls == ["init", "shutdown"]
    assert made[0].logged == ["destroyed"]


def test_what_cannot_be_used_is_refused(ros, described, monkeypatch):
    with pytest.raises(ValueError, match="axis must be x, y or z, or one of them with a minus"):
        ros.lane_pose((0, 0, 0), (0, 0, 0, 1), ["up", "x", "z"])
    node = node_of(ros, monkeypatch, description=described)
    broken = pose_message(RUN["pose"].values[0])
    vars(broken.pose.orientation).update(x=0.0, y=0.0, z=0.0, w=0.0)
    node.take_pose(broken)
    assert "quaternion must have a length" in node.logged[-1]
    assert node._pose is None
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))  # nobody listens there
        node.parameters["address"] = f"127.0.0.1:{unused.getsockname()[1]}"
        node.take_scan(scan_message(0))
    assert node.left_out == 1


def test_the_package_is_one_that_colcon_builds(monkeypatch):
    """Name, index entry and program agree in package.xml, setup.py and setup.cfg."""
    told = {}
    monkeypatch.setattr("setuptools.setup", lambda **words: told.update(words))
    runpy.run_path(str(PACKAGE / "setup.py"))
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    name = manifest.findtext("name")
    assert told["name"] == name
    assert told["version"] == manifest.findtext("version")
    assert manifest.findtext("export/build_type") == "ament_python"
    assert {entry.text for entry in manifest.findall("exec_depend")} == {
        "rclpy",
        "geometry_msgs",
        "std_msgs",
    }
    for _, files in told["data_files"]:
        assert all((PACKAGE / file).is_file() for file in files)
    assert (PACKAGE / "resource" / name).is_file()
    assert told["entry_points"] == {"console_scripts": [f"bridge = {name}.bridge:main"]}
    assert f"$base/lib/{name}" in (PACKAGE / "setup.cfg").read_text()

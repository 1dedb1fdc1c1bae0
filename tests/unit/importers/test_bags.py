"""Bags of ROS 2, written by the library that belongs to the format, and by SQL: numbers, times, joints, damage."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import open_table, propose, read_log
from pmsm_ctrl.importers.bag_worker import STANDARD

pytest.importorskip("mcap_ros2", reason="mcap-ros2-support is not installed")

JOINT_STATE = "sensor_msgs/msg/JointState"
IMAGE = "test_msgs/msg/Picture"
START = 1_700_000_000_000_000_000  # ns
COUNT = 300


def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Time, position, velocity and effort of an axis with inertia and dry friction."""
    t = 0.002 * np.arange(COUNT)
    theta = 1.5 * np.sin(6.0 * t) + 0.3 * np.sin(17.0 * t)
    omega = 9.0 * np.cos(6.0 * t) + 5.1 * np.cos(17.0 * t)
    alpha = -54.0 * np.sin(6.0 * t) - 86.7 * np.sin(17.0 * t)
    return t, theta, omega, 0.02 * alpha + 0.3 * np.sign(omega)


def joint_state(t: float, joints: dict[str, tuple[float, ...]], stamped: bool = True) -> dict[str, Any]:
    """Return a message; a joint's numbers are position, velocity and effort."""
    now = START + round(t * 1e9) if stamped else 0
    stamp = {"sec": now // 10**9, "nanosec": now % 10**9}
    position, velocity, effort = zip(*joints.values(), strict=True)
    return {
        "header": {"stamp": stamp, "frame_id": ""}, "name": list(joints),
        "position": list(position), "velocity": list(velocity), "effort": list(effort),
    }  # fmt: skip


def write_mcap(path: Path, *, joints: tuple[str, ...] = ("elbow",), stamped: bool = True) -> None:
    """Write the motion; a second joint moves twice as far, and a picture and a temperature come in between."""
    from mcap_ros2.writer import Writer

    rng = np.random.default_rng(4)
    with open(path, "wb") as stream, Writer(stream, chunk_size=20_000) as bag:
        state = bag.register_msgdef(JOINT_STATE, STANDARD["sensor_msgs/JointState"])
        picture = bag.register_msgdef(IMAGE, "uint8[] data\n")
        number = bag.register_msgdef("std_msgs/msg/Float64", STANDARD["std_msgs/Float64"])
        for k, row in enumerate(zip(*motion(), strict=True)):
            t, values = float(row[0]), tuple(map(float, row[1:]))
            held = {name: tuple((1.0 + n) * value for value in values) for n, name in enumerate(joints)}
            late = START + round(t * 1e9) + (int(rng.integers(0, 300_000)) if stamped else 0)
            bag.write_message("/joint_states", state, joint_state(t, held, stamped), log_time=late)
            if k % 50 == 0:
                bag.write_message("/camera", picture, {"data": list(range(200))}, log_time=late)
                bag.write_message("/motor/temperature", number, {"data": 40.0 + t}, log_time=late)


def write_sqlite(path: Path, *, defined: bool) -> None:
    """Write the motion as bags of ROS 2 Iron do, or, without definitions, of Humble."""
    from mcap_ros2._dynamic import serialize_dynamic

    text = STANDARD["sensor_msgs/JointState"]
    encode = serialize_dynamic(JOINT_STATE, text)[JOINT_STATE]
    bag = sqlite3.connect(path)
    bag.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    bag.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    bag.execute("INSERT INTO topics VALUES (3, '/joint_states', ?, 'cdr')", [JOINT_STATE])
    if defined:
        columns = "topic_type TEXT, encoding TEXT, encoded_message_definition TEXT, type_description_hash TEXT"
        bag.execute(f"CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, {columns})")
        bag.execute("INSERT INTO message_definitions VALUES (1, ?, 'ros2msg', ?, '')", [JOINT_STATE, text])
    for row in zip(*motion(), strict=True):
        t, *values = map(float, row)
        data = encode(joint_state(t, {"elbow": tuple(values)}))
        bag.execute("INSERT INTO messages VALUES (NULL, 3, ?, ?)", [START + round(t * 1e9), data])
    bag.commit()
    bag.close()


SI = {
    "t": "/joint_states.elbow.stamp [s]", "theta": "/joint_states.elbow.position [rad]",
    "omega": "/joint_states.elbow.velocity [rad/s]", "torque": "/joint_states.elbow.effort [N m]",
}  # fmt: skip


@pytest.mark.parametrize("kind", ["mcap", "sqlite with definitions", "sqlite without"])
def test_joint_states_are_read_to_the_digit(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "run.bag"  # the content tells the format
    if kind == "mcap":
        write_mcap(path)
    else:
        write_sqlite(path, defined=kind.endswith("definitions"))
    t, theta, omega, torque = motion()
    log = read_log(path, mapping=SI)
    np.testing.assert_allclose(log.t, t, atol=1e-12)
    np.testing.assert_array_equal(log["theta"], theta)
    np.testing.assert_array_equal(log["omega"], omega)
    np.testing.assert_array_equal(log["torque"], torque)


@pytest.mark.usefixtures("good_files")
def test_a_bag_is_proposed_and_its_units_are_doubted(tmp_path: Path) -> None:
    write_mcap(tmp_path / "run.mcap")
    table = open_table(tmp_path / "run.mcap")
    assert any("/camera" in note for note in table.notes)
    assert any("time of the recorder" in note and "/motor/temperature" in note for note in table.notes)
    proposal = propose(table)
    assert proposal.complete
    named = {"theta": "position", "omega": "velocity", "torque": "effort"}
    assert {channel: proposal.mapping[channel] for channel in named} == {channel: SI[channel] for channel in named}
    assert "unit_assumed" in [notice.code for notice in proposal.notices]
    log = read_log(tmp_path / "run.mcap", mapping=proposal.mapping)
    np.testing.assert_allclose(np.diff(log.t), 0.002, atol=1e-12)  # the stamps, and not the recorder's late times


@pytest.mark.usefixtures("good_files")
def test_of_several_joints_one_is_proposed_whole_and_said(tmp_path: Path) -> None:
    write_mcap(tmp_path / "run.mcap", joints=("shoulder", "elbow"))
    proposal = propose(open_table(tmp_path / "run.mcap"))
    joints = {column.split(".")[1] for column in proposal.mapping.values() if "joint" in column}
    assert len(joints) == 1
    other = ({"shoulder", "elbow"} - joints).pop()
    assert any(other in label and what == "theta as well" for label, what in proposal.unused)
    assert "several_columns" in [notice.code for notice in proposal.notices]
    log = read_log(tmp_path / "run.mcap", mapping=SI)  # the other one by name
    np.testing.assert_array_equal(log["theta"], 2.0 * motion()[1])


@pytest.mark.usefixtures("good_files")
def test_without_stamps_the_recorder_gives_the_time(tmp_path: Path) -> None:
    write_mcap(tmp_path / "run.mcap", stamped=False)
    np.testing.assert_allclose(read_log(tmp_path / "run.mcap", mapping=SI).t, motion()[0], atol=1e-12)


def declared(path: Path, size: int) -> bytes:
    """Return the bag with another unpacked size in the header of its first chunk."""
    content = bytearray(path.read_bytes())
    place = 8
    while content[place] != 0x06:
        place += 9 + int.from_bytes(content[place + 1 : place + 9], "little")
    content[place + 9 + 16 : place + 9 + 24] = size.to_bytes(8, "little")
    return bytes(content)


def test_damaged_and_hostile_bags_are_refused_in_one_line(tmp_path: Path) -> None:
    write_mcap(tmp_path / "run.mcap")
    content = (tmp_path / "run.mcap").read_bytes()
    hostile = {
        "cut off": (content[: len(content) // 2], "mcap recover"),
        "bomb": (declared(tmp_path / "run.mcap", 1 << 40), "unpacks to more than"),
        "ROS 1": (b"#ROSBAG V2.0\n" + bytes(100), "ROS 1 bag"),
        "other SQLite": (b"SQLite format 3\0" + bytes(84), "damaged"),
    }
    for what, (damaged, said) in hostile.items():
        path = tmp_path / "bad.mcap"
        path.write_bytes(damaged)
        with pytest.raises(LogError, match=said) as caught:
            read_log(path, mapping=SI)
        assert "\n" not in str(caught.value), what
        assert str(caught.value).startswith(f"{path}: "), what


def test_a_view_in_the_place_of_the_messages_is_not_evaluated(tmp_path: Path) -> None:
    path = tmp_path / "view.db3"
    bag = sqlite3.connect(path)
    bag.execute("CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT)")
    endless = "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n) SELECT k AS id, 1 AS topic_id FROM n"
    bag.execute(f"CREATE VIEW messages AS {endless}")
    bag.commit()
    bag.close()
    with pytest.raises(LogError, match="without the tables topics and messages"):
        read_log(path)

"""ROS 2 bags, MCAP and SQLite: the numeric fields of every topic; each topic, and each joint, has its own time."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.guard import not_installed
from pmsm_ctrl.importers.isolated import ask
from pmsm_ctrl.importers.table import Array, Column, Table, left_out, one_line

__all__ = ["open_bag"]

LISTED = 12


def open_bag(path: Path, file: str) -> Table:
    """Open a bag of ROS 2.

    The joints of ``sensor_msgs/JointState`` become columns such as ``/joint_states.elbow.position``. Bags state no
    units. The time is ``header.stamp`` where all messages of a topic have one, else that of the recorder.

    Raises
    ------
    LogError
        When the library is not installed, the file is damaged, or no topic holds numbers.
    """
    if find_spec("mcap") is None or find_spec("mcap_ros2") is None:
        raise not_installed(file, "ROS 2", "mcap and mcap-ros2-support", "ros")
    answer, raw = ask("ROS 2", path, file)
    columns = tuple(Column(name, "s" if is_time else "", name, group, is_time)
                    for name, group, is_time in answer["columns"])  # fmt: skip
    if all(column.is_time for column in columns):
        left = one_line(", ".join(answer["left"][:LISTED]))
        raise LogError(f"{file}: no topic of numbers in this ROS 2 bag (found: {left or 'no message'})")
    ends = np.cumsum([0, *answer["sizes"]]) * 8
    arrays = [np.frombuffer(raw[a:b], dtype=np.float64) for a, b in pairwise(ends)]

    def load(indices: Sequence[int]) -> list[Array]:
        return [arrays[i] for i in indices]

    def locate(column: int, sample: int) -> str:
        return f"'{columns[column].label}', message {sample + 1}"

    notes = left_out("topics and fields", answer["left"])
    if answer["recorded"]:
        topics = one_line(", ".join(answer["recorded"][:LISTED]))
        notes += (f"time of the recorder, since the messages have no stamp: {topics}",)
    return Table(file, "ROS 2 bag", columns, load, locate, notes)

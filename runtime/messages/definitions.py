# SPDX-License-Identifier: Apache-2.0
"""Names, definition texts and type hashes of the standard ROS 2 messages."""

from __future__ import annotations

from functools import lru_cache

from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

IMU = "sensor_msgs/msg/Imu"
JOINT_STATE = "sensor_msgs/msg/JointState"
ODOMETRY = "nav_msgs/msg/Odometry"
TF = "tf2_msgs/msg/TFMessage"
PATH = "nav_msgs/msg/Path"
TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE_STAMPED = "geometry_msgs/msg/PoseWithCovarianceStamped"
BATTERY_STATE = "sensor_msgs/msg/BatteryState"
LASER_SCAN = "sensor_msgs/msg/LaserScan"
POINT_CLOUD2 = "sensor_msgs/msg/PointCloud2"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
BOOL = "std_msgs/msg/Bool"
STRING = "std_msgs/msg/String"
EMPTY = "std_msgs/msg/Empty"
FLOAT64 = "std_msgs/msg/Float64"

DISTRIBUTION = "jazzy"
"""The ROS distribution whose definitions are written; these messages are the same since Humble."""


@lru_cache(maxsize=1)
def _store() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def definition(type_name: str) -> str:
    """The full text of a standard message, the types it is made of appended.

    Raises:
        KeyError: if the distribution has no such message.
    """
    text, _ = _store().generate_msgdef(type_name, ros_version=2)
    return text


def type_hash(type_name: str, text: str | None = None) -> str:
    """The RIHS01 hash of a standard message, or of the flat message that `text` defines under that name.

    Raises:
        KeyError: if the distribution has no such message, or the text defines none.
    """
    store = _store()
    if text is not None:
        store = get_typestore(Stores.EMPTY)
        try:
            store.register(get_types_from_msg(text, type_name))
        except TypesysError:
            raise KeyError(type_name) from None
    return store.hash_rihs01(type_name)

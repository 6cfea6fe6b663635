# SPDX-License-Identifier: Apache-2.0
"""Names of the ROS topics that the link takes and sends."""

IMU = "/imu/data"
LOCALIZATION = "/localization/pose"
SCAN = "/scan"
POINTS = "/points"
BATTERY = "/bms/battery_state"
PATH = "/path"
PATH_SPEED = "/path/speed"
CMD_VEL = "/cmd_vel"
TELEOP = "/teleop/cmd_vel"
E_STOP = "/operator/e_stop"
ARM = "/operator/arm"
MOTION = "/operator/motion"
RESET = "/operator/reset"
HEARTBEAT = "/operator/heartbeat"
RELEASE = "/operator/release"
TAKEN = (
    IMU,
    LOCALIZATION,
    SCAN,
    POINTS,
    BATTERY,
    PATH,
    PATH_SPEED,
    CMD_VEL,
    TELEOP,
    E_STOP,
    ARM,
    MOTION,
    RESET,
    HEARTBEAT,
    RELEASE,
)

JOINT_STATES = "/joint_states"
ODOMETRY = "/odom"
TF = "/tf"
TF_STATIC = "/tf_static"
BATTERY_STATE = "/battery_state"
DIAGNOSTICS = "/diagnostics"
ROBOT_DESCRIPTION = "/robot_description"
STATE = "/ugv/state"
LOOPS = "/ugv/loops"

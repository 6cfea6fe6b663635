# SPDX-License-Identifier: Apache-2.0
"""Every value that crosses a task boundary, one record per signal.

Stamps are nanoseconds, units SI, quaternions (x, y, z, w), frames as REP 105: `odom` is the world-fixed frame of the
estimate, `base` the trunk frame (x forward, y left, z up). Symbolic sizes: `joint`, `foot`, `foot_xyz` (three a foot),
`bus` (CAN buses), `frame` (capacity of a batch of CAN frames), `frame_byte` (16 per frame), `path` (capacity of a
path), and of the MPC's horizon `knot` (steps + 1), `horizon_foot` (foot x steps) and `horizon_xyz` (three times that).
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

from runtime.records import (
    Record,
    boolean,
    boolean_array,
    float64,
    float64_array,
    int64,
    int64_array,
    uint8,
    uint8_array,
    uint32,
    uint32_array,
)


class Motion(IntEnum):
    """What the operator asks the robot to do."""

    REST = 0
    STAND = 1
    WALK = 2
    SIT = 3


class Mode(IntEnum):
    """States of the safety state machine (OFF -> STANDBY -> STANDING -> ACTIVE, DAMPED from anywhere).

    CROUCHING, between power and DAMPED, lowers a trunk that can no longer be balanced.
    """

    OFF = 0
    STANDBY = 1
    STANDING = 2
    ACTIVE = 3
    DAMPED = 4
    CROUCHING = 5


class Stance(IntEnum):
    """What the legs do as a whole."""

    RESTING = 0
    RISING = 1
    STANDING = 2
    SITTING = 3
    GATHERING = 4


class Fault(IntFlag):
    """Reasons why the safety filter damped the robot or limited a command."""

    NONE = 0
    TILT = 1 << 0
    NON_FINITE_COMMAND = 1 << 1
    NON_FINITE_SENSOR = 1 << 2
    STALE_IMU = 1 << 3
    STALE_MOTOR = 1 << 4
    STALE_FORCES = 1 << 5
    MOTOR_FAULT = 1 << 6
    TEMPERATURE = 1 << 7
    VOLTAGE = 1 << 8
    JOINT_POSITION = 1 << 9
    JOINT_VELOCITY = 1 << 10
    STALE_LOCALIZATION = 1 << 11
    STALE_BODY_COMMAND = 1 << 12
    STALE_OPERATOR = 1 << 13
    NO_LEASE = 1 << 14
    EMERGENCY_STOP = 1 << 15
    BUS = 1 << 16
    SATURATION = 1 << 17
    FROZEN_IMU = 1 << 18
    IMPLAUSIBLE_IMU = 1 << 19
    IMU_TIME = 1 << 20
    LATE_LOOP = 1 << 21
    OVERRUNS = 1 << 22
    LATE_FORCES = 1 << 23
    NO_FORCES = 1 << 24
    MOVED_LOCALIZATION = 1 << 25
    MISSING_REPLY = 1 << 26
    STUCK_STEERING = 1 << 27
    STOOD_STILL = 1 << 28


class Request(IntEnum):
    """What an operator's event asks for."""

    LIFE = 0
    ARM = 1
    DISARM = 2
    MOTION = 3
    RESET = 4
    EMERGENCY_STOP = 5
    RELEASE = 6
    VELOCITY = 7


class Steering(IntEnum):
    """What a walking robot follows."""

    PATH = 0
    VELOCITY = 1


class BusState(IntEnum):
    """What a bus reports of itself."""

    UP = 0
    PASSIVE = 1
    OFF = 2
    DOWN = 3


class CanFrames(Record):
    """A batch of CAN frames in the byte layout of Linux `struct can_frame`, as read from or given to the buses."""

    stamp_ns = int64("ns", "when the batch was read or written")
    count = uint32("", "frames in the batch")
    lost = uint32("", "frames dropped for lack of room since start")
    bus = uint8_array("frame", "", "index of the bus of each frame")
    arrival_ns = int64_array("frame", "ns", "when each frame was received, or is due to be sent")
    data = uint8_array("frame_byte", "", "16 bytes a frame")


class BusStatus(Record):
    """State of the buses, and what went wrong on each since start."""

    on_change = True
    state = uint8_array("bus", "", "BusState: 0 up, 1 error passive, 2 bus-off, 3 down or gone")
    backlog = boolean_array("bus", "more frames waited than one tick takes")
    refused = uint32_array("bus", "", "frames not sent for lack of room")
    failed = uint32_array("bus", "", "reads and writes that failed since the bus was down")
    malformed = uint32_array("bus", "", "packets that were no frame")
    errors = uint32_array("bus", "", "error frames")
    overflow = uint32_array("bus", "", "frames that the kernel dropped since they were not read in time")
    purged = uint32_array("bus", "", "frames dropped when the bus came back, as they had become too old")
    withheld = uint32_array("bus", "", "frames not sent, as their commands had become too old on their way")


class LoopTiming(Record):
    """How the loop that reads this keeps its time; all zero in virtual time but for injected delays."""

    on_change = True
    overruns = uint32("", "ticks since start before which whole periods were skipped")
    skipped = uint32("", "periods skipped since start")
    overruns_in_a_row = uint32("", "ticks up to this one, each of which had periods skipped before it")
    gap_ns = int64(
        "ns", "since the tick before, suspensions of the computer included; 0 unless that is over two periods"
    )


class Imu(Record):
    """One inertial sample, in the base frame."""

    stamp_ns = int64("ns")
    sequence = int64()
    linear_acceleration = float64_array(3, "m/s^2", "specific force")
    angular_velocity = float64_array(3, "rad/s")


class Pose(Record):
    """A pose of the base in `odom`: of the localisation sensor (stamped at acquisition), or true."""

    stamp_ns = int64("ns")
    sequence = int64()
    position = float64_array(3, "m")
    orientation = float64_array(4, "", "x y z w")


class Battery(Record):
    """State of the battery."""

    stamp_ns = int64("ns")
    voltage = float64("V")
    current = float64("A")
    charge = float64("", "0 to 1")


class Truth(Record):
    """The simulator's state of the robot, for `--estimator truth` and for the errors of a run."""

    stamp_ns = int64("ns")
    position = float64_array(3, "m", "trunk origin in odom")
    orientation = float64_array(4, "", "x y z w")
    linear_velocity = float64_array(3, "m/s", "of the trunk origin, in odom")
    angular_velocity = float64_array(3, "rad/s", "in base")
    contact_force = float64_array("foot_xyz", "N", "ground reaction on each foot, in odom")


class OperatorEvent(Record):
    """One request of one sender; requests are taken in turn, none is overwritten by the next."""

    stamp_ns = int64("ns")
    source = int64("", "who sent it")
    priority = uint8("", "of the sender; a higher one takes the lease from a lower one")
    request = uint8("", "Request: 0 life, 1 arm, 2 disarm, 3 motion, 4 reset, 5 e-stop, 6 release, 7 velocity")
    motion = uint8("", "Motion that is asked for")
    velocity = float64_array(3, "m/s, m/s, rad/s", "forward, lateral, yaw rate that are asked for")
    sequence = int64("", "of the process that passes events on; two events differ in it or in their stamps")
    lost = uint32("", "events that were overwritten before control came to them, since its start")


class OperatorRequest(Record):
    """What the holder of the lease asks for."""

    stamp_ns = int64("ns", "last sign of life of the holder")
    motion = uint8("", "Motion: 0 rest, 1 stand, 2 walk, 3 sit")
    arm = boolean("the robot is armed")
    reset = boolean("asks to leave DAMPED, and to take the localisation at its word")
    emergency_stop = boolean("anyone asked to stop; latched until a reset with the arm withdrawn")
    held = boolean("there is a holder of the lease")
    priority = uint8("", "highest that the holder has shown")
    steering = uint8("", "Steering: 0 path, 1 velocity")
    holder = int64("", "the source that holds the lease")
    velocity = float64_array(3, "m/s, m/s, rad/s", "forward, lateral, yaw rate that the holder asks for")
    velocity_ns = int64("ns", "stamp of that velocity")
    leases = uint32("", "leases given since start")
    refused = uint32("", "events since start that only the holder, or only an unarmed robot, may send")
    malformed = uint32("", "events rejected since start: unknown, not finite, too old, or stamped in the future")


class Path(Record):
    """The path to follow: waypoints in odom."""

    on_change = True
    stamp_ns = int64("ns")
    source = int64("", "who sent it")
    count = uint32()
    closed = boolean("the last waypoint leads on to the first")
    speed = float64("m/s", "commanded speed along the path")
    x = float64_array("path", "m")
    y = float64_array("path", "m")


class JointState(Record):
    """Joints as measured by the drives, signs and gears applied."""

    stamp_ns = int64("ns", "of the newest reply")
    reply_ns = int64_array("joint", "ns", "arrival of the last valid reply of each joint")
    position = float64_array("joint", "rad")
    velocity = float64_array("joint", "rad/s")
    effort = float64_array("joint", "N.m")
    temperature = float64_array("joint", "degC", "NaN where the drive does not report it")
    error = uint8_array("joint", "", "drive's own error code, 0 none")
    rejected = uint32("", "frames rejected since start: wrong length, unknown id, error frame, out of range")


class BodyState(Record):
    """The estimate of the trunk."""

    stamp_ns = int64("ns")
    position = float64_array(3, "m", "trunk origin in odom")
    orientation = float64_array(4, "", "x y z w")
    linear_velocity = float64_array(3, "m/s", "of the trunk origin, in odom")
    angular_velocity = float64_array(3, "rad/s", "in base, bias removed")
    foot_position = float64_array("foot_xyz", "m", "foot centres, in odom")
    foot_velocity = float64_array("foot_xyz", "m/s", "foot centres, in odom")
    course_velocity = float64_array(2, "m/s", "horizontal velocity averaged over a gait cycle, in odom")
    contact = boolean_array("foot", "foot carries load")
    contact_force = float64_array("foot", "N", "normal force estimated from joint efforts")
    plane_normal = float64_array(3, "", "unit normal of the stance plane, in odom")
    height = float64("m", "trunk origin above the stance plane, along world z")
    localization_age_ns = int64("ns", "age of the newest pose that was fused")
    localization_rejected = uint32("", "poses rejected since start")
    imu_rejected = uint32("", "samples since start that were not finite, not plausible or not in order of time")
    imu_age_ns = int64("ns", "age of the inertial sample that was used")
    localization_disputed = uint32("", "poses in a row that agree with each other but not with the estimate")


class BodyCommand(Record):
    """What the tracker asks of the body."""

    stamp_ns = int64("ns")
    velocity = float64_array(2, "m/s", "forward and lateral, along the stance plane, in base heading")
    yaw_rate = float64("rad/s")
    heading = float64("rad", "heading to hold while standing")
    look_ahead = float64("m")
    target = float64_array(2, "m", "look-ahead point in odom")
    k_v = float64("", "fuzzy coefficient of v^2, eq 17")
    k_w = float64("", "fuzzy coefficient of v, eq 17")
    lateral_error = float64("m", "signed, positive with the path to the right")
    heading_error = float64("rad")
    progress = float64("m", "arc length along the path")
    remaining = float64("m", "arc length to the goal")
    arrived = boolean("the goal has been reached")
    rejected_paths = uint32("", "paths rejected since start")
    foreign_paths = uint32("", "those of them that were not of the lease's holder")


class Posture(Record):
    """Where standing up or sitting down has come to, and the joint references that do it."""

    stamp_ns = int64("ns")
    stance = uint8("", "Stance: 0 resting, 1 rising, 2 standing, 3 sitting down, 4 gathering the legs")
    progress = float64("", "of the present motion, 0 to 1")
    position = float64_array("joint", "rad")
    velocity = float64_array("joint", "rad/s")


class Gait(Record):
    """Gait schedule, contacts and swing references of the present instant."""

    stamp_ns = int64("ns")
    balancing = boolean("the legs carry the trunk under feedback")
    walking = boolean()
    cycle_start_ns = int64("ns", "start of the present gait cycle")
    stance = boolean_array("foot", "scheduled stance")
    contact = boolean_array("foot", "feet that carry load: scheduled and touched down, or touched down early")
    foot_phase = float64_array("foot", "", "progress within the present stance or swing, 0 to 1")
    foothold = float64_array("foot_xyz", "m", "where each foot stands or will land (foot centre), in odom")
    swing_position = float64_array("foot_xyz", "m", "reference of the feet in the air, in odom")
    swing_velocity = float64_array("foot_xyz", "m/s")
    swing_acceleration = float64_array("foot_xyz", "m/s^2")
    late_contacts = uint32("", "swings that met the ground later than scheduled, since start")
    early_contacts = uint32("", "swings that met the ground earlier than scheduled, since start")
    lost_contacts = uint32("", "standing feet that lost the ground, since start")


class ContactForces(Record):
    """The MPC's plan: ground reactions over the horizon, and the first predicted states."""

    stamp_ns = int64("ns", "when the first step begins")
    knot_ns = int64_array("knot", "ns", "boundaries of the steps")
    stance = boolean_array("horizon_foot", "contact schedule the plan was made for")
    force = float64_array("horizon_xyz", "N", "step-major, then foot, in odom")
    reference_position = float64_array(3, "m", "centre of mass in odom at the stamp")
    reference_velocity = float64_array(3, "m/s", "in odom")
    reference_orientation = float64_array(3, "rad", "roll pitch yaw at the stamp")
    reference_yaw_rate = float64("rad/s")
    cost = float64()
    residual = float64("", "largest violation of the solver's optimality conditions")
    iterations = uint32()
    failures = uint32("", "solves that failed since start; the last good plan was held")


class JointCommand(Record):
    """One command for every drive (paper 000, eq 44)."""

    stamp_ns = int64("ns")
    position = float64_array("joint", "rad")
    velocity = float64_array("joint", "rad/s")
    effort = float64_array("joint", "N.m", "feed-forward")
    stiffness = float64_array("joint", "N.m/rad")
    damping = float64_array("joint", "N.m.s/rad")
    qp_failures = uint32("", "whole-body QPs that failed since start")
    qp_residual = float64()
    relaxation = float64_array(6, "m/s^2, rad/s^2", "delta_b, the body acceleration given up")


class SafetyStatus(Record):
    """State of the safety filter."""

    stamp_ns = int64("ns")
    mode = uint8("", "Mode: 0 off, 1 standby, 2 standing, 3 active, 4 damped, 5 crouching")
    fault = uint32("", "Fault bits that are latched")
    warning = uint32("", "Fault bits of this tick")
    limited = uint32("", "commands altered by a limit since start")
    faults = uint32("", "falls into DAMPED since start")
    halt = uint32("", "Fault bits for which the robot slows to a stand")
    coasted = uint32("", "ticks since start at which a joint went on with its last reply, summed over joints")
    derated = boolean("torque is limited to the lower bound")

"""The topics of the suite: name, message type and quality of service, for nodes and files alike.

Names are given absolute; nodes use them relative, so a namespace or a remapping moves them.
"""

from __future__ import annotations

from dataclasses import dataclass

from tombo_bag.qos import EVENT, SENSOR, STATE, STATUS, Qos


@dataclass(frozen=True)
class TopicSpec:
    """One topic.

    Attributes:
        name: absolute, as `/mocap/pose`; with two slashes no namespace moves it.
        typename: message type, as `geometry_msgs/msg/PoseStamped`.
        qos: what its publisher offers and its subscribers ask for.
        rate_hz: how often it is published; 0: when something happens.
        doc: its content.
    """

    name: str
    typename: str
    qos: Qos
    rate_hz: float
    doc: str


MOCAP_POSE = TopicSpec(
    "/mocap/pose",
    "geometry_msgs/msg/PoseStamped",
    SENSOR,
    30.0,
    "pose of base_link in map as the motion capture sees it; stamp: capture",
)
IMU = TopicSpec(
    "/imu/data_raw",
    "sensor_msgs/msg/Imu",
    SENSOR,
    1000.0,
    "gyro and accelerometer; stamp: capture",
)
BATTERY = TopicSpec("/battery", "sensor_msgs/msg/BatteryState", SENSOR, 10.0, "of the vehicle")
ROTOR_COMMAND = TopicSpec(
    "/rotor_command",
    "tombo_msgs/msg/RotorSpeeds",
    SENSOR,
    1000.0,
    "commanded rotor speeds; stamp: capture of the gyro sample used for them",
)
ODOMETRY = TopicSpec(
    "/odometry",
    "nav_msgs/msg/Odometry",
    STATE,
    250.0,
    "estimate; stamp: of its newest gyro sample",
)
ESTIMATOR_STATUS = TopicSpec(
    "/estimator/status", "tombo_msgs/msg/EstimatorStatus", STATE, 50.0, "biases, use of the poses"
)
MISSION_SETPOINT = TopicSpec(
    "/mission/setpoint", "tombo_msgs/msg/PositionSetpoint", STATE, 50.0, "set point of the mission"
)
SETPOINT = TopicSpec(
    "/setpoint",
    "tombo_msgs/msg/PositionSetpoint",
    STATE,
    50.0,
    "set point of the controller: the mission's, or x_r after a collision",
)
ATTITUDE_SETPOINT = TopicSpec(
    "/attitude_setpoint", "tombo_msgs/msg/AttitudeSetpoint", STATE, 50.0, "of the position loop"
)
RATES_SETPOINT = TopicSpec(
    "/rates_setpoint", "tombo_msgs/msg/RatesSetpoint", STATE, 250.0, "of the attitude loop"
)
GOAL_POSE = TopicSpec(
    "/goal_pose",
    "geometry_msgs/msg/PoseStamped",
    STATE,
    0.0,
    "where to fly and hold, in map: RViz's arrow, nav2; a z of 0 keeps the height",
)
MISSION_STATUS = TopicSpec(
    "/mission/status", "tombo_msgs/msg/MissionStatus", STATUS, 0.0, "phase, at each change"
)
COLLISION_EVENT = TopicSpec(
    "/collision_event", "tombo_msgs/msg/CollisionEvent", EVENT, 0.0, "a detected collision"
)
CONTACT_EVENT = TopicSpec(
    "/contact_event",
    "tombo_msgs/msg/CollisionEvent",
    EVENT,
    0.0,
    "a collision that the controller has seen in the IMU",
)
DETECTOR_STATUS = TopicSpec(
    "/detector/status",
    "tombo_msgs/msg/DetectorStatus",
    STATE,
    30.0,
    "test statistic of each pose; its arrival shows that the detector runs",
)
REACTION_STATUS = TopicSpec(
    "/reaction/status", "tombo_msgs/msg/ReactionStatus", STATUS, 0.0, "at each change"
)
PX4_STATUS = TopicSpec(
    "/px4/status",
    "tombo_msgs/msg/Px4Status",
    STATUS,
    0.0,
    "mode, armed, landed, stage of the bridge, findings of its checks, at each change",
)
MARKERS = TopicSpec(
    "/markers",
    "visualization_msgs/msg/MarkerArray",
    EVENT,
    0.0,
    "obstacle, discs, x_c, x_r, for RViz and Foxglove",
)
TF = TopicSpec(
    "/tf",
    "tf2_msgs/msg/TFMessage",
    STATE,
    50.0,
    "map to odom to base_link (REP-105), the estimate",
)
TRUE_ODOMETRY = TopicSpec(
    "/ground_truth/odometry", "nav_msgs/msg/Odometry", SENSOR, 250.0, "true pose and twist"
)
TRUE_ROTORS = TopicSpec(
    "/ground_truth/rotors", "tombo_msgs/msg/RotorState", SENSOR, 250.0, "true state of the rotors"
)
TRUE_CONTACT = TopicSpec(
    "/ground_truth/contact",
    "tombo_msgs/msg/Contact",
    SENSOR,
    0.0,
    "each tick with a touch, and the first one after",
)
DIAGNOSTICS = TopicSpec(
    "/diagnostics",
    "diagnostic_msgs/msg/DiagnosticArray",
    STATE,
    1.0,
    "health of each node: loop rates, jitter, ages, faults",
)
CLOCK = TopicSpec(
    "/clock", "rosgraph_msgs/msg/Clock", Qos(1, "best_effort"), 250.0, "simulated time"
)

TOPICS: dict[str, TopicSpec] = {
    spec.name: spec for spec in tuple(globals().values()) if isinstance(spec, TopicSpec)
}
"""All topics by name. `/clock` is published with `use_sim_time` only."""

POSE_TYPES: dict[str, tuple[str, str]] = {
    "geometry_msgs/msg/PoseStamped": ("pose.position", "pose.orientation"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose.pose.position", "pose.pose.orientation"),
    "geometry_msgs/msg/TransformStamped": ("transform.translation", "transform.rotation"),
    "nav_msgs/msg/Odometry": ("pose.pose.position", "pose.pose.orientation"),
}
"""Types that hold one stamped pose: where its position and its quaternion stand."""

"""Each type of message that drivers publish gives the same pose of the same body."""

from types import SimpleNamespace as Message

import numpy as np
import pytest

from tombo_dynamics.errors import InputError
from tombo_mocap.sources import bodies_of_message

_P, _Q = Message(x=1.0, y=2.0, z=3.0), Message(x=0.0, y=0.0, z=0.6, w=0.8)
_HEADER = Message(stamp=5)
_POSE = Message(position=_P, orientation=_Q)
_TRANSFORM = Message(translation=_P, rotation=_Q)
_MESSAGES = {
    "geometry_msgs/msg/PoseStamped": Message(header=_HEADER, pose=_POSE),
    "geometry_msgs/msg/PoseWithCovarianceStamped": Message(
        header=_HEADER, pose=Message(pose=_POSE)
    ),
    "nav_msgs/msg/Odometry": Message(
        header=_HEADER, child_frame_id="tombo", pose=Message(pose=_POSE)
    ),
    "geometry_msgs/msg/TransformStamped": Message(
        header=_HEADER, child_frame_id="tombo", transform=_TRANSFORM
    ),
    "tf2_msgs/msg/TFMessage": Message(
        transforms=[Message(header=_HEADER, child_frame_id="tombo", transform=_TRANSFORM)]
    ),
    "motion_capture_tracking_interfaces/msg/NamedPoseArray": Message(
        header=_HEADER, poses=[Message(name="tombo", pose=_POSE)]
    ),
    "mocap4r2_msgs/msg/RigidBodies": Message(
        header=_HEADER, rigidbodies=[Message(rigid_body_name="tombo", pose=_POSE)]
    ),
}


@pytest.mark.parametrize("typename", _MESSAGES)
def test_every_type_gives_the_pose(typename):
    (body,) = bodies_of_message(typename, int)(_MESSAGES[typename])
    assert body.stamp_ns == 5
    assert body.name in ("tombo", "")
    np.testing.assert_array_equal(body.position, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(body.attitude, [0.0, 0.0, 0.6, 0.8])


def test_a_type_without_poses_is_refused_with_those_that_have():
    with pytest.raises(InputError, match=r"Imu; accepted: geometry_msgs/msg/PoseStamped"):
        bodies_of_message("sensor_msgs/msg/Imu", int)

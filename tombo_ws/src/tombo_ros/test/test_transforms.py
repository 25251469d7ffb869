"""The estimate as ROS has it on /tf: the chain of REP-105, read by the class of tf2_msgs."""

from types import SimpleNamespace

import numpy as np
from rclpy.serialization import deserialize_message
from tf2_msgs.msg import TFMessage

from tombo_bag.topics import TF
from tombo_ros.conversion import array, to_ns
from tombo_ros.transforms import TransformPublisher

STAMP_NS = 1_700_000_000_123_456_789


def test_the_chain_goes_from_map_by_odom_to_the_body():
    sent = {}
    output = SimpleNamespace(publish=sent.setdefault(TF.name, []).append)
    publisher = TransformPublisher(output)
    position, attitude = np.array([1.0, -2.0, 3.0]), np.array([0.5, -0.5, 0.5, -0.5])
    publisher.send(STAMP_NS - 1, -position, -attitude)
    publisher.send(STAMP_NS, position, attitude)
    to_odom, to_body = deserialize_message(sent["/tf"][-1], TFMessage).transforms
    assert [(t.header.frame_id, t.child_frame_id) for t in (to_odom, to_body)] == [
        ("map", "odom"),
        ("odom", "base_link"),
    ]
    assert to_ns(to_odom.header.stamp) == to_ns(to_body.header.stamp) == STAMP_NS
    assert array(to_odom.transform.translation).tolist() == [0.0, 0.0, 0.0]
    assert array(to_odom.transform.rotation).tolist() == [0.0, 0.0, 0.0, 1.0]
    np.testing.assert_array_equal(array(to_body.transform.translation), position)
    np.testing.assert_array_equal(array(to_body.transform.rotation), attitude)

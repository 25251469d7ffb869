"""The estimate on `/tf`, by REP-105: `map` → `odom` → `base_link`."""

from __future__ import annotations

from tombo_bag.columnar_cdr import lay_in, lay_in_times, layout
from tombo_bag.message_codec import CONSTANTS
from tombo_bag.topics import TF
from tombo_dynamics.arrays import Array
from tombo_ros.topic import TopicPublisher


class TransformPublisher:
    """Publishes a pose of base_link in map as transforms."""

    def __init__(self, out: TopicPublisher) -> None:
        """Lay out the message that `out`, of `/tf`, sends."""
        self._out = out
        self._message = layout(TF.typename, CONSTANTS[TF.typename]).records(1)

    def send(self, stamp_ns: int, position: Array, attitude: Array) -> None:
        """Publish position (3) [m] and attitude (4, xyzw, map from base_link) of a time."""
        lay_in_times(self._message, "transforms[0].header.stamp", stamp_ns)
        lay_in_times(self._message, "transforms[1].header.stamp", stamp_ns)
        lay_in(self._message, "transforms[1].transform.translation", position)
        lay_in(self._message, "transforms[1].transform.rotation", attitude)
        self._out.publish(self._message.tobytes())

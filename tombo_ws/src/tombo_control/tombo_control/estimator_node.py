"""The estimator as a node: IMU and mocap poses in, odometry out, and the vehicle's discs."""

from __future__ import annotations

from typing import Any

from tombo_bag.markers import disc_markers
from tombo_bag.topics import MARKERS, ODOMETRY, TF
from tombo_control.estimator import nearest_tick
from tombo_control.estimator_core import EstimatorCore
from tombo_dynamics.rotation import rotate_vector
from tombo_ros.core_node import CoreNode, main_of
from tombo_ros.pacing import ESTIMATOR
from tombo_ros.transforms import TransformPublisher

_TF_TICKS, _DISC_TICKS = 20, 100


class EstimatorNode(CoreNode):
    """Hosts `EstimatorCore`: some four gyro samples a run, each in its turn.

    The controller carries the estimate on with its own gyro, so 4 ms more cost nothing. A wake for
    each sample would cost a tenth of a core.
    """

    def __init__(self) -> None:
        """Advertise what is drawn."""
        super().__init__(EstimatorCore, priority=ESTIMATOR)
        self._markers = self.advertise(MARKERS)
        self._transforms = TransformPublisher(self.advertise(TF))
        self._hubs = self.records["vehicle"].rotor_positions()

    def on_published(self, topic: str, message: Any) -> None:
        """Publish the transform and the discs of an estimate now and then."""
        if topic != ODOMETRY.name:
            return
        tick = nearest_tick(message.stamp_ns)
        if tick % _TF_TICKS == 0:
            self._transforms.send(message.stamp_ns, message.position, message.attitude)
        if tick % _DISC_TICKS == 0:
            hubs = [message.position + rotate_vector(message.attitude, hub) for hub in self._hubs]
            radius = self.records["vehicle"].rotor_radius
            self._markers.publish(disc_markers(message.stamp_ns, hubs, message.attitude, radius))


main = main_of(EstimatorNode)

if __name__ == "__main__":
    main()

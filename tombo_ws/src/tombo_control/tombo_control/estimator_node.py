"""The estimator as a node: IMU and mocap poses in, odometry out, and /tf."""

from __future__ import annotations

from typing import Any

from tombo_bag.topics import ODOMETRY, TF
from tombo_control.estimator import nearest_tick
from tombo_control.estimator_core import EstimatorCore
from tombo_ros.core_node import CoreNode, main_of
from tombo_ros.pacing import ESTIMATOR
from tombo_ros.transforms import TransformPublisher

_TF_TICKS = 20


class EstimatorNode(CoreNode):
    """Hosts `EstimatorCore`: some four gyro samples a run, each in its turn.

    The controller carries the estimate on with its own gyro, so 4 ms more cost nothing. A wake for
    each sample would cost a tenth of a core.
    """

    def __init__(self) -> None:
        """Advertise the transforms."""
        super().__init__(EstimatorCore, priority=ESTIMATOR)
        self._transforms = TransformPublisher(self.advertise(TF))

    def on_published(self, topic: str, message: Any) -> None:
        """Publish the transform of an estimate now and then."""
        if topic == ODOMETRY.name and nearest_tick(message.stamp_ns) % _TF_TICKS == 0:
            self._transforms.send(message.stamp_ns, message.position, message.attitude)


main = main_of(EstimatorNode)

if __name__ == "__main__":
    main()

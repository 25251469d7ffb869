"""The detector as a node: mocap poses in; collisions and a status of each pose out."""

from __future__ import annotations

from tombo_collision.detector_core import DetectorCore
from tombo_ros.core_node import CoreNode, main_of
from tombo_ros.pacing import COLLISION

main = main_of(lambda: CoreNode(DetectorCore, rate_hz=200.0, priority=COLLISION))

if __name__ == "__main__":
    main()

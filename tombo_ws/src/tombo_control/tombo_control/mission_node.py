"""The mission as a node: flies its plan on the estimate, and follows the reaction's decisions."""

from __future__ import annotations

from tombo_control.mission_core import MissionCore
from tombo_ros.core_node import CoreNode, main_of
from tombo_ros.pacing import MISSION

main = main_of(lambda: CoreNode(MissionCore, priority=MISSION))

if __name__ == "__main__":
    main()

"""The mission as a node: flies its plan on the estimate, and follows the reaction's decisions."""

from __future__ import annotations

from tombo_bag.topics import PX4_STATUS
from tombo_control.mission_core import MissionCore
from tombo_ros.core_node import CoreNode, main_of
from tombo_ros.pacing import MISSION


class MissionNode(CoreNode):
    """Hosts `MissionCore`, and hands it PX4's status."""

    core: MissionCore

    def __init__(self) -> None:
        """Listen to PX4's status."""
        super().__init__(MissionCore, priority=MISSION)
        self._px4_status = self.subscribe(PX4_STATUS)

    def step_core(self, now_ns: int) -> None:
        """Take PX4's status, then step."""
        for arrival in self._px4_status.take():
            self.core.vehicle_status = arrival.message
        super().step_core(now_ns)


main = main_of(MissionNode)

if __name__ == "__main__":
    main()

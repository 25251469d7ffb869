"""The controller as a node: rates at 1000 Hz on the gyro, attitude at 250, position at 50 Hz."""

from __future__ import annotations

from typing import Any

from tombo_bag.topics import ATTITUDE_SETPOINT, IMU, RATES_SETPOINT, ROTOR_COMMAND
from tombo_control.controller_core import ControllerCore
from tombo_control.estimator import nearest_tick
from tombo_control.params import ATTITUDE_TICKS, POSITION_TICKS, RATE_TICKS
from tombo_control.safety.state_machine import ROTORS_OFF
from tombo_ros.core_node import CoreNode, main_of
from tombo_ros.loop_statistics import LoopStatistics
from tombo_ros.pacing import CONTROLLER

_LOOPS = {
    ROTOR_COMMAND.name: ("rate loop", RATE_TICKS),
    ATTITUDE_SETPOINT.name: ("position loop", POSITION_TICKS),
    RATES_SETPOINT.name: ("attitude loop", ATTITUDE_TICKS),
}
"""What each loop publishes, its name and its period [ms]."""


class ControllerNode(CoreNode):
    """Hosts `ControllerCore`, which answers each gyro sample, and counts the runs of its loops."""

    def __init__(self) -> None:
        """Follow the gyro."""
        super().__init__(ControllerCore, priority=CONTROLLER, follows=IMU.name)
        self.loops |= {name: LoopStatistics() for name, _ in _LOOPS.values()}
        self.core: ControllerCore
        self._slots: dict[str, int] = {}

    def step_core(self, now_ns: int) -> None:
        """Step the core; loops that rest while the rotors are off miss nothing."""
        super().step_core(now_ns)
        if int(self.core.memory.watch.state) in ROTORS_OFF:
            self._slots.clear()

    def on_published(self, topic: str, message: Any) -> None:
        """Count a run; what lies between its slot and the last one's was missed."""
        if topic not in _LOOPS or self.lockstep:
            return
        loop, period = _LOOPS[topic]
        slot = nearest_tick(message.stamp_ns) // period
        last, self._slots[loop] = self._slots.get(loop, slot - 1), slot
        self.loops[loop].ran(self.step_ns, self.late_ns, max(slot - last - 1, 0))


main = main_of(ControllerNode)

if __name__ == "__main__":
    main()

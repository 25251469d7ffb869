"""The smallest node: says when its loop runs, and passes on what it hears."""

import sys

from rosgraph_msgs.msg import Clock

from tombo_bag.qos import Qos
from tombo_bag.topics import TopicSpec
from tombo_control.params import EstimatorParams
from tombo_ros.conversion import to_time
from tombo_ros.node_loop import LoopNode, run

STEPS = TopicSpec("/steps", "rosgraph_msgs/msg/Clock", Qos(5000), 0.0, "time of each run")
POKE = TopicSpec("/poke", "rosgraph_msgs/msg/Clock", Qos(100), 0.0, "heard by the node")
ECHO = TopicSpec("/echo", "rosgraph_msgs/msg/Clock", Qos(100), 0.0, "what was heard")


class TinyNode(LoopNode):
    def __init__(self) -> None:
        super().__init__("tiny", 100.0, {"estimator": EstimatorParams()})
        self._steps = self.advertise(STEPS)
        self._echo = self.advertise(ECHO)
        self._poke = self.subscribe(POKE)

    def step(self, now_ns: int) -> None:
        self._steps.publish(Clock(clock=to_time(now_ns)))
        for taken in self._poke.take():
            self._echo.publish(taken.message)


if __name__ == "__main__":
    sys.exit(run(TinyNode))

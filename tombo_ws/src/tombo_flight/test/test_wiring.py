"""The wiring as data, and its schedule: a message of a tick is there in the next one."""

from __future__ import annotations

import numpy as np

from tombo_bag.message_codec import dataclass_of
from tombo_bag.topics import TOPICS
from tombo_dynamics.core import Core, CoreRunner
from tombo_dynamics.messages import Imu, RotorSpeeds, neutral
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_flight.run_wiring import run_cores
from tombo_flight.scenario import load_scenario, world_of
from tombo_sim.ground_truth import FlightEndDetector
from tombo_sim.simulator import Simulator

IMU, COMMAND, ODOMETRY = "/imu/data_raw", "/rotor_command", "/odometry"


class Relay(Core):
    """Publishes the time at which each message came."""

    name = "relay"
    inputs = (IMU,)
    outputs = (ODOMETRY,)
    period_ns = 1_000_000_000

    def __init__(self) -> None:
        super().__init__()
        self.taken: list[tuple[int, int]] = []
        self.steps: list[int] = []

    @classmethod
    def make(cls, records) -> Relay:
        return cls()

    def on(self, topic, message, now_ns) -> None:
        self.taken.append((message.stamp_ns, now_ns))

    def step(self, now_ns):
        self.steps.append(now_ns)
        return [(self.outputs[0], neutral(dataclass_of(TOPICS[self.outputs[0]].typename), now_ns))]


class Listener(Relay):
    name = "listener"
    inputs = (ODOMETRY,)
    outputs = ("/setpoint",)


class Slow(Listener):
    name = "slow"
    outputs = ("/mission/setpoint",)
    period_ns = 20_000_000
    steps_on_messages = False


def fly(*cores: Core, ticks: int = 50) -> list[str]:
    simulator = Simulator(world_of(load_scenario("hover")), 0)
    topics: list[str] = []
    run_cores(cores, simulator, ticks, FlightEndDetector(0.18), lambda t, m: topics.append(t))
    return topics


def test_sensors_arrive_in_their_tick_and_messages_in_the_next():
    relay, listener = Relay(), Listener()
    fly(listener, relay)
    assert [now - stamp for stamp, now in relay.taken] == [0] * 50
    assert [now - stamp for stamp, now in listener.taken] == [TICK_NS] * 49


def test_core_that_waits_for_its_period_takes_everything_then():
    slow = Slow()
    fly(Relay(), slow)
    assert [step - EPOCH_NS for step in slow.steps] == [0, 20 * TICK_NS, 40 * TICK_NS]
    assert len(slow.taken) == 40
    assert {now for _, now in slow.taken} == {EPOCH_NS + 20 * TICK_NS, EPOCH_NS + 40 * TICK_NS}


def test_messages_of_a_tick_are_handed_over_in_the_order_of_the_inputs():
    core = Relay()
    core.inputs = ("/setpoint", IMU)
    runner = CoreRunner(core)
    runner.take(IMU, neutral(Imu, 1))
    runner.take("/setpoint", neutral(dataclass_of(TOPICS["/setpoint"].typename), 2))
    runner.run(7)
    assert [stamp for stamp, _ in core.taken] == [2, 1]


def test_command_of_a_tick_acts_in_it():
    class Climb(Relay):
        outputs = (COMMAND,)

        def step(self, now_ns):
            return [(COMMAND, RotorSpeeds(now_ns, np.full(4, 700.0)))]

    scenario = load_scenario("hover")
    flown, alone = (Simulator(world_of(scenario), 0) for _ in range(2))
    run_cores([Climb()], flown, 30, FlightEndDetector(0.18), lambda topic, message: None)
    for _ in range(30):
        alone.advance(np.full(4, 700.0))
    assert np.array_equal(flown.imu, alone.imu)

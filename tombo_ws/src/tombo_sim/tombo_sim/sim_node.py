"""The simulator as a node, in place of PX4 and OptiTrack.

Gives mocap poses, IMU, battery and, under `ground_truth/`, ground truth; takes rotor speeds.
Without `use_sim_time` a tick of 1 ms takes a millisecond and stamps are the system's time; with it
the node drives `/clock`: faster, slower, paused, or in lockstep with the other nodes.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from tombo_bag.columnar_cdr import lay_in_times, layout
from tombo_bag.message_codec import CONSTANTS, MessageCodec
from tombo_bag.topics import (
    BATTERY,
    CLOCK,
    IMU,
    MISSION_STATUS,
    MOCAP_POSE,
    ROTOR_COMMAND,
    TopicSpec,
)
from tombo_dynamics.effects.downwash import jet_of, set_jets
from tombo_dynamics.errors import InputError
from tombo_dynamics.input_check import is_future
from tombo_dynamics.messages import Imu, Phase, RotorSpeeds
from tombo_dynamics.time_base import EPOCH_NS, SECOND_NS, TICK_HZ, TICK_NS
from tombo_ros.core_node import main_of
from tombo_ros.health import ERROR
from tombo_ros.lockstep import LockstepMaster, take_until
from tombo_ros.loop_statistics import LatenessHistogram
from tombo_ros.node_loop import LockstepError
from tombo_ros.topic import PolledSubscription
from tombo_sim.failsafe import Failsafe
from tombo_sim.ground_truth import FlightEndDetector
from tombo_sim.simulator import Simulator
from tombo_sim.vehicle_node import VehicleNode

_BATTERY_TICKS = 100
_CLOCK_TICKS = round(TICK_HZ / CLOCK.rate_hz)
_RESUME_NS = 100_000_000
"""Time with commands before the fail-safe hands over."""


class SimNode(VehicleNode):
    """One vehicle, its sensors, and the flight controller's fail-safe."""

    publishes_clock = True

    def __init__(self) -> None:
        """Declare parameters and set the vehicle on the ground.

        Raises:
            InputError: a parameter is refused, or the world can't be.
        """
        super().__init__()
        self._timeout_ns = SECOND_NS * self.declare(
            "command_timeout",
            0.05,
            "silence of rotor_command [s] after which the fail-safe lands the vehicle",
            bounds=(0.005, 5.0),
        )
        speed = self.declare(
            "speed",
            1.0,
            "with use_sim_time: how many times faster than the wall clock; 0 pauses",
            bounds=(0.0, 100.0),
            read_only=not self.sim_time,
        )
        if speed != 1.0 and not self.sim_time:
            raise InputError(f"speed: {speed:g}; accepted: 1 without use_sim_time")
        members = self.declare(
            "lockstep_nodes",
            ["estimator", "detector", "reaction", "mission", "controller"],
            "with lockstep: names of the nodes that take part",
        )
        self._duration = self.declare(
            "duration",
            0.0,
            "with lockstep: the flight ends then [s], or when it is decided; 0: never",
            bounds=(0.0, 86400.0),
        )
        self._warm_up()
        self._speed_max = 1.5 * self.world.vehicle.rotor_speed_max
        self.attach_simulator(Simulator(self.world, self.seed))
        self.failsafe = Failsafe(self.simulator, self.world.vehicle)
        self._ground = self.simulator.height
        self._commands = self.subscribe(ROTOR_COMMAND, depth=100)
        self._command = np.zeros(4)
        self._command_ns = self._resumed_ns = 0
        self._answered_ns = -1
        self._refused = 0
        self._latency = LatenessHistogram()
        self._began_ns = EPOCH_NS
        """Time of tick 0."""
        self._started = False
        self.others: list[SimNode] = []
        """Vehicles of the same room, whose downwash it feels."""
        self._master = LockstepMaster(self, members) if self.lockstep else None
        self._make_outputs()

    def _warm_up(self) -> None:
        """Load all compiled code now, that of the fail-safe too: not when it is needed."""
        spare = Simulator(self.world, 0)
        failsafe = Failsafe(spare, self.world.vehicle)
        failsafe.engage(0)
        for _ in range(2):
            spare.advance(failsafe.command)
            failsafe.observe(spare)

    def _make_outputs(self) -> None:
        self._imu_out = self.advertise(IMU)
        self._battery_out = self.advertise(BATTERY)
        self._battery = layout(BATTERY.typename, CONSTANTS[BATTERY.typename]).records(1)
        self._clock_out = self.advertise(CLOCK) if self.sim_time else None
        self._clock_message = layout(CLOCK.typename, {}).records(1)
        self._codecs = {s.name: MessageCodec(s.typename) for s in (MISSION_STATUS, ROTOR_COMMAND)}

    def begin(self) -> None:
        """Show the obstacle, then fly."""
        self.publish_obstacle(self.stamp_ns)
        self._set_period()
        super().begin()

    @property
    def stamp_ns(self) -> int:
        """Time of the present tick."""
        return self._began_ns + self.simulator.tick * TICK_NS

    def now_ns(self) -> int:
        """Return the flight's time."""
        return self.stamp_ns if self.sim_time else time.time_ns()

    def on_parameters_changed(self, name: str) -> None:
        """Change the speed."""
        if name == "speed":
            self._set_period()

    def _set_period(self) -> None:
        speed = float(self.parameters.get("speed"))
        self.period_ns = round(TICK_NS / speed) if speed > 0.0 else TICK_NS

    def step(self, now_ns: int) -> None:
        """Go on by one tick, if time does not stand still."""
        self._take_commands()
        if not self._started:
            self._start(now_ns)
            return
        if float(self.parameters.get("speed")) == 0.0:
            self._publish_clock()
            return
        self._feel_others()
        self.simulator.advance(self._select_command(now_ns))
        self.failsafe.observe(self.simulator)
        self._publish()

    def _start(self, now_ns: int) -> None:
        """Publish tick 0; in real time its time is now, once the other nodes are there."""
        if not self.sim_time:
            if not self.others_ready(now_ns):
                return
            self._began_ns = now_ns // 1000 * 1000
            self.shift_ns = self.late_ns  # time before the flight is not caught up
        self._started = True
        self._publish()

    def _feel_others(self) -> None:
        plants = [other.simulator.plant for other in self.others]
        set_jets(self.simulator.plant, [jet_of(plant.state, plant) for plant in plants])

    def lockstep_ticks(self, alone: bool) -> Iterator[bool]:
        """Fly tick by tick, each with the answers of all nodes, until the flight is over.

        Other vehicles are seen as of the tick before: all come to each `yield` before one goes on.

        Raises:
            LockstepError: a node is not there, or does not answer.
        """
        master = self._master
        assert master is not None
        self._wait_for_nodes(master)
        phases = self.subscribe(MISSION_STATUS)
        flight_end = FlightEndDetector(self.world.vehicle.leg_height)
        phase, command = Phase.IDLE, np.zeros(4)
        end = round(self._duration * SECOND_NS / TICK_NS) or 2**62
        simulator = self.simulator
        while simulator.tick < end and not self.stopping:
            seen = {
                f"/{other.ros.get_namespace()}{MOCAP_POSE.name}": other.poses_sent
                for other in self.others
            }
            yield False
            self._publish()
            over_s = flight_end.watch(simulator.height, simulator.upright, phase)
            if over_s is not None:
                end = min(end, simulator.tick + round(over_s * SECOND_NS / TICK_NS))
            master.run_tick(self.stamp_ns, self._sent() | seen, self._idle)
            for received in self._take_answers(master, MISSION_STATUS, phases):
                phase = int(received.phase)
            for received in self._take_answers(master, ROTOR_COMMAND, self._commands):
                command = np.array(received.speed)
            self._feel_others()
            yield False
            simulator.advance(command)
            self._idle()
        if not self.stopping:
            master.run_tick(self.stamp_ns, self._sent(), self._idle, last=True)

    def _wait_for_nodes(self, master: LockstepMaster) -> None:
        end = time.monotonic() + self.start_patience_s
        while master.missing and not self.stopping:
            if time.monotonic() > end:
                raise LockstepError(
                    f"lockstep: {', '.join(master.missing)} not ready after "
                    f"{self.start_patience_s:g} s; accepted: nodes started with lockstep:=true"
                )
            self._idle()
            time.sleep(0.05)

    def _sent(self) -> dict[str, int]:
        """Return how many messages of each topic were published."""
        return {publisher.spec.name: publisher.sent for publisher in self._publishers}

    def _take_answers(
        self, master: LockstepMaster, spec: TopicSpec, source: PolledSubscription
    ) -> list[Any]:
        """Return the messages of the nodes on a topic in this tick."""
        count = master.published.get(spec.name, 0)
        if count == source.taken:
            return []
        codec = self._codecs[spec.name]
        answers = take_until(self, "sim", spec.name, source, count, self.stamp_ns)
        return [codec.decode(received.message) for received in answers]

    def _idle(self) -> None:
        self.periodic_tasks(time.time_ns(), self.stamp_ns)

    def _take_commands(self) -> None:
        for sample in self._commands.take_raw():
            try:
                command: RotorSpeeds = self._codecs[ROTOR_COMMAND.name].decode(sample.message)
            except InputError:
                self._refuse("rotor_command has another shape or frame than base_link")
                continue
            stamp, speed = command.stamp_ns, command.speed
            if not all(0.0 <= value <= self._speed_max for value in speed.tolist()):
                self._refuse(f"rotor_command {speed.tolist()} rad/s is no command")
                continue
            if self._commands.multiple_publishers(time.time_ns()):
                self._refuse("two nodes command the rotors")
                continue
            if not self.sim_time:
                self._latency.add(sample.received_ns - stamp)
            elif is_future(stamp, self.stamp_ns):
                self._refuse("rotor_command is stamped in the future")
                continue
            if sample.received_ns - self._command_ns > self._timeout_ns:
                self._resumed_ns = sample.received_ns
            self._command, self._command_ns = speed, sample.received_ns
            self._answered_ns = max(stamp, self._answered_ns)

    def _refuse(self, text: str) -> None:
        self._refused += 1
        self.health.value("commands_refused", self._refused)
        self.health.report_event("command_refused", text, ERROR)

    def _command_timed_out(self, now_ns: int) -> bool:
        """Return whether commands are missing; simulated time that stands still misses none."""
        if now_ns - self._command_ns <= self._timeout_ns:
            return False
        return not self.sim_time or self.stamp_ns - self._answered_ns > self._timeout_ns

    def _select_command(self, now_ns: int) -> Any:
        """Return the command that acts: the one asked for, the fail-safe's, or none."""
        silent = self._command_timed_out(now_ns)
        airborne = self.simulator.height > self._ground + 0.1
        if self.failsafe.engaged:
            turns = not airborne or self._command.any()  # it does not let a vehicle fall
            if not silent and turns and now_ns - self._resumed_ns > _RESUME_NS:
                self.failsafe.release()
                self.health.fault("failsafe", False)
            else:
                return self.failsafe.command
        elif silent and airborne:
            self.failsafe.engage(self.simulator.tick)
            self.health.fault("failsafe", True, "no rotor_command: landing on its own", ERROR)
            return self.failsafe.command
        if silent:
            return np.zeros(4)
        return self._command

    def _publish(self) -> None:
        simulator, stamp = self.simulator, self.stamp_ns
        plant, tick = simulator.plant, simulator.tick
        self._imu_out.send(Imu(stamp, plant.gyro, plant.accel))
        self.publish_tick(self._began_ns)
        if tick % _BATTERY_TICKS == 0:
            lay_in_times(self._battery, "header.stamp", stamp)
            self._battery["voltage"] = plant.supply.voltage
            self._battery["current"] = -plant.supply.current
            self._battery_out.publish(self._battery.tobytes())
        if tick % _CLOCK_TICKS == 0:
            self._publish_clock()

    def _publish_clock(self) -> None:
        if self._clock_out is not None:
            lay_in_times(self._clock_message, "clock", self.stamp_ns)
            self._clock_out.publish(self._clock_message.tobytes())

    def report(self, now_ns: int) -> None:
        """Add what only the simulator can measure: gyro in to command out, across processes."""
        if self._latency.number:
            for share in (50, 99):
                value = self._latency.percentile_us(share / 100)
                self.health.value(f"latency_gyro_to_command_p{share}_us", value)
            largest = round(self._latency.largest_us, 1)
            self.health.value("latency_gyro_to_command_max_us", largest)
        self.health.value("commands", self._commands.received)
        super().report(now_ns)


main = main_of(SimNode)

if __name__ == "__main__":
    main()

"""The simulator that a real PX4 flies: Tombo's physics behind PX4's simulator link, in lockstep.

PX4 is the client of a TCP server, one at a time. Each HIL_SENSOR waits for the
HIL_ACTUATOR_CONTROLS with the same time; `time_usec` is PX4's clock.

    hil = HilSimulator(lambda: HilFlight(world, seed=0), port=4560, tell=log)
    while True:
        if hil.advance(time.monotonic_ns()):        # one step was flown
            ...
        else:
            hil.wait(time.monotonic_ns(), 0.1)      # or come back within a millisecond

`hil.flight.simulator.plant` has the truth, `hil.flight.time_us` PX4's clock.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.errors import InputError
from tombo_px4.hil.flight import COMPONENT, PX4_PORT, STEP_TICKS, SYSTEM, HilFlight, MotorCommands
from tombo_px4.link.mavlink_link import Link

BOOT_PATIENCE_NS = 5_000_000
"""Wait for an answer while PX4 boots; it answered from the tenth step on."""
PATIENCE_NS = 1_000_000_000
"""A missing answer is reported after this time; PX4 reports it after a second too."""
_SLIP_NS = 200_000_000
"""If it is behind by more, the simulation does not catch up."""


class Px4Phase(Enum):
    """State of the connection to PX4."""

    WAITING = "waiting for PX4"
    BOOTING = "PX4 boots"
    FLYING = "in lockstep"
    SILENT = "PX4 is silent"


Tell = Callable[[str, bool], object]
"""Takes a message for the user, and whether it is a warning."""


class HilSimulator:
    """Runs one flight after the other, one for each connection of PX4. Never blocks but in `wait`.

    Attributes:
        link: the server's side of PX4's connection.
        port: the one listened on.
        flight: the present one, or the one that waits for PX4.
        motors: commands of PX4.
        steps: HIL_SENSOR sent in this flight.
        boot_steps: steps unanswered before the first answer.
        missed: steps unanswered after it.
        wrong_time: answers with another time than the last HIL_SENSOR's.
        slips: how often the machine was too slow for `speed`.
        flights: how many have begun.
    """

    def __init__(
        self,
        begin: Callable[[], HilFlight],
        port: int = PX4_PORT,
        speed: float = 1.0,
        tell: Tell = lambda text, severe: None,
    ) -> None:
        """Listen on this machine, and set the vehicle on the ground.

        Args:
            begin: returns a new flight; called for each connection of PX4.
            port: where PX4 connects; 0 takes a free one.
            speed: simulated time against that of `advance`; 0: as fast as possible.
            tell: called with the news.

        Raises:
            InputError: the port is taken or not allowed; as `begin`.
        """
        if not 0 <= port <= 65535:
            raise InputError(f"port {port} is out of bounds; accepted: 0 to 65535")
        self._begin, self._tell = begin, tell
        self._period_ns = round(1e6 * STEP_TICKS / speed) if speed > 0.0 else 0
        self.flights = 0
        self._reset_vehicle()
        # PX4's messages carry the simulation's time: their arrival is not read.
        url, clock = f"tcpin://127.0.0.1:{port}", lambda: 0
        self.link = Link(url, system=SYSTEM, component=COMPONENT, clock=clock)
        self.port = self.link.address[1] if self.link.address else port

    def close(self) -> None:
        """Close the port."""
        self.link.close()

    def _reset_vehicle(self) -> None:
        """Put a new vehicle on the ground."""
        self.flight = self._begin()
        self.motors = MotorCommands()
        self.steps = self.boot_steps = self.missed = 0
        self.wrong_time = self.slips = 0
        self._connection = 0  # value of `link.opened` for the present client; 0: none
        self._sent_ns = self._due_ns = 0
        self._has_answer = True  # to the step before the first one
        self._heard = self._silent = False
        self._runs_unanswered = False  # silent and disarmed; over with any answer, a late one too

    @property
    def phase(self) -> Px4Phase:
        """State of the connection to PX4."""
        if not self._connection:
            return Px4Phase.WAITING
        if self._silent:
            return Px4Phase.SILENT
        return Px4Phase.FLYING if self._heard else Px4Phase.BOOTING

    def advance(self, now_ns: int) -> bool:
        """Take what PX4 has sent, and fly one step if it is answered and due.

        Args:
            now_ns: time of a clock that never goes back; only its differences count.

        Returns:
            whether a step was flown: there may be another one to fly at once.
        """
        answers = self._receive()
        same = self.link.connected and self.link.opened == self._connection
        if self._connection and not same:
            self._on_disconnect()
        if not self.link.connected:
            return False
        if not self._connection:
            self.flights += 1
            self._connection = self.link.opened
            self._due_ns = now_ns
            begins = f"flight {self.flights} begins, at time 0, on the ground"
            self._tell(f"PX4 has connected: {begins}", False)
        for answer in answers:
            self._take(answer)
        if now_ns < self._next_ns(now_ns):
            return False
        self._step(now_ns)
        return True

    def _receive(self) -> list[MotorCommands]:
        """Return the actuator controls received since the last call, the oldest first.

        If a new client has connected meanwhile, nothing is returned: the commands may be those of
        the PX4 before it.
        """
        connections, answers = self.link.opened, []
        for message in (received.message for received in self.link.receive()):
            if message.get_msgId() == mav.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS:
                armed = bool(message.mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)
                controls = tuple(message.controls[:4])
                answers.append(MotorCommands(controls, armed, int(message.time_usec)))
        return answers if self.link.opened == connections else []

    def wait(self, now_ns: int, longest_s: float) -> None:
        """Sleep until there is something to do, or `longest_s` is over."""
        timeout_s = longest_s
        if self._connection:
            timeout_s = min(1e-9 * (self._next_ns(now_ns) - now_ns), longest_s)
        self.link.wait(timeout_s)

    def _next_ns(self, now_ns: int) -> int:
        """Return when the next step is flown if nothing more comes."""
        if self._has_answer:
            return self._due_ns
        patience = PATIENCE_NS if self._heard and not self._runs_unanswered else BOOT_PATIENCE_NS
        return max(self._sent_ns + patience, self._due_ns)

    def _on_disconnect(self) -> None:
        """Report the end of a flight, and wait for the next client with a new vehicle."""
        how = "armed" if self.motors.armed else "not armed"
        height = self.flight.simulator.height
        self._tell(
            f"PX4 has left at {1e-6 * self.flight.time_us:.2f} s ({how}, {height:.2f} m up): that "
            "flight is over; waiting for a new connection, which begins a new one",
            self.motors.armed,
        )
        self._reset_vehicle()

    def _take(self, answer: MotorCommands) -> None:
        """Use an answer if it belongs to the last HIL_SENSOR; count it otherwise."""
        if self.steps == 0:  # to a step of a flight that is over
            self.wrong_time += 1
            return
        self._runs_unanswered = False
        if not self._heard:
            self._heard = True
            self._tell(
                f"PX4 answers, after {self.boot_steps} steps without; in lockstep from now", False
            )
        if answer.time_us != self.flight.time_us:
            self.wrong_time += 1
            return
        if answer.armed != self.motors.armed:
            self._tell("armed" if answer.armed else "disarmed", False)
        self.motors = answer
        if self._has_answer:
            return
        self._has_answer = True
        if self._silent:
            self._silent = False
            self._tell("PX4 answers again", False)

    def _step(self, now_ns: int) -> None:
        """Fly one step with the commands of PX4, and send the sensor samples."""
        if not self._has_answer:
            self._handle_missing_answer()
        self._pace(now_ns)
        self.link.send_frames(self.flight.step(self.motors))
        self._sent_ns = now_ns
        self._has_answer = False
        self.steps += 1

    def _handle_missing_answer(self) -> None:
        """Count a step without an answer.

        An armed PX4 that is stopped in a debugger must not miss much time, so the simulation runs
        at one step a second. (If it waited for ever, one lost answer would stop both.) While PX4
        is disarmed the simulation goes on: in OFFBOARD without a stream of set points PX4 sends no
        controls, and it could not leave that state without time.
        """
        if not self._heard:
            self.boot_steps += 1
            return
        self.missed += 1
        self._runs_unanswered = not self.motors.armed
        if not self._silent:
            self._silent = True
            goes = "time stands still but for a step a second"
            if not self.motors.armed:
                goes = "disarmed, so time goes on (in OFFBOARD it is silent until set points come)"
            self._tell(
                f"PX4 has not answered for {1e-9 * PATIENCE_NS:.0f} s at "
                f"{1e-6 * self.flight.time_us:.2f} s: {goes}",
                True,
            )

    def _pace(self, now_ns: int) -> None:
        """Set when the next step is due."""
        if self._period_ns == 0:
            return
        self._due_ns += self._period_ns
        if not self._has_answer:  # the simulation has waited for PX4: it does not catch up
            self._due_ns = now_ns + self._period_ns
        elif now_ns - self._due_ns > _SLIP_NS:
            self._due_ns = now_ns + self._period_ns
            self.slips += 1
            if self.slips == 1:
                self._tell("slower than wanted: time stretches", True)

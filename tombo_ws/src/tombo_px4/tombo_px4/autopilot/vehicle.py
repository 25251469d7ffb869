"""The Tombo vehicle behind an autopilot that behaves as PX4 does; no MAVLink, all ENU and FLU."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np

from tombo_control.autopilot import EstimatedState, new_autopilot
from tombo_control.params import POSITION_TICKS, ControlParams, EstimatorParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import yaw_of
from tombo_dynamics.time_base import TICK_HZ, TICK_S
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.autopilot.commander import (
    DESCEND,
    TERMINATE,
    BatteryCharge,
    BatteryMeter,
    Commander,
    CommanderInput,
    LandDetector,
    TakeoffState,
)
from tombo_px4.autopilot.ekf2_model import Ekf2Model
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.setpoint_controller import (
    ControlLevel,
    Navigator,
    OffboardSetpoint,
    SetpointController,
    finite_or_nan,
    refusal_of,
)
from tombo_px4.modes import (
    ALTCTL,
    AUTO_HOLD,
    AUTO_LAND,
    AUTO_RTL,
    AUTO_TAKEOFF,
    MANUAL,
    OFFBOARD,
    STABILIZED,
    MavLandedState,
    Mode,
    Result,
    Severity,
)
from tombo_sim.simulator import Simulator
from tombo_sim.world import World

_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
_CLIMB_WANTED = 0.1
"""[m]: a set point this far above a standing vehicle means that it shall take off."""
_TAKEOFF_TICKS = 500
"""A take-off counts after this time."""
_DESCENT_SPEED = -0.1
"""[m/s]: a set point that sinks faster may be meant to land."""
_FORCE_GAIN = 0.065
"""Share of a new specific force: 0.3 s at 50 Hz."""
_RAMP_BELOW = GRAVITY / 4.0
"""[m/s]: start of the ramp of a take-off below 0 (PX4: with MPC_Z_VEL_P_ACC of 4): a standing
vehicle is held down for the first part of it."""
_DETECTED_SHARE = 0.45
"""Share of that part after which PX4 1.17 said "Takeoff detected": 1.9 s after arming."""
_STANDS_BELOW, _STANDS_AT_ONCE_BELOW, _CARRIED = 0.8, 0.3, 0.97
"""Share of the hover thrust at which a vehicle that sinks, or does not, is held by the ground;
specific force over gravity of one that descends level."""
_CLIMB_MAX, _SLIDE_MAX, _TURN_MAX = 0.25, 1.5, math.radians(20.0)
"""Fastest motion [m/s], [rad/s] of a vehicle that stands: defaults of LNDMC_*."""
_MAX_STATUS_TEXTS = 64
_FARTHEST = 1e5
"""[m]: a farther position is refused as a mistake."""
_CLIMB_DAMPING = 0.3
"""[s/m]: share of the hover thrust against each m/s, in altitude mode."""
_FALL_TICKS = 2000
"""A vehicle whose rotors were stopped in the air is down after this."""


class Px4Vehicle:
    """One vehicle with its autopilot. `step` is a millisecond."""

    def __init__(self, world: World, seed: int, parameters: ParameterTable) -> None:
        """Set the vehicle on the ground, at tick 0.

        Args:
            world: vehicle, propeller, effects and obstacle.
            seed: all randomness derives from it.
            parameters: of the autopilot; shared, changes act at once.

        Raises:
            InputError: as `Simulator`.
        """
        self.simulator = Simulator(world, seed)
        self.parameters = parameters
        self.hand: Callable[[Simulator], None] | None = None
        """Moves the vehicle, before the samples of a tick are taken: `HandMotion`."""
        self._vehicle = world.vehicle
        self._autopilot = new_autopilot(
            ControlParams(), EstimatorParams(), world.vehicle, np.zeros(3), _LEVEL
        )
        self.ekf2_model = Ekf2Model(self._autopilot, self.simulator, parameters, seed)
        maps = self.simulator.setup.maps
        self._controller = SetpointController(self._autopilot, maps, parameters)
        parameters.set_vehicle_default("MPC_THR_HOVER", self._controller.hover)
        self._commander = Commander(parameters, self._say)
        self._navigator = Navigator(parameters)
        self._ground = LandDetector()
        self._status_texts: deque[tuple[Severity, str]] = deque(maxlen=_MAX_STATUS_TEXTS)
        self._signal_tick = -1
        self._signal_kind = ControlLevel.POSITION
        self._target: OffboardSetpoint | None = None
        self._refused = ""
        self._followed: OffboardSetpoint | None = None
        self._home: Array | None = None
        self.takeoff_state = TakeoffState.DISARMED
        """How far a take-off has come."""
        self._armed_tick = self._ramp_tick = 0
        self._wanted_tick: int | None = None
        self._airborne_tick = -(10**9)
        self._taken_off = False
        self._force = 1.0
        self._tested = (0, 0)
        self._meter = BatteryMeter(world.vehicle.battery_voltage, parameters)
        self.battery = BatteryCharge(world.vehicle.battery_voltage, 0.0, 1.0, 0)

    # --- what it is

    @property
    def tick(self) -> int:
        """The present millisecond."""
        return self.simulator.tick

    @property
    def boot_us(self) -> int:
        """Time since boot [us]."""
        return self.simulator.tick * 1000

    @property
    def estimate(self) -> EstimatedState:
        """The autopilot's estimate, at the present tick: a view."""
        state: EstimatedState = self._autopilot.state
        return state

    @property
    def armed(self) -> bool:
        """Whether the rotors may turn."""
        return self._commander.armed

    @property
    def mode(self) -> Mode:
        """The mode that is flown, as a heartbeat shows it."""
        mode = self._commander.mode
        return {DESCEND: AUTO_LAND, TERMINATE: MANUAL}.get(mode, mode)

    @property
    def failsafe(self) -> bool:
        """Whether another mode is flown than was asked for."""
        return self._commander.failsafe

    @property
    def killed(self) -> bool:
        """Whether the kill switch of the remote control is on."""
        return self._commander.killed_tick >= 0

    @property
    def landed(self) -> MavLandedState:
        """Where the vehicle is."""
        if self._ground.landed:
            return MavLandedState.ON_GROUND
        mode = self._commander.mode
        if mode == DESCEND or (mode in (AUTO_LAND, AUTO_RTL) and self._navigator.landing):
            return MavLandedState.LANDING
        if self.takeoff_state == TakeoffState.RAMPUP or mode == AUTO_TAKEOFF:
            return MavLandedState.TAKEOFF
        return MavLandedState.IN_AIR

    @property
    def problems(self) -> tuple[str, ...]:
        """What arming would be denied for, as texts for the operator."""
        return self._commander.problems(self.situation)

    @property
    def situation(self) -> CommanderInput:
        """Its state at the present tick."""
        tick, ekf2_model = self.tick, self.ekf2_model
        return CommanderInput(
            tick,
            ekf2_model.attitude_ok,
            ekf2_model.local_ok(tick),
            ekf2_model.global_ok(tick),
            self._ground.landed,
            self._ground.maybe_landed,
            self._taken_off,
            self._signal_tick,
            self._signal_kind,
            self.battery,
            ekf2_model.altitude_ok(tick),
        )

    @property
    def home(self) -> Array:
        """(3) where it was armed, in map [m]; before, where it is."""
        return self.estimate.position.copy() if self._home is None else self._home.copy()

    @property
    def attitude_setpoint(self) -> tuple[Array, Array, float]:
        """What attitude and rate loop follow.

        Attitude (4) xyzw, map from base_link; rates (3) base_link [rad/s]; share of the highest
        collective thrust.
        """
        setpoint = self._autopilot.setpoint
        thrust = float(setpoint.thrust) / self._controller.thrust_max
        return setpoint.attitude.copy(), setpoint.rates.copy(), thrust

    def take_status_texts(self) -> list[tuple[Severity, str]]:
        """Return severity and words of the messages to the operator since the last call."""
        texts = list(self._status_texts)
        self._status_texts.clear()
        return texts

    # --- what it is told

    def vision(self, boot_us: int, position: Array, attitude: Array) -> str:
        """Take a pose from outside.

        Args:
            boot_us: time of capture since boot.
            position: (3) of base_link in map [m].
            attitude: (4) xyzw, map from base_link.

        Returns:
            "" if it will be looked at, else why not: not_finite, out_of_range, future,
            out_of_order, late, not_fused.
        """
        return self.ekf2_model.vision(self.tick, boot_us, position, attitude)

    def target(self, target: OffboardSetpoint) -> str:
        """Take a set point of OFFBOARD; a valid one counts as a heartbeat of the stream.

        Returns:
            "" or why it is refused.
        """
        refused, was = refusal_of(target), self._refused
        self._refused = refused
        if refused:
            if refused != was:
                self._say(Severity.CRITICAL, refused)
            return refused
        self._signal_tick, self._signal_kind = self.tick, target.kind
        if self._commander.mode == OFFBOARD:  # PX4 forwards set points only then
            self._target = target
        return ""

    def arm(self) -> Result:
        """Arm; force does not help, as with PX4."""
        was = self.armed
        result = self._commander.arm(self.situation)
        if self.armed and not was:
            self._armed_tick = self.tick
            self.takeoff_state = TakeoffState.SPOOLUP
            self._taken_off = False
            self._navigator.leave()
            if self.ekf2_model.local_ok(self.tick):
                self._home = self.estimate.position.copy()
        return result

    def disarm(self, force: bool = False) -> Result:
        """Disarm; in the air only by force."""
        return self._commander.disarm(self.situation, force)

    def kill(self, on: bool) -> None:
        """Take the kill switch of the remote control: while it is on, no rotor turns."""
        self._commander.kill(on, self.situation)

    def test_motor(self, rotor: int, seconds: float) -> Result:
        """Turn one rotor of a disarmed vehicle for a while."""
        if self.armed or not self.parameters.get("COM_MOT_TEST_EN"):
            return Result.DENIED
        self._tested = rotor, self.tick + round(TICK_HZ * seconds)
        return Result.ACCEPTED

    def fail_battery(self) -> Result:
        """Let the battery be empty, as for a test of what happens then."""
        if not self.parameters.get("SYS_FAILURE_EN"):
            return Result.DENIED
        self._meter.empty()
        return Result.ACCEPTED

    def set_mode(self, mode: Mode, says: str = "") -> Result:
        """Change the flight mode; an armed vehicle that does it `says` so."""
        result = self._commander.set_mode(mode, self.situation)
        if says and result == Result.ACCEPTED and self.armed:
            self._say(Severity.INFO, says)
        return result

    def takeoff(self, height_m: float | None = None) -> Result:
        """Take off to a height above home, or to MIS_TAKEOFF_ALT."""
        result = self.set_mode(AUTO_TAKEOFF)
        if result == Result.ACCEPTED:
            self._navigator.leave()
            self._navigator.takeoff_height = finite_or_nan(height_m)
        return result

    def reposition(self, position: Array, yaw: float | None = None) -> Result:
        """Fly to a place (3) in map and hold it; axes that are NaN stay as they are."""
        goal = np.where(np.isfinite(position), position, self.estimate.position)
        if np.abs(goal).max() > _FARTHEST:
            return Result.DENIED
        result = self.set_mode(AUTO_HOLD)
        if result == Result.ACCEPTED and self.armed:
            self._navigator.go_to(goal, finite_or_nan(yaw))
        return result

    # --- what it does

    def step(self) -> None:
        """Fly one millisecond."""
        simulator = self.simulator
        tick = simulator.tick
        airborne = self._airborne(tick)
        decides = tick % POSITION_TICKS == 0
        self.ekf2_model.sense(simulator, airborne)
        if decides:
            self._decide(tick)
        self._controller.run(tick, self._commander.mode == DESCEND)
        if decides and self._ground.contact and self._had_time_to_lift_off(tick):
            self._controller.reduce_thrust_on_ground()
        self.ekf2_model.advance(simulator, airborne)
        simulator.advance(self._rotor_speeds(tick))
        if self.hand is not None:
            self.hand(simulator)

    def _rotor_speeds(self, tick: int) -> Array:
        """Return the commanded speeds (4) [rad/s]."""
        rotor, end_tick = self._tested
        tested = not self.armed and tick < end_tick
        if not (self.killed or tested):
            wanted: Array = self._autopilot.setpoint.rotor_speed
            return wanted
        speeds = np.zeros(4)
        if not self.killed:
            speeds[rotor] = self._vehicle.rotor_speed_min
        return speeds

    def _airborne(self, tick: int) -> bool:
        if self.takeoff_state >= TakeoffState.RAMPUP:
            self._airborne_tick = tick
            return True
        return tick - self._airborne_tick < _FALL_TICKS and not self.armed

    def _had_time_to_lift_off(self, tick: int) -> bool:
        lifts = self.takeoff_state >= TakeoffState.RAMPUP
        return lifts and tick - self._ramp_tick > _TAKEOFF_TICKS

    def _decide(self, tick: int) -> None:
        """Fifty times a second: battery, ground, mode, set points."""
        self.battery = self._meter.draw(self.simulator.plant, POSITION_TICKS * TICK_S)
        self._detect_landing(tick)
        commander = self._commander
        commander.update(self.situation)
        mode = commander.mode
        if not commander.armed:
            self.takeoff_state = TakeoffState.DISARMED
            self._followed = None
            if mode != OFFBOARD:
                self._target = None
            self._controller.idle(0.0)
            return
        if not self._ground.landed and not self._taken_off:
            self._taken_off = True
            self._say(Severity.INFO, "Takeoff detected")
        followed = self._followed = None if mode == DESCEND else self._wanted(mode)
        if not self._ready(followed, tick):
            self._controller.idle(self._vehicle.rotor_speed_min)
            return
        if followed is None:
            self._controller.blind()
        else:
            self._controller.take(followed, self._climb_max(tick), self._speed_max(mode))
        if self._navigator.finished and commander.user_intended_mode == AUTO_TAKEOFF:
            now = self.situation
            if not commander.missing(AUTO_HOLD, now):
                commander.set_mode(AUTO_HOLD, now)

    def _wanted(self, mode: Mode) -> OffboardSetpoint:
        """Return the set point of the mode."""
        if mode == OFFBOARD and self._target is not None:
            self._navigator.leave()
            return self._target
        if mode != OFFBOARD:
            self._target = None
        state = self.estimate
        heading = yaw_of(state.attitude)
        if mode in (ALTCTL, STABILIZED):  # without sticks: level, at the hover thrust
            self._navigator.leave()
            level = np.array([0.0, 0.0, math.sin(0.5 * heading), math.cos(0.5 * heading)])
            damped = 1.0 - _CLIMB_DAMPING * float(state.velocity[2]) if mode == ALTCTL else 1.0
            return OffboardSetpoint(attitude=level, thrust=self._controller.hover * damped)
        home = state.position if self._home is None else self._home
        return self._navigator.follow(mode, state.position, state.velocity, heading, home)

    # --- take-off and landing

    def _ready(self, followed: OffboardSetpoint | None, tick: int) -> bool:
        """Go on with the take-off; return whether anything is controlled."""
        if self.takeoff_state == TakeoffState.SPOOLUP:
            if tick - self._armed_tick < TICK_HZ * self.parameters.get("COM_SPOOLUP_TIME"):
                return False
            self.takeoff_state = TakeoffState.READY
            self._wanted_tick = None
        _, held, whole = self._ramp()
        if self.takeoff_state == TakeoffState.READY:
            if self._wanted_tick is None:  # once it has begun the ramp goes on by itself
                if followed is None or not self._requests_takeoff(followed):
                    return False
                self._wanted_tick = tick
            by_position = followed is None or followed.kind < ControlLevel.ATTITUDE
            if by_position and tick - self._wanted_tick < held:
                return False
            self.takeoff_state = TakeoffState.RAMPUP
            self._ramp_tick = tick
            self._controller.start()
        if self.takeoff_state == TakeoffState.RAMPUP and tick - self._ramp_tick >= whole - held:
            self.takeoff_state = TakeoffState.FLIGHT
        return True

    def _requests_takeoff(self, target: OffboardSetpoint) -> bool:
        """Return whether a standing vehicle is wanted in the air."""
        if target.kind >= ControlLevel.ATTITUDE:
            return target.thrust > 0.3 * self._controller.hover
        height, climb, push = target.position[2], target.velocity[2], target.acceleration[2]
        if self._commander.mode == AUTO_TAKEOFF:
            return True
        if math.isfinite(height):
            return bool(height > self.estimate.position[2] + _CLIMB_WANTED)
        return bool(climb > 0.05 if math.isfinite(climb) else push > 0.0)

    def _climb_max(self, tick: int) -> float:
        fastest, held, whole = self._ramp()
        if self.takeoff_state != TakeoffState.RAMPUP:
            return fastest if self._commander.mode == AUTO_TAKEOFF else math.inf
        return fastest * min((tick - self._ramp_tick) / max(whole - held, 1.0), 1.0)

    def _speed_max(self, mode: Mode) -> float:
        return math.inf if mode == OFFBOARD else self.parameters.get("MPC_XY_CRUISE")

    def _ramp(self) -> tuple[float, float, float]:
        """Return where the ramp ends [m/s], how long it holds it down and lasts in all [ticks]."""
        get = self.parameters.get
        fastest, whole = get("MPC_TKO_SPEED"), TICK_HZ * get("MPC_TKO_RAMP_T")
        return fastest, whole * _RAMP_BELOW / (_RAMP_BELOW + fastest), whole

    def _detect_landing(self, tick: int) -> None:
        """Ask the land detector; a landing ends the flight, though not the armed state."""
        force = self.simulator.accel - self._autopilot.state.accel_bias
        length = math.sqrt(float(force @ force)) / GRAVITY
        self._force += _FORCE_GAIN * (length - self._force)
        aloft = self._had_time_to_lift_off(tick)
        if self.armed and aloft:
            self._ground.update(self._looks_landed(tick), POSITION_TICKS)
            if self._ground.landed:
                self.takeoff_state = TakeoffState.READY
                self._wanted_tick = None
                self._say(Severity.INFO, "Landing detected")
            return
        # more thrust than that of a standing vehicle is asked for already
        begins = (
            self.armed
            and self.takeoff_state in (TakeoffState.READY, TakeoffState.RAMPUP)
            and self._wanted_tick is not None
            and tick - self._wanted_tick > _DETECTED_SHARE * self._ramp()[1]
        )
        self._ground.stay(landed=not begins)

    def _looks_landed(self, tick: int) -> bool:
        """Return whether the motion in flight is that of a vehicle on the ground."""
        state, setpoint = self.estimate, self._autopilot.setpoint
        vx, vy, vz = (float(v) for v in state.velocity)
        turn = math.sqrt(float(state.rates @ state.rates))
        quiet = turn < _TURN_MAX and abs(self._force - 1.0) < 0.15
        if self._commander.mode == DESCEND:
            # level and descending, it is held up by less than its weight until the ground does
            # it; without a height PX4 sees no vertical motion, nor that there is none
            return quiet and self.ekf2_model.altitude_ok(tick) and self._force > _CARRIED
        quiet = quiet and abs(vz) < _CLIMB_MAX and math.hypot(vx, vy) < _SLIDE_MAX
        by_motion = self._followed is not None and self._followed.kind < ControlLevel.ATTITUDE
        descending = by_motion and float(setpoint.velocity[2]) < _DESCENT_SPEED
        sinks = descending or self._ground.contact_ticks > 0
        low = _STANDS_BELOW if sinks else _STANDS_AT_ONCE_BELOW
        return quiet and float(setpoint.thrust) / self._controller.weight < low

    def _say(self, severity: Severity, text: str) -> None:
        self._status_texts.append((severity, text))

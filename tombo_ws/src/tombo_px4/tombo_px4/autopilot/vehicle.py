"""The Tombo vehicle behind an autopilot that behaves as PX4 does; no MAVLink, all ENU and FLU."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tombo_control.autopilot import EstimatedState, new_autopilot
from tombo_control.estimate import StampedEstimate
from tombo_control.params import POSITION_TICKS, ControlParams, EstimatorParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import yaw_of, yaw_pitch_roll
from tombo_dynamics.time_base import TICK_HZ, TICK_NS, TICK_S
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.autopilot.commander import DESCEND, TERMINATE, Commander, CommanderInput
from tombo_px4.autopilot.ekf2_model import Ekf2Model
from tombo_px4.autopilot.navigator import Navigator
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.setpoint_controller import (
    ControlLevel,
    OffboardSetpoint,
    ResolvedSetpoint,
    SetpointController,
    finite_or_nan,
    resolve_setpoint,
)
from tombo_px4.autopilot.vehicle_state import (
    ArmingHealth,
    BatteryCharge,
    BatteryMeter,
    GroundMotion,
    LandDetector,
    TakeoffState,
)
from tombo_px4.link.decoded_messages import MavLandedState, Result, Severity
from tombo_px4.modes import (
    ALTCTL,
    AUTO_HOLD,
    AUTO_LAND,
    AUTO_RTL,
    AUTO_TAKEOFF,
    MANUAL,
    OFFBOARD,
    STABILIZED,
    Mode,
)
from tombo_sim.simulator import Simulator
from tombo_sim.world import World

_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
_CLIMB_WANTED = 0.1
"""[m]: a set point this far above a standing vehicle means that it shall take off."""
_TAKEOFF_TICKS = 500
"""A take-off that has begun so long ago is one."""
_DESCENT_SPEED = -0.1
"""[m/s]: a set point that sinks faster may be meant to land."""
_FORCE_GAIN = 0.065
"""Share of a new specific force: 0.3 s at 50 Hz."""
_RAMP_BELOW = GRAVITY / 4.0
"""[m/s]: the ramp of a take-off begins so far below 0 (PX4: with MPC_Z_VEL_P_ACC of 4): a standing
vehicle is held down for the first part of it."""
_DETECTED_SHARE = 0.45
"""Share of that part after which PX4 1.17 said "Takeoff detected": 1.9 s after arming."""
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
            world: what is simulated.
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
        maps = self.simulator.setup.maps
        self._autopilot = new_autopilot(
            ControlParams(), EstimatorParams(), world.vehicle, np.zeros(3), _LEVEL
        )
        self.ekf2_model = Ekf2Model(self._autopilot, self.simulator, parameters, seed)
        self._setpoint_controller = SetpointController(self._autopilot, maps, parameters)
        parameters.set_vehicle_default("MPC_THR_HOVER", self._setpoint_controller.hover)
        self._commander = Commander(parameters, self._say)
        self._navigator = Navigator(parameters)
        self._ground = LandDetector()
        self._status_texts: list[tuple[Severity, str]] = []
        self._signal_tick = -1
        self._kind = ControlLevel.POSITION
        self._resolved: ResolvedSetpoint | None = None
        self._refused = ""
        self._flown: ResolvedSetpoint | None = None
        self._home: Array | None = None
        self.takeoff_state = TakeoffState.DISARMED
        """How far a take-off has come."""
        self._armed_tick = 0
        self._ramp_tick = 0
        self._wanted_tick: int | None = None
        self._airborne_tick = -(10**9)
        self._taken_off = False
        self._descend_mode = False
        self._was_mode: Mode | None = None
        self._force = 1.0
        self._meter = BatteryMeter(world.vehicle.battery_voltage, parameters)
        self.battery = BatteryCharge(world.vehicle.battery_voltage, 0.0, 1.0, 0)

    @property
    def _state(self) -> EstimatedState:
        # a view, made each time: a kept one would not follow a copied record
        state: EstimatedState = self._autopilot.state
        return state

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
    def armed(self) -> bool:
        """Whether the rotors may turn."""
        return self._commander.armed

    @property
    def mode(self) -> Mode:
        """The mode that is flown, as a heartbeat shows it."""
        mode = self._commander.mode
        if mode == DESCEND:
            return AUTO_LAND
        return MANUAL if mode == TERMINATE else mode

    @property
    def failsafe(self) -> bool:
        """Whether another mode is flown than was asked for."""
        return self._commander.failsafe

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
    def controls_attitude(self) -> bool:
        """Whether the last set point of OFFBOARD asks for an attitude, or for what needs one."""
        return self._signal_tick >= 0 and self._kind <= ControlLevel.ATTITUDE

    @property
    def estimate(self) -> StampedEstimate:
        """What the autopilot believes, at the present tick."""
        state = self._state
        return StampedEstimate(
            self.tick * TICK_NS,
            state.position.copy(),
            state.velocity.copy(),
            state.attitude.copy(),
            state.rates.copy(),
            state.gyro_bias.copy(),
            state.accel_bias.copy(),
            self.ekf2_model.fused_tick * TICK_NS,
        )

    @property
    def health(self) -> ArmingHealth:
        """What arming would be denied for."""
        return self._commander.health(self._commander_input())

    @property
    def home(self) -> Array:
        """(3) where it was armed, in map [m]; before, where it is."""
        return self._state.position.copy() if self._home is None else self._home.copy()

    @property
    def thrust(self) -> float:
        """Collective thrust asked for, share of the highest."""
        return float(self._autopilot.setpoint.thrust) / self._setpoint_controller.thrust_max

    @property
    def attitude_setpoint(self) -> tuple[Array, Array, float]:
        """What attitude and rate loop follow.

        Attitude (4) xyzw, map from base_link; rates (3) base_link [rad/s]; share of the highest
        collective thrust.
        """
        setpoint = self._autopilot.setpoint
        return setpoint.attitude.copy(), setpoint.rates.copy(), self.thrust

    def take_status_texts(self) -> list[tuple[Severity, str]]:
        """Return severity and words of the messages to the operator since the last call."""
        texts, self._status_texts = self._status_texts, []
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
        resolved = resolve_setpoint(target)
        if isinstance(resolved, str):
            if resolved != self._refused:
                self._say(Severity.CRITICAL, resolved)
            self._refused = resolved
            return resolved
        self._refused = ""
        self._kind = resolved.kind
        if self._commander.mode == OFFBOARD:  # PX4 forwards set points only then
            self._resolved = resolved
        self._signal_tick = self.tick
        return ""

    def arm(self, force: bool = False) -> Result:
        """Arm; force does not help, as with PX4."""
        was = self.armed
        result = self._commander.arm(self._commander_input())
        if self.armed and not was:
            self._armed_tick = self.tick
            self.takeoff_state = TakeoffState.SPOOLUP
            self._taken_off = False
            self._navigator.leave()
            if self.ekf2_model.local_ok(self.tick):
                self._home = self._state.position.copy()
        return result

    def disarm(self, force: bool = False) -> Result:
        """Disarm; in the air only by force."""
        return self._commander.disarm(self._commander_input(), force)

    def set_mode(self, mode: Mode) -> Result:
        """Change the flight mode."""
        return self._commander.set_mode(mode, self._commander_input())

    def takeoff(self, height_m: float | None = None, yaw: float | None = None) -> Result:
        """Take off to a height above home, or to MIS_TAKEOFF_ALT."""
        result = self.set_mode(AUTO_TAKEOFF)
        if result == Result.ACCEPTED:
            self._navigator.leave()
            self._navigator.takeoff_height = finite_or_nan(height_m)
            self._navigator.takeoff_yaw = finite_or_nan(yaw)
        return result

    def land(self) -> Result:
        """Land where it is."""
        result = self.set_mode(AUTO_LAND)
        if result == Result.ACCEPTED and self.armed:
            self._say(Severity.INFO, "Landing at current position")
        return result

    def return_home(self) -> Result:
        """Return to where it was armed, and land."""
        result = self.set_mode(AUTO_RTL)
        if result == Result.ACCEPTED and self.armed:
            self._say(Severity.INFO, "Returning to launch")
        return result

    def hold(self) -> Result:
        """Stay where it is."""
        return self.set_mode(AUTO_HOLD)

    def reposition(self, position: Array, yaw: float | None = None) -> Result:
        """Fly to a place (3) in map and hold it; axes that are NaN stay as they are."""
        if np.shape(position) != (3,):
            return Result.DENIED
        goal = np.where(np.isfinite(position), position, self._state.position)
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
        self._setpoint_controller.run(tick, self._descend_mode)
        if decides and self._ground.contact and self._had_time_to_lift_off(tick):
            self._setpoint_controller.reduce_thrust_on_ground()
        self.ekf2_model.advance(simulator, airborne)
        simulator.advance(self._autopilot.setpoint.rotor_speed)
        if self.hand is not None:
            self.hand(simulator)

    def _airborne(self, tick: int) -> bool:
        if self.takeoff_state >= TakeoffState.RAMPUP:
            self._airborne_tick = tick
            return True
        return tick - self._airborne_tick < _FALL_TICKS and not self.armed

    def _had_time_to_lift_off(self, tick: int) -> bool:
        """Return whether it has had the time to lift off."""
        return (
            self.takeoff_state >= TakeoffState.RAMPUP and tick - self._ramp_tick > _TAKEOFF_TICKS
        )

    def _commander_input(self) -> CommanderInput:
        tick = self.tick
        ekf2_model = self.ekf2_model
        _, pitch, roll = yaw_pitch_roll(self._state.attitude).tolist()
        return CommanderInput(
            tick,
            ekf2_model.attitude_ok,
            ekf2_model.local_ok(tick),
            ekf2_model.global_ok(tick),
            self._ground.landed,
            self._ground.maybe_landed,
            self._taken_off,
            self._signal_tick,
            self._kind,
            self.battery,
            roll,
            pitch,
            ekf2_model.altitude_ok(tick),
        )

    def _decide(self, tick: int) -> None:
        """Fifty times a second: battery, ground, mode, set points."""
        self.battery = self._meter.draw(self.simulator.plant, POSITION_TICKS * TICK_S)
        self._update_land_detector()
        commander = self._commander
        commander.update(self._commander_input())
        if not commander.armed:
            self.takeoff_state = TakeoffState.DISARMED
            self._descend_mode = False
            self._flown = None
            self._was_mode = None
            if commander.mode != OFFBOARD:
                self._resolved = None
            self._setpoint_controller.idle(0.0)
            return
        if not self._ground.landed and not self._taken_off:
            self._taken_off = True
            self._say(Severity.INFO, "Takeoff detected")
        mode = commander.mode
        self._descend_mode = mode == DESCEND
        resolved = None if self._descend_mode else self._wanted(mode, tick)
        self._flown = resolved
        self._was_mode = mode
        if not self._ready(resolved, tick):
            self._setpoint_controller.idle(self._vehicle.rotor_speed_min)
            return
        if resolved is None:
            self._setpoint_controller.blind()
        else:
            self._setpoint_controller.take(resolved, self._climb_max(tick))
        if self._navigator.finished and commander.user_intended_mode == AUTO_TAKEOFF:
            now = self._commander_input()
            if not commander.missing(AUTO_HOLD, now):
                commander.set_mode(AUTO_HOLD, now)

    def _wanted(self, mode: Mode, tick: int) -> ResolvedSetpoint | None:
        """Return what the mode wants to be followed."""
        if mode == OFFBOARD and self._resolved is not None:
            self._navigator.leave()
            return self._resolved
        if mode != OFFBOARD:
            self._resolved = None
        if mode in (ALTCTL, STABILIZED):
            self._navigator.leave()
            return self._unsteered(mode)
        position, velocity = self._state.position, self._state.velocity
        home = position if self._home is None else self._home
        if self.takeoff_state < TakeoffState.RAMPUP and mode == self._was_mode == AUTO_TAKEOFF:
            self._navigator.begin_again(tick * TICK_S, position)
        heading = yaw_of(self._state.attitude)
        return self._navigator.follow(mode, tick * TICK_S, position, velocity, heading, home)

    def _unsteered(self, mode: Mode) -> ResolvedSetpoint:
        """Return what PX4 flies in a mode for sticks without any: level, at the hover thrust."""
        yaw = yaw_of(self._state.attitude)
        level = np.array([0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)])
        thrust = self._setpoint_controller.hover
        if mode == ALTCTL:
            thrust *= 1.0 - _CLIMB_DAMPING * float(self._state.velocity[2])
        return ResolvedSetpoint(ControlLevel.ATTITUDE, attitude=level, thrust=thrust)

    def _ready(self, resolved: ResolvedSetpoint | None, tick: int) -> bool:
        """Go on with the take-off; return whether anything is controlled."""
        if self.takeoff_state == TakeoffState.SPOOLUP:
            if tick - self._armed_tick < TICK_HZ * self.parameters.get("COM_SPOOLUP_TIME"):
                return False
            self.takeoff_state = TakeoffState.READY
            self._wanted_tick = None
        if self.takeoff_state == TakeoffState.READY:
            if self._wanted_tick is None:  # once it has begun the ramp goes on by itself
                if not self._requests_takeoff(resolved):
                    return False
                self._wanted_tick = tick
            by_position = resolved is None or resolved.kind < ControlLevel.ATTITUDE
            if by_position and tick - self._wanted_tick < self._ramp()[1]:
                return False
            self.takeoff_state = TakeoffState.RAMPUP
            self._ramp_tick = tick
            self._setpoint_controller.start()
        if self.takeoff_state == TakeoffState.RAMPUP:
            _, held, whole = self._ramp()
            if tick - self._ramp_tick >= whole - held:
                self.takeoff_state = TakeoffState.FLIGHT
        return True

    def _requests_takeoff(self, resolved: ResolvedSetpoint | None) -> bool:
        """Return whether a standing vehicle is wanted in the air."""
        if resolved is None:
            return False
        if resolved.kind >= ControlLevel.ATTITUDE:
            return resolved.thrust > 0.3 * self._setpoint_controller.hover
        height, climb, push = resolved.position[2], resolved.velocity[2], resolved.acceleration[2]
        if self._commander.mode == AUTO_TAKEOFF:
            return True
        return bool(
            height > self._state.position[2] + _CLIMB_WANTED
            or (not math.isfinite(height) and climb > 0.05)
            or (not math.isfinite(height) and not math.isfinite(climb) and push > 0.0)
        )

    def _begins_take_off(self) -> bool:
        """Return whether more thrust than that of a standing vehicle is asked for already."""
        wanted = self._wanted_tick
        begun = self.takeoff_state in (TakeoffState.READY, TakeoffState.RAMPUP)
        return (
            begun and wanted is not None and self.tick - wanted > _DETECTED_SHARE * self._ramp()[1]
        )

    def _climb_max(self, tick: int) -> float:
        if self.takeoff_state != TakeoffState.RAMPUP:
            return math.inf
        fastest, held, whole = self._ramp()
        return fastest * min((tick - self._ramp_tick) / max(whole - held, 1.0), 1.0)

    def _ramp(self) -> tuple[float, float, float]:
        """Return where the ramp ends [m/s], how long it holds it down and lasts in all [ticks]."""
        get = self.parameters.get
        fastest, whole = get("MPC_TKO_SPEED"), TICK_HZ * get("MPC_TKO_RAMP_T")
        return fastest, whole * _RAMP_BELOW / (_RAMP_BELOW + fastest), whole

    def _update_land_detector(self) -> None:
        """Ask the land detector; a landing ends the flight, though not the armed state."""
        state, setpoint = self._autopilot.state, self._autopilot.setpoint
        flown = self._flown
        vx, vy, vz = (float(v) for v in self._state.velocity)
        descending = self._descend_mode
        if flown is not None and flown.kind <= ControlLevel.ACCELERATION:
            descending = float(setpoint.velocity[2]) < _DESCENT_SPEED
        force = self.simulator.accel - state.accel_bias
        length = math.sqrt(float(force @ force)) / GRAVITY
        self._force += _FORCE_GAIN * (length - self._force)
        aloft = self._had_time_to_lift_off(self.tick)
        motion = GroundMotion(
            self.armed,
            aloft,
            self._begins_take_off(),
            not self._descend_mode,
            self.ekf2_model.altitude_ok(self.tick),
            descending,
            vz,
            math.hypot(vx, vy),
            math.sqrt(float(self._state.rates @ self._state.rates)),
            self._force,
            float(setpoint.thrust) / self._setpoint_controller.weight,
        )
        get = self.parameters.get
        limits = (get("LNDMC_Z_VEL_MAX"), get("LNDMC_XY_VEL_MAX"))
        self._ground.update(motion, *limits, POSITION_TICKS)
        if aloft and self._ground.landed:
            self.takeoff_state = TakeoffState.READY
            self._wanted_tick = None
            self._say(Severity.INFO, "Landing detected")

    def _say(self, severity: Severity, text: str) -> None:
        if len(self._status_texts) < _MAX_STATUS_TEXTS:
            self._status_texts.append((severity, text))

"""Ground truth of the vehicle: pose, twist, contact force, end of the flight."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import Phase
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import rotated_back, to_map
from tombo_dynamics.vectors import Vector, add, store


@compiled
def contact_force(plant: Plant) -> Vector:
    """Return the force on the vehicle in map [N]: of blade strikes, and of the frame's contact."""
    strike, contact = to_map(plant.rotation, plant.strike_force), plant.contact
    if contact.touching and contact.rotor < 0:
        return add(strike, contact.force)
    return strike


@compiled
def true_state(plant: Plant, out: Array) -> None:
    """Write position (3) and attitude (4) in map, velocity (3) and rates (3) in base_link."""
    state = plant.state
    store(out[0:3], state.position)
    store(out[3:7], state.attitude)
    store(out[7:10], rotated_back(state.attitude, state.velocity))
    store(out[10:13], state.rates)


_AFTER_LANDING_S = 1.0
_AFTER_CRASH_S = 1.5
UNDECIDED = -1.0


class FlightEnd(Record):
    """How near a flight is to its end."""

    ground = field("m", "height of a vehicle that stands on the ground")
    airborne = field("1", "it has flown", kind=bool)
    over = field("1", "the end is decided", kind=bool)


@compiled
def watch_end(memory: FlightEnd, height: float, upright: float, phase: int) -> float:
    """Return how long to go on [s] once the flight is decided, else `UNDECIDED`.

    Args:
        memory: of this flight.
        height: of the vehicle in map [m].
        upright: cosine of its tilt.
        phase: of the mission.
    """
    if height > memory.ground + 0.3:
        memory.airborne = True
    if memory.over or not memory.airborne:
        return UNDECIDED
    if phase == Phase.LANDED:
        memory.over = True
        return _AFTER_LANDING_S
    fallen = height < memory.ground - 0.02 or (height < memory.ground + 0.05 and upright < 0.8)
    if fallen and phase != Phase.IDLE and phase != Phase.TAKEOFF and phase != Phase.LAND:
        memory.over = True
        return _AFTER_CRASH_S
    return UNDECIDED


class FlightEndDetector:
    """Watches one flight; call at any rate."""

    def __init__(self, leg_height: float) -> None:
        self._memory = FlightEnd.new()
        self._memory.ground = leg_height

    def watch(self, height: float, upright: float, phase: int) -> float | None:
        """Return how long to go on [s] once the flight is decided, else None (`watch_end`)."""
        after = watch_end(self._memory, height, upright, phase)
        return None if after == UNDECIDED else after

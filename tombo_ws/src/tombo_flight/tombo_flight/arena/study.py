"""An arena: the collisions that reactions are compared on, flown with every reaction."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Final

import numpy as np

from tombo_bag.flight import Flight
from tombo_collision.network import read_network
from tombo_collision.reactions import REGISTRY
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.campaign.statistics import SPREAD_METRICS
from tombo_flight.command_line import fly_command
from tombo_flight.flight_output import flight_summary, warm_up_flight
from tombo_flight.own_files import imported_files
from tombo_flight.process.study import FlightRow, Task
from tombo_flight.report.paper_values import COLLISION_POINT_M
from tombo_flight.scenario import Scenario, load_scenario
from tombo_flight.sweep.study import figure_columns

COLLISIONS: Final = "collisions"
FREE: Final = "free"
CONFIGURATIONS: Final = "configurations"
SPEED_OFFSET: Final = "speed_offset"
ANGLE_RADIUS: Final = "angle_radius"
GROUPS: Final[Mapping[str, str]] = {
    COLLISIONS: "the collisions of `tombo scenarios`, and the paper's at other speeds",
    FREE: "flight without an obstacle, for false alarms",
    CONFIGURATIONS: "the paper's collision with each configuration of its Table I",
    SPEED_OFFSET: "map: approach speed and lateral place of the pillar",
    ANGLE_RADIUS: "map: angle between nose and course, and radius of the obstacle",
}
"""Name of a group of cases → what is in it."""

POLICY_FILE: Final = ":"
"""Between a reaction's name and the file of its network."""
_BASE: Final = "paper_collision"
_SCENARIOS: Final = (
    *(_BASE, "pillar_right", "pillar_wide", "pole", "short_strike", "side_hit", "rear_hit"),
)
_SPEEDS: Final = (0.5, 0.9, 1.2, 1.5)
_MAP_SPEEDS: Final = (0.5, 0.75, 1.0, 1.25, 1.5)
_MAP_OFFSETS: Final = (0.0, 0.1, 0.2, 0.27, 0.35, 0.45)
_MAP_ANGLES: Final = (0, 30, 60, 90, 120, 150, 180)
_MAP_RADII: Final = (0.03, 0.1, 0.25, 0.5)
_AT_ONCE: Final = 8
"""Seeds that a match flies in a row: its scenario is read once for them."""
_MAP_SHARE: Final = 3
"""A cell of a map flies one of so many seeds: neighbours tell about each other."""


@dataclass(frozen=True)
class ArenaCase:
    """One collision: a scenario, with settings."""

    name: str
    group: str
    scenario: str
    settings: tuple[str, ...] = ()
    one_of: int = 1
    """The first of so many seeds are flown."""
    place: tuple[float, float] = (0.0, 0.0)
    """Of a cell in its map: x and y, in the units of its axes."""

    def seeds(self, seeds: range) -> range:
        """Return those of the seeds that are flown."""
        return seeds[: math.ceil(len(seeds) / self.one_of)]


@dataclass(frozen=True)
class Match:
    """A reaction in a case."""

    reaction: str
    """Its name; `policy:FILE` is `policy` with the network of a file."""
    case: ArenaCase
    disturbed: bool

    def scenario(self) -> Scenario:
        """Return what is flown."""
        name, settings = self._chosen()
        over = ["disturbances=true"] if self.disturbed else []
        return load_scenario(self.case.scenario, [*over, f"reaction.name={name}", *settings])

    def _chosen(self) -> tuple[str, list[str]]:
        """Return the reaction's name, and the settings."""
        name, _, file = self.reaction.partition(POLICY_FILE)
        network = [f"reaction.network={file}"] if file else []
        return name, [*network, *self.case.settings]

    def command(self, seed: int) -> str:
        """Return the command that flies one flight of it alone."""
        name, settings = self._chosen()
        return fly_command(
            self.case.scenario,
            seed,
            settings=settings,
            imports=imported_files(),
            reaction=name,
            disturbances=self.disturbed,
        )


def chosen_reactions(names: Sequence[str] | None, given: str) -> list[str]:
    """Return reactions as `Match` has them; of None all that are compared.

    Raises:
        InputError: one is unknown, or has no network; `given` names the list.
    """
    if names is None:
        return [name for name, kind in REGISTRY.items() if kind.compared]
    trained = [name for name in dict.fromkeys(names) if name.startswith(f"policy{POLICY_FILE}")]
    for name in dict.fromkeys(names):
        file = name.partition(POLICY_FILE)[2]
        if name in ("policy", *trained) and read_network(f"{given} {name}", file) is None:
            raise InputError(f"{given} {name}: no network; accepted: policy:FILE (docs/gym.md)")
    named = [name for name in names if name not in trained]
    return [*(chosen(named, given, REGISTRY) if named else []), *trained]


def chosen(names: Sequence[str] | None, given: str, known: Iterable[str]) -> list[str]:
    """Return names in the order of those that are known; of None all.

    Raises:
        InputError: one is unknown; `given` names the list.
    """
    accepted = list(known)
    for name in names or ():
        if name not in accepted:
            raise unknown_name(given, name, accepted)
    return [name for name in accepted if names is None or name in names]


@cache
def arena_cases() -> tuple[ArenaCase, ...]:
    """Return all cases, group by group."""
    paper = load_scenario(_BASE)
    cases = [ArenaCase(name, COLLISIONS, name) for name in _SCENARIOS]
    cases += [ArenaCase(f"{v:g} m/s", COLLISIONS, _BASE, (_speed(v),)) for v in _SPEEDS]
    cases.append(ArenaCase("aggressive", FREE, "aggressive"))
    cases += [
        ArenaCase(f"Conf. {n}", CONFIGURATIONS, _BASE, (f"propeller.conf={n}",))
        for n in range(1, 14)
    ]
    for y in _MAP_OFFSETS:
        for v in _MAP_SPEEDS:
            name, settings = f"{v:g} m/s, y = {y:g} m", (_speed(v), f"obstacle.y={y:g}")
            cases.append(ArenaCase(name, SPEED_OFFSET, _BASE, settings, _MAP_SHARE, (v, y)))
    for radius in _MAP_RADII:
        for angle in _MAP_ANGLES:
            name = f"{angle}°, radius {radius:g} m"
            turned = _turned(paper, math.radians(angle), radius)
            cases.append(ArenaCase(name, ANGLE_RADIUS, _BASE, turned, _MAP_SHARE, (angle, radius)))
    return tuple(cases)


def _speed(value: float) -> str:
    return f"mission.approach_speed={value:g}"


def _turned(paper: Scenario, angle: float, radius: float) -> tuple[str, ...]:
    """Return settings: the paper's goal turned about the start, and a pillar that is touched."""
    goal = math.hypot(paper.mission.goal_x, paper.mission.goal_y)
    x, y = touching_pillar(paper, angle, radius)
    return (
        f"mission.goal_x={round(goal * math.cos(angle), 4):g}",
        f"mission.goal_y={round(goal * math.sin(angle), 4):g}",
        *(f"obstacle.x={x:g}", f"obstacle.y={y:g}", f"obstacle.radius={radius:g}"),
    )


def touching_pillar(paper: Scenario, angle: float, radius: float) -> tuple[float, float]:
    """Return where a pillar stands so that a disc touches it as in the paper, on another course.

    The vehicle's nose points along map x. The pillar is touched where the paper's is, x_c turned
    by the angle, and in the paper's direction off the course, by the disc that is foremost in
    that direction.

    Args:
        paper: its scenario.
        angle: from the nose to the course, to the left [rad].
        radius: of the pillar [m].

    Returns:
        Its axis in map, x and y [m].
    """
    distance = math.hypot(*COLLISION_POINT_M[:2])
    hub, _ = _foremost(paper.vehicle, 0.0)
    off = math.atan2(paper.obstacle.y - hub[1], paper.obstacle.x - hub[0] - distance)
    towards = angle + off
    hub, way = _foremost(paper.vehicle, towards)
    reach = radius + paper.vehicle.rotor_radius
    x, y = (distance * np.array([math.cos(angle), math.sin(angle)]) + hub[:2] + reach * way).round(
        4
    )
    return float(x), float(y)


def _foremost(vehicle: VehicleParams, towards: float) -> tuple[Array, Array]:
    """Return the hub that is foremost in a direction; of two the left one; and that direction."""
    way = np.array([math.cos(towards), math.sin(towards)])
    left = np.array([-way[1], way[0]])
    hubs = vehicle.rotor_positions()[:, :2]
    hub: Array = hubs[np.argmax(hubs @ (way + 1e-6 * left))]
    return hub, way


ROW_KEYS: Final = (
    *("seed", "collided", "detected", "crashed", "landed", "false_alarms"),
    *("contact_rotor", "struck_rotor", *SPREAD_METRICS),
)
"""What is kept of a flight's summary."""


@dataclass(frozen=True)
class ArenaStudy:
    """What an arena flies: the points are matches."""

    kind = "arena"
    summary_only = True
    seeds: range
    """Of the cases that fly all of them."""
    matches: tuple[Match, ...]
    tasks: tuple[Task, ...]
    """Keyed by reaction, case, seed and a hash of the scenario. Some seeds of each match in turn,
    so that what is stopped has about as many flights of each."""
    refused: Mapping[str, str]
    """Cases that can't be flown → the reason."""

    def scenario_at(self, match: Match) -> Scenario:
        """Return what is flown in a match."""
        return match.scenario()

    @cached_property
    def keys(self) -> Set[str]:
        """The keys of its flights."""
        return frozenset(task.key for task in self.tasks)

    def as_mapping(self) -> dict[str, Any]:
        """Return nothing: the same folder takes more reactions, cases and seeds."""
        return {}

    def columns(self) -> dict[str, str]:
        """Return the columns of the table."""
        what = dict.fromkeys(("flight", "reaction", "case", "group"), "text")
        return {**what, "seed": "count", **figure_columns(ROW_KEYS[1:]), "error": "text"}

    def labels(self, match: Match) -> dict[str, Any]:
        """Return what is flown in a match."""
        case = match.case
        return {"reaction": match.reaction, "case": case.name, "group": case.group}

    def figures(self, flight: Flight, scenario: Scenario) -> dict[str, Any]:
        """Return what is kept of a flight."""
        summary = flight_summary(flight)
        return {key: summary[key] for key in ROW_KEYS[1:]}

    def rows(self, kept: Mapping[str, FlightRow]) -> dict[Match, list[FlightRow]]:
        """Return what is kept of the flights of each match, in the order of the seeds.

        Flights that could not be flown are left out; see `not_flown`.
        """
        found: dict[Match, list[FlightRow]] = {match: [] for match in self.matches}
        for task in self.tasks:
            row = kept[task.key]
            if not row.get("error"):
                found[task.point].append({key: row[key] for key in ROW_KEYS})
        return found

    def not_flown(self, kept: Mapping[str, FlightRow]) -> dict[str, str]:
        """Return what could not be flown, besides `refused` → the reason of the first flight."""
        errors: dict[Match, list[str]] = {}
        for task in self.tasks:
            if kept[task.key].get("error"):
                why = f"seed {task.seed}: {kept[task.key]['error']}"
                errors.setdefault(task.point, []).append(why)
        return {
            f"{match.case.name} with {match.reaction} ({len(of)} flights)": of[0]
            for match, of in errors.items()
        }


def new_arena(
    reactions: Sequence[str], cases: Iterable[ArenaCase], seeds: range, *, disturbed: bool
) -> ArenaStudy:
    """Return the flights of an arena; a case whose vehicle can't lift off is left out."""
    flown, refused = [], {}
    for case in cases:
        try:
            warm_up_flight(Match(reactions[0], case, disturbed).scenario())
        except InputError as error:
            refused[case.name] = str(error)
        else:
            flown.append(case)
    matches = tuple(Match(name, case, disturbed) for case in flown for name in reactions)
    hashes = {match: _hash(match.scenario()) for match in matches}
    tasks = tuple(
        Task(f"{m.reaction}/{m.case.name}/{seed}/{hashes[m]}", m, seed)
        for some in range(0, len(seeds), _AT_ONCE)
        for m in matches
        for seed in seeds[some : some + _AT_ONCE]
        if seed in m.case.seeds(seeds)
    )
    return ArenaStudy(seeds, matches, tasks, refused)


def _hash(scenario: Scenario) -> str:
    """Return what tells rows apart: other parameters, figures kept, or code of the user."""
    told = repr((ROW_KEYS, scenario, imported_files()))
    return hashlib.sha256(told.encode()).hexdigest()[:8]

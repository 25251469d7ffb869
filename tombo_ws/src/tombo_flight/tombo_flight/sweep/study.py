"""A sweep as data: its cases, varied keys, the flight of a number, the columns of its table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from tombo_bag.flight import Flight
from tombo_collision.reactions import REGISTRY
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_seed
from tombo_dynamics.yaml_text import parse_yaml, read_text
from tombo_flight.command_line import command_line
from tombo_flight.flight_output import flight_summary
from tombo_flight.json_text import plain
from tombo_flight.own_files import imported_files
from tombo_flight.process.study import FlightRow
from tombo_flight.scenario import Scenario, scenario_values, with_settings
from tombo_flight.sweep.design import SweepDesign, value_text
from tombo_flight.version import tombo_version
from tombo_flight.yaml_file import mapping_of

COLLISIONS = "collisions"
"""The cases that come with the suite, in this module's folder."""
CASE = "case"
"""Column of the case, where there is more than one."""
REACTION = "reaction.name"
_NETWORK = ":"
"""Separator between the reaction `policy` and the file of its network."""
_CASES = "cases"

FIGURES: Mapping[str, str] = {
    **dict.fromkeys(("scenario", "law", "reaction", "contact_rotor", "struck_rotor"), "text"),
    "ends_elsewhere": "text",
    **dict.fromkeys(
        ("disturbances", "collided", "detected", "crashed", "landed", "interrupted"), "yes or no"
    ),
    **dict.fromkeys(("conf", "detections", "false_alarms", "strikes", "rotors_broken"), "count"),
    **dict.fromkeys(("contact_point_m", "contact_position_m", "x_c_m", "n_r", "x_r_m"), "vector"),
    **dict.fromkeys(
        (
            *("collision_time_s", "detection_time_s", "detection_latency_s", "contact_known_s"),
            *("crash_time_s", "detection_confidence", "max_falling_distance_m"),
            *("unstable_phase_s", "recovery_time_s", "settled_error_m", "max_tilt_rad"),
            *("duration_s", "hover_rms_m", "approach_rms_m", "peak_contact_force_n"),
            *("wall_time_s", "real_time_factor"),
        ),
        "number",
    ),
}
"""Figures of a summary (docs/figures.md) → kind of their column."""
_AXES = ("x", "y", "z")


def row_of(summary: Mapping[str, Any]) -> FlightRow:
    """Return the columns of a summary; a vector has one for each of x, y and z."""
    row: FlightRow = {}
    for name, kind in FIGURES.items():
        value = summary[name]
        if kind == "vector":
            parts = (None, None, None) if value is None else value
            row |= {f"{name}_{a}": part for a, part in zip(_AXES, parts, strict=True)}
        else:
            row[name] = value
    return row


def figure_columns() -> dict[str, str]:
    """Return the columns that `row_of` gives, with their kinds."""
    columns: dict[str, str] = {}
    for name, kind in FIGURES.items():
        if kind == "vector":
            columns |= dict.fromkeys([f"{name}_{a}" for a in _AXES], "number")
        else:
            columns[name] = kind
    return columns


@dataclass(frozen=True)
class Case:
    """One of the scenarios of a sweep; complete, so that nothing is read again."""

    name: str
    scenario: str
    """Name or file, as given."""
    settings: tuple[str, ...]
    """Texts of --set that belong to the case."""
    label: str
    """Name of the scenario."""
    values: Mapping[str, Any]
    """Values of the scenario without settings, in the types of JSON."""


MOST_FLIGHTS = 10_000_000


@dataclass(frozen=True, kw_only=True)
class SweepStudy:
    """Cases, varied keys, and the seeds of each point.

    The points of the first case come first, and of each point all its seeds. A drawn design has
    other seeds at each point, so that its flights are independent of each other.
    """

    summary_only = True
    cases: tuple[Case, ...]
    settings: tuple[str, ...]
    """Texts of --set that are the same in all flights."""
    design: SweepDesign
    seeds: tuple[int, int]
    """First of the seeds, and the one after the last."""
    model: str
    vehicle: str
    imports: tuple[tuple[str, str], ...]
    """Files of the user, as of `imported_files`."""
    tombo_version: str

    @property
    def seeds_each(self) -> int:
        """How many seeds a point is flown with."""
        return self.seeds[1] - self.seeds[0]

    @property
    def points(self) -> int:
        """How many points there are, in all cases."""
        return len(self.cases) * self.design.points

    @property
    def flights(self) -> int:
        """How many flights there are."""
        return self.points * self.seeds_each

    @property
    def label(self) -> str:
        """The names of all cases."""
        return ", ".join(case.name for case in self.cases)

    @property
    def keys(self) -> list[str]:
        """The varied settings: the columns of `varied`."""
        return [*([CASE] if len(self.cases) > 1 else []), *(a.key for a in self.design.axes)]

    def place(self, flight: int) -> tuple[int, int]:
        """Return point and seed of a flight, by number."""
        point, seed = divmod(flight, self.seeds_each)
        if self.design.samples:
            seed += point % self.design.points * self.seeds_each
        return point, self.seeds[0] + seed

    def varied(self, point: int) -> dict[str, str]:
        """Return varied key → its value at a point, as texts."""
        case, number = divmod(point, self.design.points)
        named = {CASE: self.cases[case].name} if len(self.cases) > 1 else {}
        return named | self.design.settings(number)

    def _case_and_settings(self, point: int) -> tuple[Case, list[str]]:
        case, number = divmod(point, self.design.points)
        return self.cases[case], [
            *self.settings,
            *self.cases[case].settings,
            *(text for one in self.design.settings(number).items() for text in _texts(*one)),
        ]

    def scenario_at(self, point: int) -> Scenario:
        """Return the flight of a point.

        Raises:
            InputError: it is not a scenario.
        """
        case, settings = self._case_and_settings(point)
        return with_settings(dict(case.values), settings, case.label)

    def figures(self, flight: Flight) -> FlightRow:
        """Return the columns of a flight."""
        return row_of(flight_summary(flight))

    def columns(self) -> dict[str, str]:
        """Return the columns of the table → text, yes or no, count or number."""
        numeric = {axis.key for axis in self.design.axes if axis.numeric}
        varied = {key: "number" if key in numeric else "text" for key in self.keys}
        place = dict.fromkeys(("flight", "point", "seed"), "count")
        return {**place, **varied, **figure_columns(), "error": "text"}

    def labels(self, point: int) -> FlightRow:
        """Return the columns that say what is flown at a point."""
        kinds = self.columns()
        varied = self.varied(point).items()
        return {"point": point} | {k: float(v) if kinds[k] == "number" else v for k, v in varied}

    def command(self, flight: int) -> str:
        """Return the command line that flies a flight again, alone."""
        point, seed = self.place(flight)
        case, settings = self._case_and_settings(point)
        imports = [("--import", path) for path, _ in self.imports]
        options = [("--seed", str(seed)), ("--model", self.model), ("--vehicle", self.vehicle)]
        return command_line(("fly", case.scenario), [*options, *imports], settings)

    def as_mapping(self) -> dict[str, Any]:
        """Return it in the types of JSON: the description of the flights in `sweep.json`."""
        values: dict[str, Any] = plain(asdict(self))
        return {**values.pop("design"), **values}


def _texts(key: str, value: str) -> list[str]:
    """Return the texts of --set for a value of an axis; `policy:FILE` names its network, too."""
    name, sign, network = value.partition(_NETWORK)
    if key == REACTION and sign:
        return [f"{key}={name}", f"reaction.network={network}"]
    return [f"{key}={value}"]


def new_sweep(
    scenarios: str,
    design: SweepDesign,
    seeds: range,
    settings: Iterable[str] = (),
    model: str | None = None,
    vehicle: str | None = None,
) -> SweepStudy:
    """Read and check a sweep: its cases, and each value of an axis by itself.

    Args:
        scenarios: names or files with commas between them; a file may have cases in it.
        design: the varied settings.
        seeds: of the flights of each point.
        settings: texts of --set.
        model: a model.yaml.
        vehicle: a name or file.

    Raises:
        InputError: as `load_scenario`, no cases, or there are too many flights.
    """
    cases = tuple(
        Case(name, scenario, texts, label, plain(values))
        for name, scenario, texts in _case_texts(scenarios)
        for values, label in [scenario_values(scenario, model, vehicle)]
    )
    names = [case.name for case in cases]
    if len(set(names)) < len(names):
        raise InputError(f"'{scenarios}': a case is given twice; accepted: each once")
    sweep = SweepStudy(
        cases=cases,
        settings=tuple(settings),
        design=design,
        seeds=(seeds.start, seeds.stop),
        model=model or "",
        vehicle=vehicle or "",
        imports=imported_files(),
        tombo_version=tombo_version(),
    )
    if not 1 <= sweep.flights <= MOST_FLIGHTS:
        raise InputError(f"{sweep.flights} flights; accepted: 1 to {MOST_FLIGHTS}")
    for flight in (0, sweep.flights - 1):
        check_seed("seed", sweep.place(flight)[1])
    _check_values(sweep)
    return sweep


def _check_values(sweep: SweepStudy) -> None:
    """Refuse settings that no case accepts, and values that the first one does not accept."""
    for number, case in enumerate(sweep.cases):
        fixed = [*sweep.settings, *case.settings]
        with_settings(dict(case.values), fixed, case.label)
        for axis in sweep.design.axes if number == 0 else ():
            for value in sweep.design.values_to_check(axis):
                if axis.key == REACTION and value.partition(_NETWORK)[0] not in REGISTRY:
                    raise unknown_name(f"reaction in {axis.key}=", value, REGISTRY)
                with_settings(dict(case.values), [*fixed, *_texts(axis.key, value)], case.label)


def _case_texts(scenarios: str) -> list[tuple[str, str, tuple[str, ...]]]:
    """Return name, scenario and settings of each case."""
    cases: list[tuple[str, str, tuple[str, ...]]] = []
    for word in (part.strip() for part in scenarios.split(",")):
        given_cases = _cases_of(word)
        if given_cases is None:
            cases.append((word, word, ()))
            continue
        what = f"'{word}'"
        for name, given in given_cases.items():
            settings = dict(mapping_of(given or {}, f"{what}: {name}"))
            scenario = settings.pop("scenario", name)
            if not isinstance(name, str) or not isinstance(scenario, str):
                raise InputError(
                    f"{what}: {shown(name)}: {shown(scenario)}; accepted: a name with its "
                    "scenario, as in fast: {scenario: paper_collision, KEY: VALUE}"
                )
            texts = tuple(f"{key}={value_text(value)}" for key, value in settings.items())
            cases.append((name, scenario, texts))
    return cases


def _cases_of(word: str) -> Mapping[str, Any] | None:
    """Return the cases of a file that has some; None: it is a scenario."""
    what = f"'{word}'"
    if word == COLLISIONS:
        source = resources.files("tombo_flight").joinpath("sweep", f"{COLLISIONS}.yaml")
        text = source.read_text(encoding="utf-8")
    elif Path(word).is_file():
        text = read_text(Path(word), what)
    else:
        return None
    values = parse_yaml(text, what)
    if not isinstance(values, Mapping) or _CASES not in values:
        return None
    return mapping_of(values[_CASES], f"{what}: {_CASES}")

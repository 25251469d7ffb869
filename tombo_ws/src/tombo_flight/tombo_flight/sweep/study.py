"""A sweep as data: what is varied, the flight of a number, and the columns of its table."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from tombo_bag.flight import Flight
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import check_seed
from tombo_flight.flight_output import flight_summary
from tombo_flight.json_text import plain
from tombo_flight.process.study import StudiedScenario, read_scenario
from tombo_flight.scenario import Scenario

DESIGNS = ("full", "lhs", "sobol")
"""Full factorial, Latin hypercube, Sobol sequence (scrambled)."""
MOST_LEVELS = 10_000
_DRAWN_SEED = 0
"""Of Latin hypercube and Sobol: the same command has the same points."""
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"({_NUMBER}):({_NUMBER})(?::({_NUMBER}))?")
_ACCEPTED = "accepted: KEY=A:B:STEP or KEY=V1,V2,..., as in vehicle.mass=1.1:1.7:0.1"


@dataclass(frozen=True)
class Axis:
    """One setting of the scenario that is varied: over levels, or between two numbers."""

    key: str
    """As of --set: "vehicle.mass"."""
    levels: tuple[str, ...] = ()
    """Values as texts of --set."""
    low: float = 0.0
    high: float = 0.0
    """Ends, where there are no levels."""

    @property
    def numeric(self) -> bool:
        """Whether its values are numbers."""
        return all(re.fullmatch(_NUMBER, level) for level in self.levels)

    @property
    def ends(self) -> tuple[str, ...]:
        """Values that are to be possible: all levels, or both ends."""
        return self.levels or (number_text(self.low), number_text(self.high))

    def at(self, share: float) -> str:
        """Return the value at a share (0 to 1) of the axis."""
        if self.levels:
            return self.levels[min(int(share * len(self.levels)), len(self.levels) - 1)]
        return number_text(self.low + share * (self.high - self.low))


@dataclass(frozen=True)
class SweepDesign:
    """The points of a sweep."""

    axes: tuple[Axis, ...]
    kind: str = "full"
    """One of `DESIGNS`."""
    samples: int = 0
    """Points of a Latin hypercube or a Sobol sequence."""

    def __post_init__(self) -> None:
        """Refuse a design that has no points.

        Raises:
            InputError: unknown kind, a key or a value twice, a range without a step, or samples
                that do not fit.
        """
        if self.kind not in DESIGNS:
            raise unknown_name("--design", self.kind, DESIGNS)
        keys = [axis.key for axis in self.axes]
        for key in keys:
            if keys.count(key) > 1:
                raise InputError(f"{key} is varied twice; accepted: once")
        for axis in self.axes:
            values = [float(level) if axis.numeric else level for level in axis.levels]
            for value, level in zip(values, axis.levels, strict=True):
                if values.count(value) > 1:
                    raise InputError(f"{axis.key}: {level} is given twice; accepted: once")
        if self.kind == "full":
            if self.samples:
                raise InputError("--samples: accepted: with --design lhs or sobol")
            for axis in self.axes:
                if not axis.levels:
                    given = f"{axis.key}={axis.low:g}:{axis.high:g}"
                    raise InputError(f"{given}: no step; {_ACCEPTED}, or --design lhs")
        elif not self.axes:
            raise InputError(f"--design {self.kind}: nothing is varied; {_ACCEPTED}")
        elif not 1 <= self.samples <= 10_000_000:
            raise InputError(
                f"--design {self.kind}: {self.samples} samples; accepted: --samples N, at least 1"
            )

    @property
    def points(self) -> int:
        """Number of points."""
        return self.samples or math.prod(len(axis.levels) for axis in self.axes)

    def settings(self) -> Points:
        """Return the points, to be asked for by number."""
        return Points(self)


class Points:
    """Settings of each point of a design; nothing but the drawn numbers is kept."""

    def __init__(self, design: SweepDesign) -> None:
        self._design = design
        self._drawn = _drawn(design) if design.samples else None

    def __getitem__(self, point: int) -> dict[str, str]:
        """Return key → text of the value; in a full design the last axis runs fastest."""
        axes = self._design.axes
        if self._drawn is not None:
            row = self._drawn[point]
            return {axis.key: axis.at(float(u)) for axis, u in zip(axes, row, strict=True)}
        found = {}
        for axis in reversed(axes):
            point, level = divmod(point, len(axis.levels))
            found[axis.key] = axis.levels[level]
        return {axis.key: found[axis.key] for axis in axes}


def _drawn(design: SweepDesign) -> Any:
    """Return an (samples, axes) array of shares from 0 to 1."""
    from scipy.stats import qmc

    count = len(design.axes)
    if design.kind == "lhs":
        return qmc.LatinHypercube(count, seed=_DRAWN_SEED).random(design.samples)
    whole = math.ceil(math.log2(design.samples)) if design.samples > 1 else 0
    return qmc.Sobol(count, seed=_DRAWN_SEED).random_base2(whole)[: design.samples]


def parse_axis(text: str) -> Axis:
    """Return the axis that `KEY=A:B:STEP`, `KEY=A:B` or `KEY=V1,V2,...` means; ends included.

    Raises:
        InputError: of none of these forms.
    """
    key, sign, values = text.partition("=")
    if not sign or not key.strip() or not values.strip():
        raise InputError(f"'{text}': {_ACCEPTED}")
    return axis_of(key.strip(), values.strip())


def axis_of(key: str, values: str | Sequence[Any]) -> Axis:
    """Return the axis of a key: from the text behind KEY=, or from its values.

    Raises:
        InputError: there are none, or too many.
    """
    if not isinstance(values, str):
        levels = tuple(value_text(value) for value in values)
        if not levels:
            raise InputError(f"{key}: no values; accepted: at least one")
        return Axis(key, levels)
    text = f"{key}={values}"
    found = _RANGE.fullmatch(values)
    if found is None:
        parts = tuple(part.strip() for part in values.split(","))
        if not all(parts):
            raise InputError(f"'{text}': an empty value; {_ACCEPTED}")
        return Axis(key, parts)
    low, high = float(found[1]), float(found[2])
    if low > high:
        raise InputError(f"'{text}': {low:g} is above {high:g}; {_ACCEPTED}")
    if found[3] is None:
        return Axis(key, (), low, high)
    step = float(found[3])
    if not step > 0.0 or (high - low) / step >= MOST_LEVELS:
        raise InputError(
            f"'{text}': STEP {step:g}; accepted: above 0, {MOST_LEVELS} values at most"
        )
    count = math.floor((high - low) / step + 1e-9) + 1
    return Axis(key, tuple(number_text(round(low + i * step, 12)) for i in range(count)))


def number_text(value: float) -> str:
    """Return a number as --set reads it back to the last digit."""
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def value_text(value: Any) -> str:
    """Return a plain value as --set reads it."""
    if isinstance(value, bool) or value is None:
        return "null" if value is None else str(value).lower()
    if isinstance(value, str):
        return value
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, int | float):
        return number_text(value) if math.isfinite(value) else str(value)
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{k}: {value_text(v)}' for k, v in value.items())}}}"
    return f"[{', '.join(value_text(inner) for inner in value)}]"


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
            *(
                "collision_time_s",
                "detection_time_s",
                "detection_latency_s",
                "contact_known_s",
                "crash_time_s",
            ),
            *("detection_confidence", "max_falling_distance_m", "unstable_phase_s"),
            *("recovery_time_s", "settled_error_m", "max_tilt_rad", "duration_s"),
            *("hover_rms_m", "approach_rms_m", "peak_contact_force_n"),
            *("wall_time_s", "real_time_factor"),
        ),
        "number",
    ),
}
"""Figures of a summary (docs/figures.md) → kind of their column."""
LEFT_OUT = ("tombo_version", "model", "seed", "recorded_messages")
"""Keys of a summary that are the same for all flights, or stand in columns of their own."""
WALL_COLUMNS = ("wall_time_s", "real_time_factor")
"""What differs between two sweeps of the same study."""
_AXES = ("x", "y", "z")


def row_of(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return the columns of a summary; a vector has one for each of x, y and z."""
    row: dict[str, Any] = {}
    for name, kind in FIGURES.items():
        value = summary[name]
        if kind == "vector":
            parts = (None, None, None) if value is None else value
            row |= {f"{name}_{a}": part for a, part in zip(_AXES, parts, strict=True)}
        else:
            row[name] = value
    return row


def figures_of(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures of a summary that columns are of: the inverse of `row_of`."""
    figures: dict[str, Any] = {}
    for name, kind in FIGURES.items():
        if kind == "vector":
            parts = [row[f"{name}_{a}"] for a in _AXES]
            figures[name] = None if all(part is None for part in parts) else parts
        else:
            figures[name] = row[name]
    return figures


def figure_columns(names: Iterable[str] = FIGURES) -> dict[str, str]:
    """Return the columns that `row_of` gives of some figures, with their kinds."""
    columns: dict[str, str] = {}
    for name in names:
        kind = FIGURES[name]
        parts = [f"{name}_{a}" for a in _AXES] if kind == "vector" else [name]
        columns |= dict.fromkeys(parts, "number" if kind == "vector" else kind)
    return columns


MOST_FLIGHTS = 10**9
_KEYS = (
    *("tombo_version", "scenario", "seeds", "settings", "label", "values", "model", "vehicle"),
    "imports",
)
"""Of `sweep.json`, with those of the design."""


@dataclass(frozen=True, kw_only=True)
class SweepStudy(StudiedScenario):
    """A scenario, what is varied, and the seeds that each point is flown with.

    Flight n has point n // seeds and seed first + n % seeds.
    """

    kind = "sweep"
    summary_only = True
    design: SweepDesign
    seeds: tuple[int, int]
    """First, and the one after the last."""

    @property
    def flights(self) -> int:
        """How many flights there are."""
        return self.design.points * (self.seeds[1] - self.seeds[0])

    @cached_property
    def points(self) -> Points:
        """The settings of each point."""
        return self.design.settings()

    def place(self, flight: int) -> tuple[int, int]:
        """Return point and seed of a flight."""
        point, seed = divmod(flight, self.seeds[1] - self.seeds[0])
        return point, self.seeds[0] + seed

    def scenario_at(self, point: int) -> Scenario:
        """Return what is flown at a point.

        Raises:
            InputError: it is no scenario.
        """
        return self.scenario_with(self._varied(point))

    def _varied(self, point: int) -> list[str]:
        return [f"{key}={text}" for key, text in self.points[point].items()]

    @property
    def keys(self) -> range:
        """The keys of its flights."""
        return range(self.flights)

    def columns(self) -> dict[str, str]:
        """Return the columns of the table."""
        axes = {axis.key: "number" if axis.numeric else "text" for axis in self.design.axes}
        place = dict.fromkeys(("flight", "point", "seed"), "count")
        return {**place, **axes, **figure_columns(), "error": "text"}

    def labels(self, point: int) -> dict[str, Any]:
        """Return number and settings of a point."""
        texts = self.points[point]
        numeric = {axis.key for axis in self.design.axes if axis.numeric}
        axes = {key: float(text) if key in numeric else text for key, text in texts.items()}
        return {"point": point, **axes}

    def figures(self, flight: Flight, scenario: Scenario) -> dict[str, Any]:
        """Return the columns of a flight."""
        return row_of(flight_summary(flight))

    def command(self, flight: int) -> str:
        """Return the command line that flies a flight again."""
        point, seed = self.place(flight)
        return self.command_with(self._varied(point), seed)

    def as_mapping(self) -> dict[str, Any]:
        """Return it in the types of JSON: what `sweep.json` says."""
        values: dict[str, Any] = plain(asdict(self))
        return {**{key: values[key] for key in _KEYS}, **values["design"]}


def new_sweep(
    scenario: str,
    design: SweepDesign,
    seeds: range,
    settings: tuple[str, ...] = (),
    model: str | None = None,
    vehicle: str | None = None,
) -> SweepStudy:
    """Read and check a sweep: the scenario, and each value of an axis by itself.

    Raises:
        InputError: as `load_scenario`, or there are too many flights.
    """
    for seed in (seeds.start, seeds.stop - 1) if seeds else ():
        check_seed("seed", seed)
    base = read_scenario(scenario, settings, model, vehicle)
    sweep = SweepStudy(**base, design=design, seeds=(seeds.start, seeds.stop))
    if not 1 <= sweep.flights <= MOST_FLIGHTS:
        raise InputError(f"{sweep.flights} flights; accepted: 1 to {MOST_FLIGHTS}")
    sweep.scenario_at(0)
    for axis in design.axes:
        for text in axis.ends:
            sweep.scenario_with([f"{axis.key}={text}"])
    return sweep

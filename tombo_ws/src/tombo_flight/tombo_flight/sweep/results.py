"""Results of a sweep, as plain values and as cells of tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pandas as pd

from tombo_dynamics.arrays import Array
from tombo_flight.report.figures import is_paper_flight
from tombo_flight.scenario import as_mapping
from tombo_flight.sweep.design import Axis
from tombo_flight.sweep.folder import KEY, OUTCOME, SweepFolder
from tombo_flight.sweep.statistics import crash_rate, flight_statistics, rank_correlation
from tombo_flight.sweep.study import CASE, REACTION

MOST_POINTS = 1000
"""Points whose figures are given one by one; of more, and of drawn ones, the table has all."""
_MOST_LEVELS = 40
"""Values of a setting that are shown one by one; more are put together."""
_BINS = 12
_RANKED = ("crashed", "max_falling_distance_m", "recovery_time_s")
"""Figures for which it is said what decides them."""
Result = Mapping[str, Any]


def cells_of(axis: Axis | None, values: pd.Series[Any]) -> tuple[list[str], pd.Series[Any]]:
    """Sort (N,) values of a setting into its levels, or bins of equal width or probability.

    Returns:
        The names of the cells, and the cell (N,) of each value.
    """
    levels = list(values.unique()) if axis is None else list(axis.levels)
    if levels and len(levels) <= _MOST_LEVELS:
        keys = [float(v) for v in levels] if axis and axis.numeric else levels
        return [str(v) for v in levels], values.map({key: n for n, key in enumerate(keys)})
    shares: Array = np.arange(_BINS + 1, dtype=np.float64) / _BINS
    edges: Array = values.min() + shares * np.ptp(values)
    if axis is not None and axis.distribution:
        edges = np.quantile(values, shares)
    cell = np.clip(np.searchsorted(edges, values, "right") - 1, 0, _BINS - 1)
    names = [f"{a:.4g} to {b:.4g}" for a, b in pairwise(edges)]
    return names, pd.Series(cell, index=values.index)


class SweepFlights:
    """The flights of a sweep that were flown, a row each."""

    def __init__(self, opened: SweepFolder) -> None:
        """Read them from the table."""
        self.study = opened.study
        table = opened.table().set_index(KEY)
        flown = table["error"].isna()
        self.flown = table[flown]
        self.errors: dict[int, str] = table.loc[~flown, "error"].to_dict()
        """Number of a flight that could not be flown → the reason."""

    def results(self) -> dict[str, Any]:
        """Return the result of the sweep.

        Returns:
            scenario, seeds, flights, of_paper; `aggregate`: `flight_statistics` of all flights;
            `points`: of each point of a full design what is varied, the command of its first
            flight, and `flight_statistics`; `settings`: crash rate for each value of each setting;
            `decides`: rank correlation of each setting that is a number with figures; `worst`:
            flight, seed, varied values, command; `not_flown`: how many, and the reason of the
            first; `outcome` in a line.
        """
        study, errors = self.study, self.errors
        first = min(errors, default=None)
        aggregate = flight_statistics(self.flown)
        not_flown = f", {len(errors)} not flown" if errors else ""
        return {
            "scenario": study.label,
            "tombo_version": study.tombo_version,
            "model": study.model or None,
            "seeds": list(study.seeds),
            "varied": study.keys,
            "flights": study.flights,
            "of_paper": study.points == 1 and is_paper_flight(as_mapping(study.scenario_at(0))),
            "aggregate": aggregate,
            "points": self._points(),
            "settings": self._settings(),
            "decides": self._decides(),
            "worst": self._worst(),
            "not_flown": {
                "flights": len(errors), "first": first,
                "why": None if first is None else errors[first],
            },
            OUTCOME: f"{aggregate['crashed']} of {study.flights} crashed{not_flown}",
        }  # fmt: skip

    def _settings(self) -> list[dict[str, Any]]:
        """Return the crash rate for each value of each setting."""
        axes = {axis.key: axis for axis in self.study.design.axes}
        crashed, rows = self.flown["crashed"], []
        for key in self.study.keys if crashed.size else ():
            labels, cell = cells_of(axes.get(key), self.flown[key])
            for n, label in enumerate(labels):
                rows.append({"key": key, "value": label, **crash_rate(crashed[cell == n])})
        return rows

    def _points(self) -> list[dict[str, Any]]:
        study = self.study
        if study.design.samples or study.points > MOST_POINTS:
            return []
        points = []
        for point in range(study.points):
            points.append({
                "varied": study.varied(point),
                "command": study.command(point * study.seeds_each),
                **flight_statistics(self.flown[self.flown["point"] == point]),
            })  # fmt: skip
        return points

    def _decides(self) -> list[dict[str, Any]]:
        """Return the rank correlations, the strongest first."""
        kinds = self.study.columns()
        rows = [
            {"key": key, "figure": figure, **found}
            for key in self.study.keys
            if kinds[key] == "number"
            for figure in _RANKED
            if (found := rank_correlation(self.flown[key], self.flown[figure])) is not None
        ]
        return sorted(rows, key=lambda row: -abs(row["rho"]))

    def _worst(self) -> dict[str, Any] | None:
        """Return the flight that crashed, of several the one that fell farthest; None: none."""
        fall = self.flown["max_falling_distance_m"].fillna(-1.0)
        crashed = self.flown["crashed"].astype(bool)
        order = np.lexsort((fall, crashed))
        if not order.size or (not crashed.iloc[order[-1]] and fall.iloc[order[-1]] < 0.0):
            return None
        flight = int(self.flown.index[order[-1]])
        point, seed = self.study.place(flight)
        return {
            "flight": flight,
            "seed": seed,
            "crashed": bool(crashed[flight]),
            "varied": self.study.varied(point),
            "command": self.study.command(flight),
        }


def setting_words(varied: Mapping[str, str]) -> str:
    """Return a text of the varied values of a point."""
    return ", ".join(v if key == CASE else f"{key} = {v}" for key, v in varied.items()) or "all"


def crashed_text(result: Result) -> str:
    """Return how many of the flights crashed, with the interval of the rate."""
    if not result["flights"]:
        return "–"
    low, high = (100.0 * end for end in result["crash_rate_95"])
    return f"{result['crashed']} of {result['flights']} ({low:.1f} to {high:.1f} %)"


HEAD: Final = (
    *("crashed", "recovered", "fall [m]", "unstable [s]", "recovery [s]"),
    *("strikes", "peak force [N]", "known, 95 % [ms]", "rotor right", "false alarms/h"),
)
"""Columns of `point_rows` behind the first."""
MEANING: Final = (
    "Crashed: share of the flights, with its exact 95 % interval. Fall, unstable and recovery: "
    "median, and 5 to 95 % of the flights that have the figure. Strikes: mean of a flight. Peak "
    "force: largest of the obstacle on the vehicle, median. Known: from touch until the reaction "
    "knows of it, 95th percentile. Rotor right: of the flights in which the reaction named a "
    "rotor. Definitions: docs/figures.md."
)


def point_rows(results: Result) -> Iterator[tuple[str, list[list[str]]]]:
    """Yield groups of rows, a row for each point: its name, and the cells of `HEAD`.

    Where reactions are compared, a group is what is flown with each of them, and a row is named by
    its reaction; else all points are one group without a name.
    """
    groups: dict[str, list[list[str]]] = {}
    for point in results["points"]:
        varied = dict(point["varied"])
        name = varied.pop(REACTION, None)
        group = "" if name is None else setting_words(varied)
        groups.setdefault(group, []).append([name or setting_words(varied), *_cells(point)])
    yield from groups.items()


def _cells(result: Result) -> list[str]:
    share = result["struck_rotor_right"]
    return [
        crashed_text(result),
        f"{result['recovered']} of {result['collided']}" if result["collided"] else "–",
        *(
            _spread(result[name])
            for name in ("max_falling_distance_m", "unstable_phase_s", "recovery_time_s")
        ),
        _figure(result["strikes"]["mean"], 1),
        _figure(result["peak_contact_force_n"]["median"], 0),
        _figure(result["contact_known_s"]["p95"], 0, 1e3),
        "–" if share is None else f"{100.0 * share:.1f} % of {result['struck_rotor_named']}",
        _figure(result["false_alarms_per_hour"], 2),
    ]


def _spread(values: Mapping[str, float | None]) -> str:
    if not values["count"]:
        return "–"
    median, low, high = (_figure(values[key], 2) for key in ("median", "p05", "p95"))
    return f"{median} ({low} to {high})"


def _figure(value: float | None, digits: int, factor: float = 1.0) -> str:
    return "–" if value is None else f"{factor * value:.{digits}f}"

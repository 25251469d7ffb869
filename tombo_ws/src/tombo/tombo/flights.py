"""One flight, flown here or read from a recording, and its arrays as pandas tables."""

from __future__ import annotations

import base64
import copy
import dataclasses
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.vehicle import ROTOR_NAMES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from tombo_bag.flight import Flight
    from tombo_collision.reactions import Reaction
    from tombo_flight.scenario import Scenario


_PARTS: Mapping[str, Sequence[str]] = {
    "contact": ("touching", "rotor", "x", "y", "z"),
    "battery": ("charge_used", "current", "voltage"),
}
_OF_ROTORS = ("rotor_speed", "rotor_thrust", "rotor_command", "motor_command", "fold", "damage")
_XYZW = ("x", "y", "z", "w")


@dataclass(frozen=True, repr=False)
class FlightTables:
    """A flight with its tables. World `map` ENU, body `base_link` FLU, SI units, rad, xyzw."""

    record: Flight
    """The arrays themselves, for who needs no tables; not a public interface."""

    @property
    def summary(self) -> dict[str, Any]:
        """The figures of `summary.json` (docs/figures.md)."""
        return self.record.summary

    @cached_property
    def scenario(self) -> dict[str, Any]:
        """A copy of the complete scenario flown, with the values that the seed drew."""
        return copy.deepcopy(self.record.scenario)

    @cached_property
    def log(self) -> pd.DataFrame:
        """The truth and the autopilot's set points at 1 kHz; index t [s].

        Columns as "position.x", "rates.z", "rotor_speed.front_left"; units in `tombo_sim`'s
        LogRow.
        """
        return frame_of(self.record.log, self.record.t)

    @cached_property
    def mocap(self) -> pd.DataFrame:
        """The samples of the motion capture that arrived; index: time of capture [s]."""
        from tombo_flight.flight_metrics import statistic_of_poses

        poses = self.record["/mocap/pose"]
        columns = {
            "arrival": poses.arrival,
            "position": poses["position"].values,
            "attitude": poses["attitude"].values,
            "statistic": statistic_of_poses(self.record),
        }
        return frame_of(columns, poses.t)

    @cached_property
    def events(self) -> pd.DataFrame:
        """What happened, in order of time: time_s, kind, text, and more of some kinds."""
        import pandas as pd

        return pd.DataFrame(self.record.events, columns=_columns(self.record.events))

    @property
    def topics(self) -> list[str]:
        """Topics of sensors, cores and truth, for `table`."""
        return sorted(self.record.topics)

    def table(self, topic: str) -> pd.DataFrame:
        """Return the messages of a topic; index t [s].

        Raises:
            InputError: there is no such topic.
        """
        if topic not in self.topics:
            raise unknown_name("topic", topic, self.topics)
        messages = self.record[topic]
        columns = {name: series.values for name, series in messages.items()}
        return frame_of(columns, messages.arrival)

    def plot(self) -> Figure:
        """Return the figure of `flight.png`."""
        from tombo_flight.report.flight_plot import draw_flight

        return draw_flight(self.record)

    def report(self, path: str | Path, *, replace: bool = False) -> Path:
        """Write `report.html`, which needs nothing but a browser.

        Raises:
            InputError: the file is there and may not be replaced, or can't be written.
        """
        from tombo_flight.report.flight_report import report_page
        from tombo_flight.report.page import write_page

        with new_file(path, replace=replace) as unfinished:
            write_page(unfinished, report_page(self.record))
        return Path(path)

    def to_mcap(self, path: str | Path, *, replace: bool = False) -> Path:
        """Write the recording, `flight.mcap`, to the byte as `tombo fly` does.

        Raises:
            InputError: the file is there and may not be replaced, or can't be written; or the
                flight was itself read from a recording.
        """
        from tombo_flight.flight_output import write_mcap

        if self.record.source:
            raise InputError(
                "to_mcap: this flight is a recording already; accepted: one flown here"
            )
        with new_file(path, replace=replace) as unfinished:
            write_mcap(self.record, unfinished)
        return Path(path)

    def __repr__(self) -> str:
        from tombo_flight.report.figures import FlightOutcome

        what = f"{self.summary['scenario']!r}, seed={self.summary['seed']}"
        outcome = FlightOutcome.of(self.summary).value
        return f"Flight({what}: {outcome}, {self.summary['duration_s']:.1f} s)"

    def _repr_html_(self) -> str:
        """Return the figures of a flight and its picture, for notebooks."""
        from tombo_flight.report.style import figure_bytes

        shown = {key: value for key, value in self.summary.items() if value is not None}
        png = base64.b64encode(figure_bytes(self.plot())).decode("ascii")
        picture = f'<img style="max-width:100%" src="data:image/png;base64,{png}">'
        return html_table(repr(self), shown) + picture


def fly(
    scenario: str = "paper_collision",
    seed: int = 0,
    *,
    reaction: str | Reaction | None = None,
    model: str | None = None,
    vehicle: str | None = None,
    **settings: Any,
) -> FlightTables:
    """Fly a scenario, headless: the flight of `tombo fly`, to the last bit.

    Args:
        scenario: a name of `tombo list scenarios`, or a YAML file.
        seed: all random draws come from it.
        reaction: to collisions, in place of the scenario's: a name, or one of your own.
        model: a model.yaml, whose effects are merged with those of the scenario.
        vehicle: a name of `tombo vehicle list`, or a vehicle file.
        **settings: values of the scenario, keys as of --set: `**{"vehicle.mass": 1.4}`.

    Raises:
        InputError: as of `tombo fly`; names the value and the accepted ones.
    """
    from tombo_flight.flight import fly_scenario
    from tombo_flight.flight_output import flight_summary

    chosen = scenario_of(scenario, texts_of(settings), reaction, model, vehicle)
    record = fly_scenario(chosen, seed)
    return FlightTables(dataclasses.replace(record, summary=flight_summary(record)))


def scenario_of(
    name: str,
    settings: Sequence[str],
    reaction: str | Reaction | None,
    model: str | None,
    vehicle: str | None,
) -> Scenario:
    """Return the checked scenario; arguments as of `fly`."""
    from tombo_flight.scenario import load_scenario

    if reaction is None or isinstance(reaction, str):
        named = [f"reaction={{name: {reaction}}}"] if reaction else []
        return load_scenario(name, [*named, *settings], model, vehicle)
    return dataclasses.replace(load_scenario(name, settings, model, vehicle), reaction=reaction)


def texts_of(settings: dict[str, Any]) -> list[str]:
    """Return settings as texts of --set."""
    from tombo_flight.sweep.design import value_text

    return [f"{key}={value_text(value)}" for key, value in settings.items()]


def _columns(events: Sequence[dict[str, Any]]) -> list[str]:
    """Return the keys of all events, each once, those of all first."""
    columns = dict.fromkeys(("time_s", "kind", "text"))
    for event in events:
        columns |= dict.fromkeys(event)
    return list(columns)


def frame_of(columns: Mapping[str, Any], time_s: Any) -> pd.DataFrame:
    """Return a table over time: arrays (N,) and (N, k) by name, k columns "name.part" for each.

    Args:
        columns: name → array.
        time_s: (N,) the index [s].
    """
    import pandas as pd

    flat: dict[str, Any] = {}
    for name, values in columns.items():
        flat |= dict(_flat(name, np.asarray(values)))
    return pd.DataFrame(flat, index=pd.Index(np.asarray(time_s), name="t"))


def html_table(title: str, rows: Mapping[str, Any]) -> str:
    """Return names and values as HTML, for notebooks."""
    lines = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(_shown(value))}</td></tr>"
        for name, value in rows.items()
    )
    return f"<b>{escape(title)}</b><table>{lines}</table>"


def _flat(name: str, values: Any) -> Iterator[tuple[str, Any]]:
    """Yield the columns (N,) of one array."""
    if values.dtype.names is not None:
        for part in values.dtype.names:
            yield from _flat(f"{name}.{part}", values[part])
    elif values.ndim == 1:
        yield name, values
    elif values.ndim == 2 and values.shape[1] == 1:
        yield name, values[:, 0]
    else:
        wide = np.ascontiguousarray(values.reshape(values.shape[0], -1).T)
        for part, column in zip(_parts(name, wide.shape[0]), wide, strict=True):
            yield f"{name}.{part}", column


def _parts(name: str, width: int) -> Sequence[str]:
    last = name.rpartition(".")[2]
    if last in _PARTS and len(_PARTS[last]) == width:
        return _PARTS[last]
    if last in _OF_ROTORS and width == len(ROTOR_NAMES):
        return ROTOR_NAMES
    return _XYZW[:width] if width in (3, 4) else [str(k) for k in range(width)]


def _shown(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(_shown(part) for part in value) + ")"
    return str(value)


@contextmanager
def new_file(path: str | Path, *, replace: bool) -> Iterator[Path]:
    """Give the name of a hidden file in the folder of `path`, which replaces it at the end.

    Raises:
        InputError: it is there and may not be replaced, or can't be written.
    """
    target = Path(path)
    if os.path.lexists(target) and not replace:
        raise InputError(f"'{target}' exists; accepted: another name, or replace=True")
    unfinished = target.with_name(f".{target.name}.unfinished-{os.getpid()}")
    try:
        yield unfinished
        if replace:
            os.replace(unfinished, target)
        else:
            os.link(unfinished, target)  # unlike a rename it never replaces
    except OSError as error:
        raise InputError(
            f"'{target}' can't be written ({error.strerror}); accepted: a new file in a folder "
            "that can be written"
        ) from error
    finally:
        unfinished.unlink(missing_ok=True)

"""Reads measured flights and diagnoses flights and thrust stands; the results are tables.

Users know the classes as `tombo.Flight`, `tombo.Log` and `tombo.Diagnosis`.
"""

from __future__ import annotations

import datetime
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tombo.flights import FlightTables, frame_of, html_table

if TYPE_CHECKING:
    import pandas as pd

    from tombo_bag.flight import Flight
    from tombo_diagnosis.diagnosis import Diagnosis
    from tombo_diagnosis.report.files import NominalReference

Paths = str | Path | Sequence[str | Path]


@dataclass(frozen=True, repr=False)
class LogTables:
    """A measured flight: channels with their own times, as far as the file has them."""

    flight: Flight
    """The arrays themselves; not a public interface."""

    @property
    def channels(self) -> dict[str, str]:
        """Name → unit and meaning of each channel that is there."""
        from tombo_bag.channels import CHANNELS

        return {
            name: f"{CHANNELS[name].unit}: {CHANNELS[name].doc}" for name in self.flight.series
        }

    @cached_property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Channel → table; index t [s] on the flight's own clock."""
        return {
            name: frame_of({name: series.values}, series.t)
            for name, series in self.flight.series.items()
        }

    @cached_property
    def findings(self) -> pd.DataFrame:
        """Notes of the reader, a row each, with the fields of `tombo_bag.flight.Finding`."""
        import pandas as pd

        return pd.DataFrame([vars(finding) for finding in self.flight.findings])

    def __repr__(self) -> str:
        channels = ", ".join(self.channels)
        return f"Log({self.flight.source!r}: {self.flight.duration_s:.1f} s, {channels})"

    def _repr_html_(self) -> str:
        """Return the channels as HTML, for notebooks."""
        rows = {
            name: f"{len(self.flight.series[name].t)} samples, {text}"
            for name, text in self.channels.items()
        }
        return html_table(f"{self.flight.source}, {self.flight.duration_s:.1f} s", rows)


@dataclass(frozen=True, repr=False)
class DiagnosisTables:
    """Errors of a simulation against measurements, and their causes."""

    diagnosis: Diagnosis
    """The whole result; not a public interface."""
    against: NominalReference | None = None
    """The model that measured flights were compared with; None: of a thrust stand."""

    @property
    def verdict(self) -> str:
        """One of none, named, set, partly_explained, unknown (docs/diagnosis.md)."""
        return self.diagnosis.verdict

    @property
    def summary(self) -> str:
        """The verdict in a sentence or two."""
        return self.diagnosis.summary

    @cached_property
    def causes(self) -> pd.DataFrame:
        """The causes of the errors, a row for each parameter.

        Value and 95 % interval low to high are in `unit`; confidence is a probability, 0 to 1.
        """
        import pandas as pd

        of_parameter = ("name", "value", "low", "high", "unit")
        rows = [
            {
                "effect": cause.effect,
                **{name: getattr(parameter, name) for name in of_parameter},
                "confidence": cause.confidence,
                "signature": cause.signature,
            }
            for cause in self.diagnosis.causes
            for parameter in cause.theta
        ]
        columns = ["effect", *of_parameter, "confidence", "signature"]
        return pd.DataFrame(rows, columns=columns).rename(columns={"name": "parameter"})

    @cached_property
    def candidates(self) -> pd.DataFrame:
        """All effects that were tried, the most probable first.

        `evidence`: log Bayes factor against no cause; `excited`: the flights would show it.
        """
        import pandas as pd

        columns = ("effect", "probability", "gain", "evidence", "excited", "remark")
        rows = [[getattr(score, name) for name in columns] for score in self.diagnosis.candidates]
        return pd.DataFrame(rows, columns=list(columns))

    def save(self, folder: str | Path, *, replace: bool = False) -> Path:
        """Write what `tombo diagnose` writes: report.html, diagnosis.json, model.yaml, picture.

        Raises:
            InputError: the folder is not empty and may not be replaced, or it is of a stand.
        """
        from tombo_diagnosis.report.files import DIAGNOSIS_FILES, write_diagnosis
        from tombo_dynamics.errors import InputError
        from tombo_flight.process.output_folder import open_output

        if self.against is None:
            raise InputError("save: of a thrust stand; accepted: tombo propeller diagnose -o DIR")
        with open_output(Path(folder), replace=replace, results=DIAGNOSIS_FILES) as output:
            write_diagnosis(output, self.diagnosis, self.against)
            output.publish()
        return Path(folder)

    def __repr__(self) -> str:
        return f"Diagnosis({self.verdict}: {self.summary})"

    def _repr_html_(self) -> str:
        """Return verdict and causes as HTML, for notebooks."""
        rows = {
            f"{cause.effect}": ", ".join(f"{p.name} {p.value:.4g} {p.unit}" for p in cause.theta)
            for cause in self.diagnosis.causes
        }
        return html_table(f"{self.verdict}: {self.summary}", rows)


def read(path: str | Path, mapping: str | Path | None = None) -> FlightTables | LogTables:
    """Read a recording, a PX4 log or a table.

    Args:
        path: MCAP, rosbag2 folder, ROS 1 bag, PX4 ULog, telemetry log, CSV.
        mapping: file, or name of a shipped one, that says what a table's columns are.

    Returns:
        A `Flight`, if the suite itself recorded it with its ground truth; else a `Log`.

    Raises:
        InputError: it can't be read; names the reason and the accepted formats.
    """
    from tombo_bag.flight_time import FLIGHT_METADATA
    from tombo_bag.recording import Recording
    from tombo_flight.recorded_flight import read_flight
    from tombo_logs.readers.csv_mapping import load_mapping
    from tombo_logs.readers.log_reader import kind_of, read_log

    place = Path(path)
    if place.is_dir() or kind_of(place) == "recording":
        with Recording(place) as recording:
            of_suite = FLIGHT_METADATA in recording.metadata
        if of_suite and mapping is None:
            return FlightTables(read_flight(place))
    columns = None if mapping is None else load_mapping(mapping)
    return LogTables(read_log(place, place.name.split(".")[0], columns))


def diagnose(
    logs: Paths,
    *,
    mapping: str | None = None,
    model: str | Path | None = None,
    vehicle: str | None = None,
    topics: Mapping[str, str] | None = None,
) -> DiagnosisTables:
    """Say what the simulation gets wrong in measured flights, and name the cause.

    Args:
        logs: flights of one vehicle.
        mapping: file, or name of a shipped one, that says what a table's columns are.
        model: a model.yaml that the flights are compared with.
        vehicle: name or file of the vehicle that flew.
        topics: topic as recorded → name in this suite.

    Raises:
        InputError: a log, the mapping, the vehicle or the model can't be used.
    """
    from tombo_diagnosis.flight.diagnose import diagnose_logs
    from tombo_diagnosis.report.files import NominalReference

    diagnosis, label, base = diagnose_logs(
        _paths(logs), None if model is None else Path(model), mapping, topics or {}, vehicle,
        time.perf_counter,
    )  # fmt: skip
    today = datetime.date.today().isoformat()
    return DiagnosisTables(diagnosis, NominalReference(label, today, base, vehicle or ""))


def stand(
    tables: Paths,
    *,
    mapping: str | None = None,
    conf: int = 13,
    law: str = "repaired",
    plain: bool = False,
) -> DiagnosisTables:
    """Say what the propeller model gets wrong in runs of a thrust stand.

    Args:
        tables: CSV files (docs/stand.md).
        mapping: file, or name of a shipped one, that says what the columns are.
        conf: configuration of tables that do not say theirs.
        law: of the nodus: published, repaired or consistent.
        plain: any other propeller: held against T = k omega^2.

    Raises:
        InputError: a table, the mapping, the configuration or the law can't be used.
    """
    from tombo_diagnosis.stand.diagnose import diagnose_stand
    from tombo_diagnosis.stand.tables.table_reader import read_stand
    from tombo_flight.progress import no_progress

    runs = [read_stand(path, mapping) for path in _paths(tables)]
    result = diagnose_stand(runs, conf, law, plain, no_progress, time.perf_counter)
    return DiagnosisTables(result.diagnosis)


def _paths(given: Paths) -> list[Path]:
    paths: Iterable[Any] = [given] if isinstance(given, str | Path) else given
    return [Path(path) for path in paths]

"""Measured flights and thrust stands: read, and diagnosed."""

from __future__ import annotations

import datetime
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tombo.flights import Flight
from tombo.tables import frame_of, html_table

if TYPE_CHECKING:
    import pandas as pd

    from tombo_bag.flight import Flight as Measured
    from tombo_diagnosis.diagnosis import Diagnosis as Found
    from tombo_diagnosis.report.diagnosis_output import NominalReference

Paths = str | Path | Sequence[str | Path]


@dataclass(frozen=True, repr=False)
class Log:
    """A measured flight: channels with their own times, as far as the file has them."""

    log: Measured
    """The arrays themselves; not a public interface."""

    @property
    def channels(self) -> dict[str, str]:
        """Name → unit and meaning of each channel that is there."""
        from tombo_bag.channels import CHANNELS

        return {name: f"{CHANNELS[name].unit}: {CHANNELS[name].doc}" for name in self.log.series}

    @cached_property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Channel → table; index t [s] on the flight's own clock."""
        return {
            name: frame_of({name: series.values}, series.t)
            for name, series in self.log.series.items()
        }

    @cached_property
    def findings(self) -> pd.DataFrame:
        """What the reader noticed."""
        import pandas as pd

        return pd.DataFrame([vars(finding) for finding in self.log.findings])

    def __repr__(self) -> str:
        return f"Log({self.log.source!r}: {self.log.duration_s:.1f} s, {', '.join(self.channels)})"

    def _repr_html_(self) -> str:
        """Return the channels as HTML, for notebooks."""
        rows = {
            name: f"{len(self.log.series[name].t)} samples, {text}"
            for name, text in self.channels.items()
        }
        return html_table(f"{self.log.source}, {self.log.duration_s:.1f} s", rows)


@dataclass(frozen=True, repr=False)
class Diagnosis:
    """What a simulation gets wrong in measurements, and why."""

    found: Found
    """The whole result; not a public interface."""
    against: NominalReference | None = None

    @property
    def verdict(self) -> str:
        """One of none, named, set, partly_explained, unknown (docs/diagnosis.md)."""
        return self.found.verdict

    @property
    def summary(self) -> str:
        """The verdict in a sentence or two."""
        return self.found.summary

    @cached_property
    def causes(self) -> pd.DataFrame:
        """The effects that the data call for, a row for each parameter, with its 95 % interval."""
        import pandas as pd

        columns = (
            "effect",
            "parameter",
            "value",
            "low",
            "high",
            "unit",
            "confidence",
            "signature",
        )
        rows = [
            (
                cause.effect,
                p.name,
                p.value,
                p.low,
                p.high,
                p.unit,
                cause.confidence,
                cause.signature,
            )
            for cause in self.found.causes
            for p in cause.theta
        ]
        return pd.DataFrame(rows, columns=list(columns))

    @cached_property
    def candidates(self) -> pd.DataFrame:
        """All effects that were tried, the most probable first."""
        import pandas as pd

        columns = ("effect", "probability", "gain", "evidence", "excited", "remark")
        rows = [[getattr(score, name) for name in columns] for score in self.found.candidates]
        return pd.DataFrame(rows, columns=list(columns))

    def save(self, folder: str | Path, *, replace: bool = False) -> Path:
        """Write what `tombo diagnose` writes: report.html, diagnosis.json, model.yaml, plots.

        Raises:
            InputError: the folder is not empty and may not be replaced, or it is of a stand.
        """
        from tombo_diagnosis.report.diagnosis_output import DIAGNOSIS_FILES, write_diagnosis
        from tombo_dynamics.errors import InputError
        from tombo_flight.process.output_folder import open_output

        if self.against is None:
            raise InputError("save: of a thrust stand; accepted: tombo propeller diagnose -o DIR")
        with open_output(Path(folder), replace=replace, results=DIAGNOSIS_FILES) as output:
            write_diagnosis(output, self.found, self.against)
            output.publish()
        return Path(folder)

    def __repr__(self) -> str:
        return f"Diagnosis({self.verdict}: {self.summary})"

    def _repr_html_(self) -> str:
        """Return verdict and causes as HTML, for notebooks."""
        rows = {
            f"{cause.effect}": ", ".join(f"{p.name} {p.value:.4g} {p.unit}" for p in cause.theta)
            for cause in self.found.causes
        }
        return html_table(f"{self.verdict}: {self.summary}", rows)


def read(path: str | Path, mapping: str | Path | None = None) -> Flight | Log:
    """Read a recording, a PX4 log or a table.

    Args:
        path: MCAP, rosbag2 folder, ROS 1 bag, PX4 ULog, telemetry log, CSV.
        mapping: file, or name of a shipped one, that says what a table's columns are.

    Returns:
        A `Flight`, if the suite itself recorded it with its ground truth; else a `Log`.

    Raises:
        InputError: it can't be read; says why and what is accepted.
    """
    from tombo_bag.flight_time import FLIGHT_METADATA
    from tombo_bag.recording import Recording
    from tombo_flight.recorded_flight import read_flight
    from tombo_logs.readers.csv_mapping import load_mapping
    from tombo_logs.readers.log_reader import kind_of, read_log

    place = Path(path)
    if place.is_dir() or kind_of(place) == "recording":
        with Recording(place) as recording:
            own = FLIGHT_METADATA in recording.metadata
        if own and mapping is None:
            return Flight(read_flight(place))
    use = None if mapping is None else load_mapping(mapping)
    return Log(read_log(place, place.name.split(".")[0], use))


def diagnose(
    logs: Paths,
    *,
    mapping: str | None = None,
    model: str | Path | None = None,
    vehicle: str | None = None,
    topics: Mapping[str, str] | None = None,
) -> Diagnosis:
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
    from tombo_diagnosis.report.diagnosis_output import NominalReference

    found, label, base = diagnose_logs(
        _paths(logs), None if model is None else Path(model), mapping, topics or {}, vehicle,
        time.perf_counter,
    )  # fmt: skip
    today = datetime.date.today().isoformat()
    return Diagnosis(found, NominalReference(label, today, base, vehicle or ""))


def stand(
    tables: Paths,
    *,
    mapping: str | None = None,
    conf: int = 13,
    law: str = "repaired",
    plain: bool = False,
) -> Diagnosis:
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

    found = [read_stand(path, mapping) for path in _paths(tables)]
    result = diagnose_stand(found, conf, law, plain, no_progress, time.perf_counter)
    return Diagnosis(result.diagnosis)


def _paths(given: Paths) -> list[Path]:
    one: Iterable[Any] = [given] if isinstance(given, str | Path) else given
    return [Path(path) for path in one]

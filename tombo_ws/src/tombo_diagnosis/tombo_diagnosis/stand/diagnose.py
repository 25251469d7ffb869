"""`tombo propeller diagnose`: from tables of a stand to a Diagnosis, as for flights."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from tombo_diagnosis.diagnosis import Diagnosis, FlightSummary
from tombo_diagnosis.engine.separation import separating_experiment
from tombo_diagnosis.stand.analyse import StandAnalysis, analyse
from tombo_diagnosis.stand.causes import estimate_cause, held_out, scores
from tombo_diagnosis.stand.model_file import StandModel
from tombo_diagnosis.stand.summary_text import notes, summary
from tombo_diagnosis.stand.tables.assemble import StandData, assemble
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_diagnosis.stand.tables.table_reader import StandTable
from tombo_diagnosis.stand.thrust_constant import ThrustConstant, thrust_constant
from tombo_dynamics.propeller.effects import CHANNELS, STAND_EFFECTS
from tombo_flight.progress import ProgressCallback

ABSORBED_EFFECTS = ("thrust_coefficient", "drag_coefficient")
"""The fit of k_T and k_Q absorbs them."""


@dataclass(frozen=True, eq=False)
class StandDiagnosis:
    """A diagnosis of stand runs with its analysis."""

    diagnosis: Diagnosis
    findings: StandAnalysis
    constant: ThrustConstant | None
    """Of a plain propeller."""
    given: StandModel | None = None
    """Model of earlier runs, that these were compared with."""


def diagnose_stand(
    tables: Sequence[StandTable],
    conf: int,
    law: str,
    plain: bool,
    on_progress: ProgressCallback,
    clock: Callable[[], float],
    given: StandModel | None = None,
) -> StandDiagnosis:
    """Diagnose tables of a thrust stand, runs of one propeller or of several.

    Args:
        tables: as recorded.
        conf: configuration of tables that do not say theirs.
        law: of the Tombo propellers.
        plain: hold them against T = k omega^2.
        on_progress: called with the progress.
        clock: of run time [s].
        given: model of earlier runs.

    Raises:
        InputError: the tables can't be diagnosed together.
    """
    began = clock()
    on_progress("finding plateaus", 0.0)
    data = assemble(tables, conf, law, plain)
    constant = None
    if data.points.setup.plain and 0 in data.points.measured:
        constant = thrust_constant(data, {t.name: t.rotor_speed for t in tables})
    base = None if given is None else given.theta
    runs = [_note(table) for table in tables]
    diagnosis, findings = diagnose_points(data, runs, on_progress, constant, base)
    return StandDiagnosis(replace(diagnosis, seconds=clock() - began), findings, constant, given)


def diagnose_points(
    data: StandData,
    flights: Sequence[FlightSummary],
    on_progress: ProgressCallback,
    constant: ThrustConstant | None = None,
    base: Mapping[str, tuple[float, ...]] | None = None,
) -> tuple[Diagnosis, StandAnalysis]:
    """Diagnose operating points."""
    points = data.points
    on_progress("looking for causes", 0.1)
    findings = analyse(points, ABSORBED_EFFECTS if points.setup.plain else (), base)
    on_progress("leaving out one block after the other", 0.4)
    gains, shares = held_out(findings)
    judgement = findings.judgement
    causes = tuple(estimate_cause(e, findings) for e in judgement.effects)
    diagnosis = Diagnosis(
        verdict=judgement.verdict,
        causes=causes,
        set=judgement.members,
        separating_experiment=separating_experiment(judgement.members, STAND_EFFECTS),
        gain=tuple(gains),
        prechecks=data.findings,
        candidates=scores(findings, shares),
        flights=tuple(flights),
        residuals=(),
        confidence=judgement.confidence,
        summary=summary(findings, causes, gains, constant),
        notes=notes(findings, causes, gains, constant),
        model=_model(points),
        vehicle="" if not points.setup.plain else "plain propeller",
    )
    return diagnosis, findings


def _model(points: OperatingPoints) -> str:
    if points.setup.plain:
        k_T = float(points.setup.rows[0, 0])
        return f"T = k_T omega^2, k_T = {k_T:.4g} N s^2, fitted to these points"
    return f"Tombo propeller, law {points.setup.law}: {', '.join(points.propellers[:14])}"


def _note(table: StandTable) -> FlightSummary:
    t = table.channels.get("time")
    lasted = float(t[-1] - t[0]) if t is not None and t.size else math.nan
    missing = tuple(c for c in CHANNELS if c not in table.channels)
    return FlightSummary(table.name, table.source, lasted, lasted, "stand", missing)

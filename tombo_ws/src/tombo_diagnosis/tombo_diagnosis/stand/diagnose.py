"""`tombo propeller diagnose`: from tables of a stand to a Diagnosis, as for flights."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from tombo_diagnosis.diagnosis import Diagnosis, FlightSummary
from tombo_diagnosis.engine.verdict import separating_experiment
from tombo_diagnosis.stand.analyse import StandAnalysis, analyse
from tombo_diagnosis.stand.causes import estimate_cause, held_out, scores
from tombo_diagnosis.stand.summary_text import notes, summary
from tombo_diagnosis.stand.tables.assemble import assemble
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_diagnosis.stand.tables.table_reader import StandTable
from tombo_diagnosis.stand.thrust_constant import ThrustConstant, thrust_constant
from tombo_dynamics.propeller.effects import CHANNELS, STAND_EFFECTS
from tombo_flight.extended_model import Model
from tombo_flight.progress import ProgressCallback

ABSORBED_EFFECTS = ("thrust_coefficient", "drag_coefficient")
"""The fit of k_T and k_Q absorbs them."""


@dataclass(frozen=True, eq=False)
class StandDiagnosis:
    """A diagnosis of stand runs with its analysis."""

    diagnosis: Diagnosis
    findings: StandAnalysis
    constant: ThrustConstant | None
    """Thrust constant of a plain propeller."""
    earlier_model: Model | None = None
    """Model of earlier runs that these runs were compared with."""


def diagnose_stand(
    tables: Sequence[StandTable],
    conf: int,
    law: str,
    plain: bool,
    on_progress: ProgressCallback,
    clock: Callable[[], float],
    given: Model | None = None,
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
    points, found = assemble(tables, conf, law, plain)
    constant = None
    if points.setup.plain and 0 in points.measured:
        constant = thrust_constant(points)
    on_progress("looking for causes", 0.1)
    findings = analyse(points, ABSORBED_EFFECTS if points.setup.plain else (), _theta(given))
    on_progress("leaving out one block after the other", 0.4)
    gains, shares = held_out(findings)
    judgement = findings.judgement
    diagnosis = Diagnosis(
        verdict=judgement.verdict,
        causes=tuple(estimate_cause(e, findings) for e in judgement.effects),
        set=judgement.members,
        separating_experiment=separating_experiment(judgement.members, STAND_EFFECTS),
        gain=tuple(gains),
        prechecks=found,
        candidates=scores(findings, shares),
        flights=tuple(_note(table) for table in tables),
        residuals=(),
        confidence=judgement.confidence,
        summary=summary(findings, gains, constant),
        notes=notes(findings, constant),
        model=_model(points),
        vehicle="" if not points.setup.plain else "plain propeller",
        seconds=clock() - began,
    )
    return StandDiagnosis(diagnosis, findings, constant, given)


def of_other_runs(diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis with the causes that other runs have, too: not the random causes."""
    lasting = tuple(c for c in diagnosis.causes if not STAND_EFFECTS[c.effect].stochastic)
    return replace(diagnosis, causes=lasting)


def _theta(given: Model | None) -> dict[str, tuple[float, ...]]:
    """Return effect -> its parameters in a model of earlier runs."""
    effects = {} if given is None else given.effects
    return {
        name: tuple(values.get(p.name, p.null) for p in STAND_EFFECTS[name].theta)
        for name, values in effects.items()
    }


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

"""Many blind flights, diagnosed and scored."""

from __future__ import annotations

from functools import partial

from tombo_diagnosis.benchmark.flight_examine import examine
from tombo_diagnosis.benchmark.flight_score import aggregate
from tombo_diagnosis.benchmark.run_cases import run_cases

benchmark = partial(run_cases, examine, aggregate)

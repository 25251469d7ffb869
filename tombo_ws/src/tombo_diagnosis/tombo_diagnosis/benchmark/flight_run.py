"""Many blind flights, diagnosed and scored."""

from __future__ import annotations

from functools import partial

from tombo_diagnosis.benchmark.flight_evaluation import examine
from tombo_diagnosis.benchmark.flight_score import aggregate
from tombo_diagnosis.benchmark.runner import run_benchmark

benchmark = partial(run_benchmark, examine, aggregate)

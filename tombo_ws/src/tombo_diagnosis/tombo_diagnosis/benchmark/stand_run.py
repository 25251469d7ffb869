"""Many blind runs of thrust stands, diagnosed and scored."""

from __future__ import annotations

from functools import partial

from tombo_diagnosis.benchmark.runner import run_benchmark
from tombo_diagnosis.benchmark.stand_evaluation import examine
from tombo_diagnosis.benchmark.stand_score import aggregate

benchmark = partial(run_benchmark, examine, aggregate)

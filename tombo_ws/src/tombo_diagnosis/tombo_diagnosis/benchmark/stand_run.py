"""Many blind runs of thrust stands, diagnosed and scored."""

from __future__ import annotations

from functools import partial

from tombo_diagnosis.benchmark.run_cases import run_cases
from tombo_diagnosis.benchmark.stand_examine import examine
from tombo_diagnosis.benchmark.stand_score import aggregate

benchmark = partial(run_cases, examine, aggregate)

"""Many blind flights, diagnosed and scored."""

from __future__ import annotations

from functools import partial

from tombo_bringup.blind.examine import examine
from tombo_bringup.blind.score import aggregate
from tombo_bringup.blind_cases import run_cases

benchmark = partial(run_cases, examine, aggregate)

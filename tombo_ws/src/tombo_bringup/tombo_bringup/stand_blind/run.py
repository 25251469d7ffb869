"""Many blind runs of thrust stands, diagnosed and scored."""

from __future__ import annotations

from functools import partial

from tombo_bringup.blind_cases import run_cases
from tombo_bringup.stand_blind.examine import examine
from tombo_bringup.stand_blind.score import aggregate

benchmark = partial(run_cases, examine, aggregate)

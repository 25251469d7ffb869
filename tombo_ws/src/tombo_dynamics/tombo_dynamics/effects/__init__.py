"""All effects: importing this package enters every module of this folder into the registry."""

from __future__ import annotations

from tombo_dynamics.effects.registry import REGISTRY, Effect, Param, Stage, check_theta, effect
from tombo_dynamics.errors import import_each

_NOT_EFFECTS = {"registry", "compose"}

import_each(__name__, __path__, but=_NOT_EFFECTS)

__all__ = ["REGISTRY", "Effect", "Param", "Stage", "check_theta", "effect"]

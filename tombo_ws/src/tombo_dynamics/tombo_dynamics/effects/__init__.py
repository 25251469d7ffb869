"""All effects: importing this package enters every module beside this file into the registry."""

from __future__ import annotations

import importlib
import pkgutil

from tombo_dynamics.effects.registry import REGISTRY, Effect, Param, Stage, check_theta, effect

_NOT_EFFECTS = {"registry", "compose"}

for _module in sorted(m.name for m in pkgutil.iter_modules(__path__)):
    if _module not in _NOT_EFFECTS:
        importlib.import_module(f"{__name__}.{_module}")

__all__ = ["REGISTRY", "Effect", "Param", "Stage", "check_theta", "effect"]

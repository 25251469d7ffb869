"""The Python interface of the suite: flights, sweeps, diagnoses and propellers.

    >>> import tombo
    >>> flight = tombo.fly("paper_collision", seed=3, **{"mission.approach_speed": 0.9})
    >>> flight.summary["recovery_time_s"], flight.log.loc[23:24, "position.z"].min()
    >>> table = tombo.sweep("paper_collision", {"vehicle.mass": "1.1:1.7:0.1"}, seeds=range(100))

What `__all__` lists is public; docs/python.md says what that promises.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tombo.flights import FlightTables as Flight
from tombo.flights import fly
from tombo.measured import DiagnosisTables as Diagnosis
from tombo.measured import LogTables as Log
from tombo.measured import diagnose, read, stand
from tombo.propellers import propeller
from tombo.studies import arena, risk, sweep
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_collision.decision import Decision, Estimate
    from tombo_collision.own_reactions import import_reactions
    from tombo_collision.reactions import Reaction
    from tombo_dynamics.messages import CollisionEvent
    from tombo_dynamics.params import param

__all__ = [
    "CollisionEvent",
    "Decision",
    "Diagnosis",
    "Estimate",
    "Flight",
    "InputError",
    "Log",
    "Reaction",
    "arena",
    "diagnose",
    "fly",
    "import_reactions",
    "param",
    "propeller",
    "read",
    "risk",
    "stand",
    "sweep",
]

_WHERE = {
    "CollisionEvent": "tombo_dynamics.messages",
    "Decision": "tombo_collision.decision",
    "Estimate": "tombo_collision.decision",
    "Reaction": "tombo_collision.reactions",
    "import_reactions": "tombo_collision.own_reactions",
    "param": "tombo_dynamics.params",
}
"""What only own reactions need, and what loads compiled code."""


def __getattr__(name: str) -> Any:
    """Import a name of `_WHERE` when it is first asked for."""
    if name not in _WHERE:
        raise AttributeError(f"module 'tombo' has no attribute {name!r}")
    return getattr(import_module(_WHERE[name]), name)

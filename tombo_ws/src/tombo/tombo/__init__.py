"""The Python interface of the suite: flights, sweeps, diagnoses and propellers.

    >>> import tombo
    >>> flight = tombo.fly("paper_collision", seed=3, **{"mission.approach_speed": 0.9})
    >>> flight.summary["recovery_time_s"], flight.log.loc[23:24, "position.z"].min()
    >>> table = tombo.sweep("paper_collision", {"vehicle.mass": "1.1:1.7:0.1"}, seeds=range(100))

What `__all__` lists is public; docs/python.md says what that promises.
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tombo.flights import FlightTables as Flight
    from tombo.flights import fly
    from tombo.measured import DiagnosisTables as Diagnosis
    from tombo.measured import LogTables as Log
    from tombo.measured import diagnose, read, stand
    from tombo.propellers import propeller
    from tombo.studies import sweep
    from tombo_collision.decision import Decision, Estimate
    from tombo_collision.reactions import Reaction
    from tombo_dynamics.errors import InputError
    from tombo_dynamics.messages import CollisionEvent
    from tombo_dynamics.params import param
    from tombo_flight.own_files import import_files

__all__ = [
    "CollisionEvent",
    "Decision",
    "Diagnosis",
    "Estimate",
    "Flight",
    "InputError",
    "Log",
    "Reaction",
    "diagnose",
    "fly",
    "import_files",
    "param",
    "propeller",
    "read",
    "stand",
    "sweep",
]

_WHERE = {
    "tombo.flights": {"Flight": "FlightTables", "fly": "fly"},
    "tombo.measured": {
        "Diagnosis": "DiagnosisTables",
        "Log": "LogTables",
        "diagnose": "diagnose",
        "read": "read",
        "stand": "stand",
    },
    "tombo.propellers": {"propeller": "propeller"},
    "tombo.studies": {"sweep": "sweep"},
    "tombo_collision.decision": {"Decision": "Decision", "Estimate": "Estimate"},
    "tombo_collision.reactions": {"Reaction": "Reaction"},
    "tombo_dynamics.errors": {"InputError": "InputError"},
    "tombo_dynamics.messages": {"CollisionEvent": "CollisionEvent"},
    "tombo_dynamics.params": {"param": "param"},
    "tombo_flight.own_files": {"import_files": "import_files"},
}
"""Module → public name → its name there. A module is imported when a name of it is asked for."""


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for."""
    for module, names in _WHERE.items():
        if name in names:
            value = globals()[name] = getattr(import_module(module), names[name])
            return value
    if name == "__version__":
        return version("tombo")
    raise AttributeError(f"module 'tombo' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the public names, and those of any module."""
    return sorted({*globals(), *__all__})

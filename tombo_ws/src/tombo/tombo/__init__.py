"""The Python interface of the suite: flights, sweeps, diagnoses and propellers.

    >>> import tombo
    >>> flight = tombo.fly("paper_collision", seed=3, **{"mission.approach_speed": 0.9})
    >>> flight.summary["recovery_time_s"], flight.log.loc[23:24, "position.z"].min()
    >>> table = tombo.sweep("paper_collision", {"vehicle.mass": "1.1:1.7:0.1"}, seeds=range(100))

What `__all__` lists is public; docs/python.md says what that promises.
"""

from tombo.flights import Flight, fly
from tombo.measured import Diagnosis, Log, diagnose, read, stand
from tombo.propellers import propeller
from tombo.sweeps import sweep
from tombo_collision.reactions import Decision, Reaction
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import param

__all__ = [
    "CollisionEvent",
    "Decision",
    "Diagnosis",
    "Flight",
    "InputError",
    "Log",
    "Reaction",
    "diagnose",
    "fly",
    "param",
    "propeller",
    "read",
    "stand",
    "sweep",
]

"""Result of a diagnosis: verdict, causes, sets of causes, gain, and what to fly next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

import numpy as np

from tombo_bag.flight import Finding
from tombo_diagnosis.control.controller import ControllerReport, controller_mapping
from tombo_dynamics.arrays import Array
from tombo_flight.extended_model import FittedParameter, Gain
from tombo_flight.json_text import plain
from tombo_flight.version import tombo_version

JSON: Final = "diagnosis.json"
REPORT: Final = "report.html"
MODEL: Final = "model.yaml"
"""Files of a diagnosis."""
VERDICTS = ("none", "named", "set", "unknown", "partly_explained")


@dataclass(frozen=True)
class Cause:
    """An effect that the data call for."""

    effect: str
    """Name in the registry."""
    theta: tuple[FittedParameter, ...]
    confidence: float
    """Calibrated probability (0 to 1) that this is a cause."""
    signature: str
    """How it shows in data, from the registry."""
    covariance: tuple[tuple[float, ...], ...] = ()
    """Covariance of theta, in its order."""


@dataclass(frozen=True)
class Detectable:
    """The smallest change of a parameter that data would have shown."""

    parameter: str
    unit: str
    size: float


@dataclass(frozen=True)
class Score:
    """How well one candidate does."""

    effect: str
    gain: float
    """Share (0 to 1) of the excess residual that it removes in flights it was not fitted on; NaN:
    no fit."""
    evidence: float
    """Logarithm of its Bayes factor against 'none'."""
    probability: float
    """Posterior, all candidates and 'none' together."""
    excited: bool
    """False: these flights can't show it."""
    remark: str = ""
    """Why it was not excited, or the causes that look the same."""
    detectable: Detectable | None = None
    """The smallest change that these data would have shown; None: not known."""


@dataclass(frozen=True)
class Experiment:
    """The measurement that would separate what these data can't."""

    effects: tuple[str, ...]
    text: str
    """The experiment, and the pair of causes that it separates."""


@dataclass(frozen=True)
class Residual:
    """One channel's residual in one flight, to be shown."""

    flight: str
    channel: str
    unit: str
    t: Array
    """(N,) s"""
    before: Array
    """(N,) measured minus nominal model."""
    after: Array
    """(N,) measured minus extended model; the same as before where nothing was named."""
    sigma: float
    """Standard deviation that measurement noise alone gives it."""
    drivers: Mapping[str, Array]
    """Name with unit -> (N,): possible drivers (velocities, height, thrust, voltage ...)."""


@dataclass(frozen=True)
class Variable:
    """A quantity that a leftover may follow."""

    text: str
    """Its name in words."""
    unit: str


VARIABLES: Final[Mapping[str, Variable]] = {
    **{a: Variable(f"place {a}", "m") for a in "xy"},
    "z": Variable("height", "m"),
    **{f"v{a}": Variable(f"velocity along map {a}", "m/s") for a in "xyz"},
    **{n: Variable(f"velocity along body {a}", "m/s") for n, a in zip("uvw", "xyz", strict=True)},
    **{n: Variable(f"rate about body {a}", "rad/s") for n, a in zip("pqr", "xyz", strict=True)},
    "yaw": Variable("yaw", "rad"),
    "thrust": Variable("thrust", "N"),
    "t": Variable("time since the start", "s"),
    "voltage": Variable("voltage", "V"),
}
"""Variables of `LeftoverSamples.state`."""


@dataclass(frozen=True)
class LeftoverSamples:
    """One flight's leftover force [N] or moment [N m], means of M short blocks of time."""

    flight: str
    quantity: str
    """force or moment."""
    state: Mapping[str, Array]
    """Key of `VARIABLES` → (M,)."""
    rotation: Array
    """(M, 3, 3) map from body."""
    body: Array
    """(M, 3) body axes; NaN along an axis that was not measured."""

    @property
    def map(self) -> Array:
        """The same in map axes (M, 3); an axis that was not measured counts as zero."""
        return np.asarray(np.einsum("nij,nj->ni", self.rotation, np.nan_to_num(self.body)))


@dataclass(frozen=True)
class Dependence:
    """A variable that the leftover follows in flights that were held out."""

    quantity: str
    """force or moment."""
    variable: str
    """Of `VARIABLES`."""
    frame: str
    """Axes in which it follows the variable best: map or body."""
    r2: float
    """Share (0 to 1) of the leftover that it predicts."""


@dataclass(frozen=True)
class Leftover:
    """The force and moment that the named causes do not explain."""

    dependences: tuple[Dependence, ...]
    """Empty: no variable predicts it in flights held out."""
    rms: Mapping[str, float]
    """Quantity → root mean square of the vector."""
    samples: tuple[LeftoverSamples, ...]


@dataclass(frozen=True)
class FlightSummary:
    """One flight of the diagnosis."""

    name: str
    source: str
    duration_s: float
    used_s: float
    formulation: str
    """imu (specific force and angular acceleration) or mocap (motion capture alone)."""
    missing: tuple[str, ...]


@dataclass(frozen=True)
class Change:
    """A possible difference from the vehicle's healthy flights."""

    effect: str
    """Name in the registry, or of `change.signatures`."""
    rotor: str
    """Of ROTOR_NAMES; two as `a+b`; empty: it concerns no rotor."""
    theta: tuple[FittedParameter, ...]
    confidence: float
    """Probability (0 to 1)."""

    @property
    def label(self) -> str:
        """Effect and rotor in one name, as in `set`."""
        return f"{self.effect}.{self.rotor}" if self.rotor else self.effect


@dataclass(frozen=True)
class Diagnosis:
    """All that was found."""

    verdict: str
    """One of VERDICTS."""
    causes: tuple[Cause, ...]
    """named: up to three; partly_explained: its members; set: the members, most probable
    first; else empty."""
    set: tuple[str, ...]
    """Names of the members where the data can't tell; else empty."""
    separating_experiment: Experiment | None
    gain: tuple[Gain, ...]
    prechecks: tuple[Finding, ...]
    candidates: tuple[Score, ...]
    """All effects of the registry, most probable first."""
    flights: tuple[FlightSummary, ...]
    residuals: tuple[Residual, ...]
    confidence: float
    """Calibrated probability of the verdict."""
    summary: str
    """The verdict in a sentence or two, with figures."""
    notes: tuple[str, ...] = ()
    """Limits of the diagnosis, and why."""
    model: str = ""
    """The model that the flights were compared with."""
    vehicle: str = ""
    """Name of the airframe that flew; empty: the suite's own."""
    seconds: float = 0.0
    """Run time after loading."""
    changed: tuple[Change, ...] = ()
    """Of a comparison with healthy flights: named: the change; set: its members."""
    leftover: Leftover | None = None
    """unknown, partly_explained: the unexplained force and moment; else None."""
    controller: ControllerReport | None = None
    """Gains of the controller that flew, and what swings; None: the logs don't say."""
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """effect.parameter → standard deviation within which the model's value may be off."""


def diagnosis_mapping(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the content of `diagnosis.json`: plain values, None where a number is not finite."""
    left = diagnosis.leftover
    shown = left and replace(left, samples=())
    values = asdict(replace(diagnosis, residuals=(), leftover=shown, controller=None))
    values["controller"] = controller_mapping(diagnosis.controller)
    if left is not None:
        del values["leftover"]["samples"]
    del values["residuals"]
    for cause in values["causes"]:
        del cause["signature"]
        cause["theta"] = {theta.pop("name"): theta for theta in cause["theta"]}
    for change in values["changed"]:
        change["theta"] = {theta.pop("name"): theta for theta in change["theta"]}
    mapping: dict[str, Any] = plain({**values, "version": tombo_version()})
    return mapping

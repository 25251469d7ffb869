"""Whether thrust and speed can be in the units that are said, held against the model."""

from __future__ import annotations

import math

import numpy as np

from tombo_dynamics.propeller.effects import predict
from tombo_sysid.flight_log import Finding
from tombo_sysid.stand.points import Points

_ODD = 3.0
"""Times the model's thrust, or its inverse, that no propeller of the paper shows."""
_NEAR = 1.6
_TIMES = {
    "grams read as newtons": 1e3 / 9.80665,
    "rad/s read as rpm": (30.0 / math.pi) ** 2,
    "rpm read as rad/s": (math.pi / 30.0) ** 2,
    "Hz read as rpm": 3600.0,
    "millinewtons read as newtons": 1e3,
    "kilograms read as newtons": 1.0 / 9.80665,
    "four rotors on one cell (`rotors: 4` in --mapping)": 4.0,
}
"""What is mistaken for what -> by how much thrust at equal speed is then too large."""


def implausible(points: Points) -> tuple[Finding, ...]:
    """Say where thrust is far from the model's, and which slip would do it."""
    setup = points.setup
    if setup.plain:
        return ()
    y, model = points.readings[:, 0], predict(setup, {})[:, 0]
    fast = np.isfinite(y) & np.isfinite(model) & (setup.speed > 0.5 * float(setup.speed.max()))
    if not fast.any():
        return ()
    times = float(np.median(y[fast] / model[fast]))
    if 1.0 / _ODD < times < _ODD:
        return ()
    slips = [
        name
        for name, size in _TIMES.items()
        if times > 0.0 and abs(math.log(times / size)) < math.log(_NEAR)
    ]
    guess = f"as with {' or '.join(slips)}" if slips else "another propeller? (--plain)"
    return (
        Finding(
            "units", "fault", ", ".join(points.runs[:3]),
            f"thrust is {times:.3g} times the model's: {guess}", channel="thrust",
        ),
    )  # fmt: skip

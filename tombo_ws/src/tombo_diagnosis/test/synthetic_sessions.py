"""Features of flights in sessions with something hidden: statics by hand, widths of their own."""

import numpy as np

from tombo_diagnosis.change.features import Features
from tombo_diagnosis.rotor_demand import MODES
from tombo_dynamics.vehicle import ARM_X, ARM_Y, ROTOR_NAMES

FRONT, LEFT = np.sign(ARM_X), np.sign(ARM_Y)
YAW = 4.0 * MODES[3]
KINDS = ("healthy", "one", "two", "weight", "load", "centre", "mass", "other")


class Vehicle:
    """One that moves more or less than others between sessions."""

    def __init__(self, rng):
        self.rng = rng
        self.loose = np.exp(rng.normal(0.0, 0.5))
        self.base = np.array([*rng.normal(0.0, 0.02, 4), -3.8, -1.7, -1.6, 0.0, 0.0])

    def session(self, count, shift=0.0):
        """Return flights of one further session, with the shift (9,) of something hidden."""
        rng, day = self.rng, np.zeros(9)
        day[:4] = 4.0 * MODES.T @ rng.normal(0.0, (0.022, 0.009, 0.011, 0.011))
        day[:4] = self.loose * (day[:4] + rng.normal(0.0, 0.003, 4))
        day[4:] = rng.normal(0.0, (0.12, 0.12, 0.2, 0.006, 0.006))
        flights = []
        for _ in range(count):
            own = rng.normal(0.0, (*[0.007] * 4, 0.05, 0.05, 0.2, 0.006, 0.006))
            flights.append(Features(self.base + day + own + shift, 1.2))
        return flights


def hidden(kind, rng):
    """Return the shift (9,) and the label of something hidden; of `healthy` and `other` ""."""
    shift, k = np.zeros(9), int(rng.integers(4))
    label = ""
    if kind in ("one", "two"):
        rotors = sorted(rng.choice(4, 1 if kind == "one" else 2, replace=False))
        for j in rotors:
            size = rng.uniform(0.04, 0.2)
            shift[j] -= np.log(1.0 - size)
            shift[:4] += YAW * rng.normal(0.0, 0.1) * size
        shift[4:7] = rng.normal((0.4, 0.0, 0.3), 0.3)
        label = "weak_propeller." + "+".join(ROTOR_NAMES[j] for j in rotors)
    elif kind in ("weight", "load"):
        size = np.exp(rng.uniform(np.log(0.03), np.log(0.25 if kind == "weight" else 0.12)))
        arm = FRONT * FRONT[k] + LEFT * LEFT[k]
        shift[:4] = np.log(1.0 + size + size * arm) + YAW * rng.normal(0.0, 0.02)
        shift[k] += 0.3 * size + rng.normal(0.0, 0.05)
        shift[4] = rng.normal(0.1, 0.15)
        label = f"added_weight.{ROTOR_NAMES[k]}"
        if kind == "load":
            shift[4], shift[6] = rng.normal(0.5, (0.3, 0.5))
            shift[7] = rng.normal(0.04, 0.04) * LEFT[k]
            label = f"hanging_load.{ROTOR_NAMES[k]}"
    elif kind == "centre":
        heading, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.06, 0.2)
        shift[:4], label = size * (np.cos(heading) * FRONT + np.sin(heading) * LEFT), "cog_offset"
    elif kind == "mass":
        shift[:4], label = np.log(1.0 + rng.uniform(0.06, 0.2)), "mass_error"
    elif kind == "other":
        shift[:4] = rng.normal(0.0, 0.08, 4)
    shift[:4] *= 1.0 + rng.normal(0.0, 0.1, 4)
    return shift, label

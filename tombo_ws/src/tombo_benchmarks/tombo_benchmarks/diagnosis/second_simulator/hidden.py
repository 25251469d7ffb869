"""What can be hidden in a flight: names and sizes as docs/effects.md defines them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from tombo_benchmarks.diagnosis.second_simulator.vehicles import ROTORS, S500, Quadrotor

TYPICAL: Mapping[str, Mapping[str, float]] = {
    "mass_error": {"fraction": 0.1},
    "inertia_error": {"xx": 0.2, "yy": 0.2, "zz": 0.2},
    "cog_offset": {"x": 0.01, "y": 0.01},
    "motor_lag": {"extra_tau": 0.03},
    "command_delay": {"delay": 0.015},
    "steady_wind": {"east": 1.5, "north": 1.5},
    "gusts": {"deviation": 0.7},
    "ground_effect": {"strength": 1.0},
    "thrust_coefficient_error": {"fraction": 0.1},
    "weak_propeller": dict.fromkeys(ROTORS, 0.15),
    "translational_lift": {"k": 0.02},
    "battery_sag": {"resistance": 0.03, "discharge": 0.5},
    "linear_rotor_drag": {"d_xy": 0.3, "d_z": 0.1},
    "quadratic_body_drag": {"c_area": 0.05},
    "flapping_moment": {"k": 0.02},
    "imu_lever_arm": {"x": 0.03, "y": 0.03, "z": 0.03},
    "imu_misalignment": {"roll": 0.03, "pitch": 0.03, "yaw": 0.1},
    "accel_scale": {"x": 0.15, "y": 0.15, "z": 0.03},
    "imu_bias": {
        **{f"gyro_{a}": 0.03 for a in "xyz"}, **{f"accel_{a}": 0.3 for a in "xyz"},
    },
    "mocap_marker_offset": {"x": 0.02, "y": 0.02, "z": 0.02},
    "mocap_body_misalignment": {"yaw": 0.1, "roll": 0.02, "pitch": 0.02},
    "mocap_misalignment": {"roll": 0.02, "pitch": 0.02},
    "mocap_latency": {"delay": 0.03},
    "mocap_stamp_error": {"offset": 0.02},
}  # fmt: skip
"""Effect → parameter → the size that clearly matters on the S500."""
ALONE: Mapping[str, list[tuple[str, ...]]] = {
    "weak_propeller": [(r,) for r in ROTORS],
    "imu_bias": [tuple(f"{c}_{a}" for a in "xyz") for c in ("gyro", "accel")],
    "mocap_body_misalignment": [("yaw",), ("roll", "pitch")],
    "battery_sag": [("resistance",), ("discharge",)],
}
"""Parameters of an effect that are moved together, where not all are."""
POSITIVE = frozenset(
    {"weak_propeller", "quadratic_body_drag", "motor_lag", "command_delay", "battery_sag",
     "gusts", "mocap_latency", "translational_lift"}
)  # fmt: skip
"""Effects of one sign."""
ABSENT = frozenset({"steady_wind"})
"""Effects that no healthy vehicle has."""
LATENCY_S = 0.010
"""From capture to arrival of a pose in good order."""
NEEDS_IMU = frozenset({"imu_lever_arm", "imu_misalignment", "accel_scale", "imu_bias"})
FORCES = frozenset({"linear_rotor_drag", "quadratic_body_drag", "flapping_moment"})
"""Grow with the vehicle's mass."""
LENGTHS = frozenset({"cog_offset", "imu_lever_arm", "mocap_marker_offset"})
"""Grow with its arm, up to the S500's."""


def typical(name: str, parameter: str, quad: Quadrotor) -> float:
    """Return the size that clearly matters on this vehicle."""
    size = TYPICAL[name][parameter]
    if name in FORCES:
        size *= quad.mass / S500.mass
    if name == "flapping_moment":
        size *= quad.arm / S500.arm
    if name in LENGTHS:
        size *= min(quad.arm / S500.arm, 1.0)
    return size


def known(label: str, quad: Quadrotor) -> float:
    """Return what the vehicle truly has of this parameter before anything is hidden."""
    drag = {f"linear_rotor_drag.{p}": d for p, d in zip(("d_xy", "d_z"), quad.drag, strict=True)}
    room = {"mocap_latency.delay": LATENCY_S, "gusts.deviation": quad.air_motion}
    return {"ground_effect.strength": quad.ground, **drag, **room}.get(label, 0.0)


@dataclass(frozen=True)
class Hidden:
    """Departures from the documentation: "effect.parameter" → value; the rest is zero."""

    values: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, label: str) -> float:
        name, parameter = label.split(".")
        assert parameter in TYPICAL.get(name, {}), label
        return self.values.get(label, 0.0)

    def rotor_gains(self) -> list[float]:
        """Return each rotor's thrust over that of a healthy one."""
        scatter = [self.values.get(f"matched.{r}", 0.0) for r in ROTORS]
        return [
            (1.0 - self[f"weak_propeller.{r}"]) * (1.0 + s)
            for r, s in zip(ROTORS, scatter, strict=True)
        ]


def draw_shift(
    name: str, factor: float, quad: Quadrotor, rng: np.random.Generator
) -> dict[str, float]:
    """Return "effect.parameter" → change, `factor` of the size that clearly matters in all."""
    sets = ALONE.get(name, [tuple(TYPICAL[name])])
    chosen = sets[int(rng.integers(len(sets)))]
    way = rng.standard_normal(len(chosen))
    if name in POSITIVE or len(chosen) == 1:
        way = np.abs(way)
    way /= np.linalg.norm(way)
    if name not in POSITIVE and len(chosen) == 1 and rng.random() < 0.5:
        way = -way
    moved = {}
    for p, share in zip(chosen, way.tolist(), strict=True):
        change = factor * share * typical(name, p, quad)
        base = known(f"{name}.{p}", quad)
        moved[f"{name}.{p}"] = -change if base and base + change < 0.0 else change
    return moved


def draw_tolerances(quad: Quadrotor, rng: np.random.Generator) -> dict[str, float]:
    """Return what a careful lab leaves: a twentieth of what clearly matters, propellers 1 %."""
    found = {}
    for name, parameters in TYPICAL.items():
        share = 0.0 if name in ABSENT else 0.05
        for p in parameters:
            off = share * typical(name, p, quad) * float(rng.standard_normal())
            found[f"{name}.{p}"] = abs(off) if name in POSITIVE else off
    for r in ROTORS:
        found[f"matched.{r}"] = 0.01 * float(rng.standard_normal())
    return found

"""A made-up flight with every column of a flight record: right in shape, not in physics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tombo_bag.flight import Flight, Topic
from tombo_bag.flight_topics import flown_topics
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS

COVARIANCES = {"pose_covariance": 36, "twist_covariance": 36}
ODOMETRY = {"position": 3, "attitude": 4, "velocity": 3, "rates": 3, **COVARIANCES}
EVENTS = [
    {"time_s": 0.5, "kind": "takeoff"},
    {"time_s": 12.05, "kind": "detection", "x_c_m": np.array([1.7, 0.0, 2.0])},
    {"time_s": 12.07, "kind": "setpoint_switch", "x_r_m": np.array([0.9, 0.0, 2.0])},
]


def synthetic_flight(ticks: int = 40_000, seed: int = 0) -> Flight:
    """Make a flight of `ticks` ms: random walks, so that nothing compresses better than real."""
    rng = np.random.default_rng(seed)
    t = np.arange(ticks) * 1e-3

    def walk(width: int, step: float = 0.01) -> np.ndarray:
        return np.cumsum(rng.normal(0.0, step, (ticks, width)), axis=0)

    def attitude() -> np.ndarray:
        q = np.concatenate([0.1 * np.tanh(walk(3)), np.ones((ticks, 1))], axis=1)
        return q / np.linalg.norm(q, axis=1, keepdims=True)

    def held(values: np.ndarray, every: int) -> np.ndarray:
        return values[(np.arange(ticks) // every) * every]

    touching = (t > 12.0) & (t < 12.1)
    force = np.where(touching[:, None], walk(3) - 5.0, 0.0)
    contact = np.concatenate(
        [touching[:, None] * 1.0, np.where(touching, 2.0, -1.0)[:, None], walk(3)], axis=1
    )
    mode = 1 + np.searchsorted([4.0, 9.0, 12.07, 16.0, 30.0, 38.0], t, side="right")
    log = {
        "position": walk(3),
        "velocity": walk(3),
        "attitude": attitude(),
        "rates": walk(3),
        "rotor_speed": 400.0 + walk(4),
        "rotor_thrust": 3.0 + walk(4),
        "fold": np.where(touching[:, None], 1.0, 0.0) * np.ones(4),
        "damage": np.zeros((ticks, 4)),
        "contact_force": force,
        "contact": contact,
        "gyro": walk(3),
        "accel": walk(3) + np.array([0.0, 0.0, 9.81]),
        "est_position": walk(3),
        "est_attitude": attitude(),
        "attitude_setpoint": held(attitude(), 20),
        "rates_setpoint": held(walk(3), 4),
        "thrust_setpoint": held(14.0 + walk(1), 20),
        "rotor_command": 400.0 + walk(4),
        "mode": mode[:, None].astype(float),
        "battery": np.abs(walk(3)),
    }
    said = np.arange(0, ticks, 4)
    odometry = {name: walk(k)[said] for name, k in ODOMETRY.items()}
    frames = np.arange(0, ticks, 33)
    poses = {"position": log["position"][frames], "attitude": log["attitude"][frames]}
    arrival = t[frames] + 0.008 + rng.exponential(0.004, len(frames))
    phase = {"phase": np.array([3]), "text": np.array(["approach"])}
    published = {
        "/odometry": Topic.of(t[said], {"stamp_ns": EPOCH_NS + said * TICK_NS, **odometry}),
        "/mission/status": Topic.of(t[:1], {n: one[: len(said)] for n, one in phase.items()}),
    }
    return Flight(
        flown_topics(t, log, Topic.of(t[frames], poses, arrival), published),
        t=t,
        log=log,
        events=[event for event in EVENTS if event["time_s"] <= ticks * 1e-3],
        scenario={
            "name": "synthetic",
            "seed": seed,
            "obstacle": {"x_m": 2.1, "y_m": 0.3, "radius_m": 0.2, "top_m": 2.5},
        },
    )


def with_log(flight: Flight, log: Mapping[str, np.ndarray]) -> Flight:
    """Return the flight with another log, and the topics that follow from it."""
    published = {name: flight[name] for name in ("/odometry", "/mission/status")}
    topics = flown_topics(flight.t, log, flight["/mocap/pose"], published)
    return replace(flight, log=log, topics=topics)

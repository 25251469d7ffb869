"""A made-up flight with the shape of the paper's experiment, and its edge cases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Flight, Topic

CONTACT_S = 23.0
FALL_M = 0.5
UNSTABLE_S = 1.5
RECOVERY_S = 5.0
LATENCY_S = 0.07
HOVER_N = 3.31


def build_flight(
    *, contact: bool = True, crash: bool = False, end_s: float = 40.0, name: str = "synthetic"
) -> Flight:
    """Take off, hover, approach at 0.6 m/s, collide at 23 s, fall 0.5 m, hold at x_r, land."""
    t = np.arange(0.0, end_s, 0.001)
    n = len(t)
    tau = np.clip(t - CONTACT_S, 0.0, None) if contact else np.zeros(n)
    hit = (t >= CONTACT_S) if contact else np.zeros(n, dtype=bool)
    position, setpoint, mode = _path(t, tau, hit, crash)
    attitude_deg = _attitude_deg(tau, hit, crash)
    quaternion = Rotation.from_euler("xyz", attitude_deg, degrees=True).as_quat()
    thrust, fold = _rotors(t, tau, hit, crash, mode)
    rng = np.random.default_rng(0)
    force = np.zeros((n, 3))
    if contact:
        force[:, 0] = -40.0 * np.exp(-(((t - CONTACT_S - 0.004) / 0.003) ** 2))
    log = {
        "position": position,
        "velocity": np.gradient(position, t, axis=0),
        "attitude": quaternion,
        "rates": np.radians(np.gradient(attitude_deg, t, axis=0)),
        "rotor_speed": np.sqrt(thrust / 1.4e-5),
        "rotor_thrust": thrust,
        "fold": fold,
        "damage": np.zeros((n, 4)),
        "contact_force": force,
        "est_position": position + rng.normal(0.0, 0.004, (n, 3)),
        "position_setpoint": setpoint,
        "mode": mode.reshape(-1, 1),
    }
    events = [
        {"time_s": 1.0, "kind": "takeoff", "text": "takes off"},
        {"time_s": 19.9, "kind": "approach", "text": "flies +x at 0.6 m/s"},
    ]
    summary: dict[str, Any] = {
        "scenario": name,
        "seed": 7,
        "conf": 13,
        "law": "repaired",
        "model": None,
        "reaction": "bounce",
        "disturbances": False,
        "collided": contact and end_s > CONTACT_S,
        **dict.fromkeys(
            ("collision_time_s", "contact_point_m", "contact_known_s", "x_c_m", "n_r", "x_r_m")
        ),
        **dict.fromkeys(
            ("max_falling_distance_m", "max_tilt_rad", "unstable_phase_s", "recovery_time_s")
        ),
        **dict.fromkeys(("settled_error_m", "hover_rms_m", "approach_rms_m")),
        "strikes": 0,
        "detected": False,
        "crashed": crash and end_s > CONTACT_S + 1.0,
        "false_alarms": 0,
        "wall_time_s": 0.08,
        "real_time_factor": 512.0,
    }
    if summary["collided"]:
        events += [
            {"time_s": CONTACT_S, "kind": "contact", "text": "front left meets the obstacle"},
            {"time_s": CONTACT_S + LATENCY_S, "kind": "detection", "text": "innovation 5.2 sigma"},
            {"time_s": CONTACT_S + 0.082, "kind": "setpoint_switch", "text": "x_r latched"},
        ]
        summary |= {
            "collision_time_s": CONTACT_S,
            "contact_point_m": [1.98, 0.17, 2.0],
            "detected": True,
            "detection_latency_s": LATENCY_S,
            "contact_known_s": LATENCY_S,
            "x_c_m": [1.7, 0.0, 2.0],
            "n_r": [-1.0, 0.0, 0.0],
            "x_r_m": [0.9, 0.0, 2.0],
            "max_falling_distance_m": FALL_M,
            "max_tilt_rad": 0.62,
        }
        if crash:
            events.append({"time_s": CONTACT_S + 0.9, "kind": "crash", "text": "hits the ground"})
        else:
            summary |= {
                "unstable_phase_s": UNSTABLE_S,
                "recovery_time_s": RECOVERY_S,
                "settled_error_m": 0.03,
            }
            events += [
                {"time_s": CONTACT_S + RECOVERY_S, "kind": "settled", "text": "within 0.1 m"},
                {"time_s": 33.0, "kind": "land", "text": "lands"},
                {"time_s": 38.5, "kind": "landed", "text": "motors off"},
            ]
    events = [event for event in events if event["time_s"] < end_s]
    mocap = slice(None, None, 33)
    poses = {"position": position[mocap], "attitude": quaternion[mocap]}
    return Flight(
        {"/mocap/pose": Topic.of(t[mocap], poses, t[mocap] + 0.01)},
        t=t,
        log=log,
        events=events,
        summary=summary,
        scenario={
            "name": name,
            "conf": 13,
            "obstacle": {"x_m": 2.09, "y_m": 0.17, "radius_m": 0.11, "top_m": 2.6}
            if contact
            else None,
            "approach": {"speed_m_s": 0.6, "start_s": 19.9},
            "reaction": {"enabled": not crash, "bounce_distance_m": 0.8},
            "mocap": {"rate_hz": 30, "noise_m": 0.0012},
        },
    )


def _smooth(u: Any) -> Any:
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def _path(t: Any, tau: Any, hit: Any, crash: bool) -> tuple[Any, Any, Any]:
    start = CONTACT_S - 1.7 / 0.6 - 0.25
    ramp = np.clip(t - start, 0.0, 0.5)
    x = 0.6 * np.clip(t - start - 0.5, 0.0, None) + 0.6 * ramp**2 / (2 * 0.5)
    z = 0.13 + 1.87 * _smooth((t - 1.0) / 4.0)
    y = 0.02 * np.sin(1.3 * t) * (z > 1.0)
    setpoint = np.stack((np.where(t > start, x + 0.05, 0.0), 0.0 * t, z), axis=1)
    mode = np.select([t < 1.0, t < 5.5, t < start], [0, 1, 2], 3).astype(float)
    if hit.any():
        rise = 1.1 * np.exp(-1.05 * tau) * np.sin(0.9 * tau + 1.14)
        x = np.where(hit, 0.9 + 0.8 * rise, np.minimum(x, 1.7))
        y = y + np.where(hit, 0.16 * tau * np.exp(-1.3 * tau), 0.0)
        since_lowest = tau / 1.15
        z = z - FALL_M * since_lowest**2 * np.exp(2.0 * (1.0 - since_lowest))
        setpoint[hit] = (0.9, 0.0, 2.0)
        mode = np.where(hit, 4.0, mode)
        mode = np.where(tau > RECOVERY_S, 5.0, mode)
        if crash:
            z = np.where(hit, np.maximum(2.0 - 0.5 * 6.0 * tau**2, 0.13), z)
            x = np.where(hit, 1.7 - 0.3 * np.minimum(tau, 0.9), x)
        else:
            z = z - 1.87 * _smooth((t - 33.0) / 5.5)
            mode = np.select([t >= 38.5, t >= 33.0], [7.0, 6.0], mode)
    else:
        x = np.minimum(x, 4.0)
        setpoint[:, 0] = np.minimum(setpoint[:, 0], 4.0)
    return np.stack((x, y, z), axis=1), setpoint, mode


def _attitude_deg(tau: Any, hit: Any, crash: bool) -> Any:
    wobble = np.exp(-tau / 0.4) * (1.0 - np.exp(-tau / 0.03))
    roll = -42.0 * wobble * np.sin(9.0 * tau + 0.4)
    pitch = 34.0 * wobble * np.cos(8.0 * tau) - 6.0 * tau * np.exp(-tau)
    yaw = 22.0 * np.exp(-tau / 1.6) * (1.0 - np.exp(-tau / 0.4))
    if crash:
        roll = roll - 150.0 * _smooth(tau / 0.9)
    angles: Any = np.stack((roll, pitch, yaw), axis=1) * hit[:, None]
    return angles + 0.4 * np.sin(np.arange(len(tau))[:, None] * 0.004 + np.arange(3))


def _rotors(t: Any, tau: Any, hit: Any, crash: bool, mode: Any) -> tuple[Any, Any]:
    airborne = (mode > 0) & (mode < 7)
    thrust = HOVER_N * airborne[:, None] * np.ones(4)
    swing = 1.6 * np.exp(-tau / 0.5) * np.sin(11.0 * tau)[:, None].T * hit
    thrust += np.outer(swing.ravel(), [1.0, 0.7, -0.4, -0.8]) * airborne[:, None]
    fold = np.zeros((len(t), 4))
    fold[:, 2] = np.where(hit, 1.0 - _smooth((tau - 0.05) / 0.42), 0.0)
    thrust[:, 2] *= 1.0 - 0.9 * fold[:, 2]
    if crash:
        thrust[tau > 0.9] = 0.0
    return np.clip(thrust, 0.0, None), fold


@pytest.fixture(scope="session")
def make_flight() -> Callable[..., Flight]:
    """The builder itself, for a flight with the options a test needs."""
    return build_flight


@pytest.fixture(scope="session")
def flight() -> Flight:
    """The flight that recovers."""
    return build_flight()


@pytest.fixture(scope="session")
def edge_flights(flight: Flight) -> dict[str, Flight]:
    """Flights that have gaps in their story."""
    one = {key: column[:1] for key, column in flight.log.items()}
    return {
        "no contact": build_flight(contact=False),
        "crashed": build_flight(crash=True, end_s=27.0),
        "cut short at 0.3 s": build_flight(end_s=0.3),
        "one sample": replace(
            flight, t=flight.t[:1], log=one, events=[], summary=build_flight(end_s=0.3).summary
        ),
        "cut short after contact": build_flight(end_s=23.2),
        "detected before contact": replace(
            flight, summary=dict(flight.summary, contact_known_s=-0.15)
        ),
    }

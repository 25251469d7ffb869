"""The fused flight and the plain Python runner fly the same flight, to the last bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tombo_flight.flight import fly_scenario
from tombo_flight.run_wiring import run_wiring
from tombo_flight.scenario import load_scenario
from tombo_flight.wiring import CORES

SHORT = (
    "mission.takeoff_time=0.5",
    "mission.climb_speed=1.5",
    "mission.approach_time=3.5",
    "mission.land_time=9.5",
    "duration=11",
)
JITTER = ("effects.mocap_latency.delay=0.02", "effects.mocap_latency.jitter=0.02")
WRONG_STAMPS = (
    "effects.mocap_stamp_error.offset=0.0123",
    "effects.mocap_marker_offset.z=0.05",
    "effects.mocap_dropouts.probability=0.03",
    "effects.imu_lever_arm.x=0.05",
    "estimator.mocap_rate=120",
)
DISTURBED = ("disturbances=true", "mission.land_time=18", "duration=17")

_SPARSE = "/attitude_setpoint"
"""A flight's log gives it at 50 Hz; the controller publishes it at 250 Hz while it recovers."""


def differences(settings: tuple[str, ...], seed: int) -> tuple[dict[str, int], Any]:
    """Return for each topic how many messages differ, and the record of the fused flight."""
    scenario = load_scenario("paper_collision", (*SHORT, *settings))
    record = fly_scenario(scenario, seed)
    said: dict[str, list[Any]] = {}
    ticks = run_wiring(scenario, seed, lambda topic, m: said.setdefault(topic, []).append(m))
    assert ticks == record.t.size
    commands = np.array([m.speed for m in said["/rotor_command"]])
    found = {"/rotor_command": int((commands != record.log["rotor_command"]).any(axis=1).sum())}
    names = {topic for core in CORES for topic in core.outputs} & set(record.topics)
    for name in names - {_SPARSE}:
        topic, other = record[name], said.get(name, [])
        assert len(topic.t) == len(other), name
        found[name] = 0
        for i, message in enumerate(other):
            found[name] += not all(
                np.array_equal(one.values[i], getattr(message, field), equal_nan=field != "text")
                for field, one in topic.items()
            )
    assert len(found) > 8
    return found, record


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        (),
        (*JITTER, *WRONG_STAMPS),
        ("reaction.name=none",),
        ("reaction.name=reflex", *DISTURBED),
        ("reaction.name=mpc",),
    ],
)
def test_fused_flight_is_the_runners_to_the_last_bit(settings):
    found, record = differences(settings, 3)
    assert not any(found.values()), found
    assert record.summary["collided"] and record.summary["detected"]
    assert bool(record["/reaction/status"]["collisions"].values[-1]) == (
        settings != ("reaction.name=none",)
    )

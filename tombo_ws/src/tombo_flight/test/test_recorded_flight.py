"""A recording read back gives the flight's figures: headless or by nodes, with losses or none."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_rewrite import every, metadata_of, rewrite

from tombo_bag.flight import Flight
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import EPOCH_NS, SECOND_NS, TICK_S
from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import write_mcap
from tombo_flight.recorded_flight import read_flight
from tombo_flight.report.flight_plot import draw_flight
from tombo_flight.report.style import figure_bytes
from tombo_flight.scenario import load_scenario

pytestmark = pytest.mark.slow

TODAY_S = 1_790_000_000
TRUTH = ("/ground_truth/odometry", "/ground_truth/rotors", "/ground_truth/contact")
LOOSE = {  # largest change by a truth of 250 Hz in place of 1 kHz
    "contact_position_m": 2e-3, "settled_error_m": 1e-4, "max_tilt_rad": 2e-3,
    "max_falling_distance_m": 1e-3, "hover_rms_m": 1e-4, "approach_rms_m": 1e-4,
    "recovery_time_s": 0.02, "unstable_phase_s": 0.02,
}  # fmt: skip


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly_scenario(load_scenario(settings=["mission.approach_time=5.5"]), 0)


@pytest.fixture(scope="module")
def headless(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "flight.mcap"
    write_mcap(flight, path)
    return path


@pytest.fixture
def reread(headless: Path, tmp_path: Path) -> Callable[..., Flight]:
    """The flight as it is read back after changes to its recording, those of `rewrite`."""

    def read(**changes: Any) -> Flight:
        changes = {"metadata": metadata_of(headless), **changes}
        return read_flight(rewrite(headless, tmp_path / "rewritten.mcap", **changes))

    return read


def assert_same_figures(found: dict[str, Any], wanted: dict[str, Any]) -> None:
    assert list(found) == list(wanted)
    for key, value in wanted.items():
        if key in ("wall_time_s", "real_time_factor"):
            continue
        if isinstance(value, float | list):
            assert found[key] == pytest.approx(value, abs=LOOSE.get(key, 2e-6)), key
        else:
            assert found[key] == value, key


def kinds(record: Flight) -> list[tuple[str, float]]:
    return [(str(event["kind"]), float(event["time_s"])) for event in record.events]


def test_a_headless_flight_read_back_has_the_same_figures_and_events(flight, headless):
    found = read_flight(headless, wall_time_s=2.0)

    assert_same_figures(found.summary, flight.summary)
    assert found.summary["collided"] and found.summary["detected"]
    assert found.summary["wall_time_s"] == 2.0
    assert [kind for kind, _ in kinds(found)] == [kind for kind, _ in kinds(flight)]
    for (_, at_s), (_, wanted_s) in zip(kinds(found), kinds(flight), strict=True):
        assert at_s == pytest.approx(wanted_s, abs=0.021)
    assert found.scenario == flight.scenario
    assert found.t == pytest.approx(flight.t, abs=1e-12)
    poses, wanted = found["/mocap/pose"], flight["/mocap/pose"]
    assert np.array_equal(poses["position"].values, wanted["position"].values)
    assert poses.arrival == pytest.approx(wanted.arrival, abs=1e-8)


def test_a_recording_has_the_topics_and_the_fields_of_the_flight(flight, headless):
    """In flight time, with the same values: a flight is one thing, flown or read."""
    found = read_flight(headless)

    left_out = {"/tf", "/estimator/status", "/mission/setpoint"}  # not needed of a recording
    assert set(flight.topics) - left_out == set(found.topics) - {"/markers"}
    for name in found.topics:
        if name == "/markers":
            continue
        topic, wanted = found[name], flight[name]
        assert topic.t == pytest.approx(wanted.t, abs=1e-9), name
        assert topic.arrival == pytest.approx(wanted.arrival, abs=1e-8), name
        for field, series in wanted.items():
            values = np.asarray(series.values).reshape(topic[field].values.shape)
            if values.dtype.kind == "U":
                assert np.array_equal(topic[field].values, values)
            else:  # the current of a battery is a float32 in its message
                assert np.allclose(topic[field].values, values, rtol=1e-6, equal_nan=True), field


def test_what_is_recorded_less_often_comes_back_close(flight, headless):
    log = read_flight(headless).log

    for name, most in (("position", 2e-3), ("est_position", 5e-3), ("attitude", 5e-3)):
        known = np.isfinite(flight.log[name][:, 0])  # no estimates before the first
        assert known[200:].all()
        assert np.abs(log[name] - flight.log[name])[known].max() < most
    still = flight.log["contact"][:, 0] == 0.0
    assert np.abs(log["velocity"] - flight.log["velocity"])[still].max() < 0.2
    assert np.array_equal(log["contact"][:, 0], flight.log["contact"][:, 0])
    wrong = log["mode"] != flight.log["mode"]
    assert not wrong.any()


def test_a_flight_of_today_with_losses_begins_at_its_first_pose(flight, headless, reread):
    """As the nodes record it: stamps since 1970, best effort, no epoch in the file."""
    rng = np.random.default_rng(0)

    def keep(topic: str, count: int) -> np.ndarray:
        if topic not in TRUTH[:2]:
            return every(topic, count)
        kept = rng.random(count) > 0.02
        kept[[0, -1]] = True
        return kept

    found = reread(
        shift_s=TODAY_S, keep=keep, log_time=lambda stamps: stamps + 200_000,
        metadata=metadata_of(headless, "epoch_ns"),
    )  # fmt: skip

    assert_same_figures(found.summary, flight.summary)
    assert found.t[0] == 0.0
    assert found.t.size == flight.t.size


def test_a_recorder_on_another_clock_knows_when_a_collision_was_known(flight, reread):
    """Simulated time at twice the speed: the recorder's clock goes half as fast."""

    def log_time(stamps: np.ndarray) -> np.ndarray:
        return TODAY_S * SECOND_NS + (stamps - EPOCH_NS) // 2

    def keep(topic: str, count: int) -> np.ndarray:
        """Without the last second of truth: later messages are known all the same."""
        return np.arange(count) < count - (250 if topic == TRUTH[0] else 0)

    found = reread(log_time=log_time, keep=keep)

    assert found.summary["detection_latency_s"] == pytest.approx(
        flight.summary["detection_latency_s"], abs=2e-6
    )
    wanted = flight["/mocap/pose"].arrival
    assert found["/mocap/pose"].arrival == pytest.approx(wanted, abs=2e-6)


def test_time_begins_shortly_before_the_missions_first_word(flight, headless, reread):
    """The simulator is there before all nodes are; three poses and a step go before the word."""

    def keep(topic: str, count: int) -> np.ndarray:
        return np.arange(count) >= (1 if topic == "/mission/status" else 0)

    found = reread(keep=keep, metadata=metadata_of(headless, "epoch_ns"))

    begun_s = flight.t[flight.log["mode"][:, 0] > 0.0][0]
    contact_s = flight.summary["collision_time_s"] - found.summary["collision_time_s"]
    assert contact_s == pytest.approx(begun_s - 0.12, abs=0.0041)
    assert found.t[0] == 0.0
    captured = [one["/mocap/pose"].t[0] for one in (found, flight)]
    assert captured[0] == pytest.approx(captured[1] - contact_s, abs=1e-6)


def set_points(most: int) -> Callable[[str, int], np.ndarray]:
    """Keep the first set points, and all other messages."""
    return lambda topic, count: np.arange(count) < (most if topic == "/setpoint" else count)


def test_a_descent_that_the_reaction_orders_is_the_mode_flown(flight, reread):
    """The mission does not know of it: only the set point has it.

    Set points begin with the estimates, and the 200th is followed a tick after it is published.
    """

    def edit(topic: str, messages: list[bytes]) -> list[bytes]:
        if topic != "/setpoint":
            return messages
        # the phase, the recovery, two bytes of padding, the operator's commands
        edited = (data[:-8] + b"\x08" + data[-7:] for data in messages[200:250])
        return [*messages[:200], *edited]

    mode = reread(edit=edit, keep=set_points(250)).log["mode"][:, 0]
    descent = round(flight["/setpoint"].arrival[200] / TICK_S) + 1

    assert np.array_equal(mode[:descent], flight.log["mode"][:descent, 0])
    assert (mode[descent : descent + 1000] == 8).all()


def test_a_flight_of_which_only_the_truth_is_there_can_still_be_drawn(reread):
    found = reread(keep=lambda topic, count: np.full(count, topic in TRUTH))

    assert found.summary["collided"]
    assert not found.summary["detected"]
    assert found.summary["hover_rms_m"] is None
    assert math.isnan(found.log["est_position"][0, 0])
    assert figure_bytes(draw_flight(found)).startswith(b"\x89PNG")


def test_a_scenario_that_is_none_is_refused(reread):
    for text in ('{"vehicle": {"mass": -1}}', "[1", '{"obstacle": {"x_m": 1}}'):
        with pytest.raises(InputError, match="its scenario can't be used"):
            reread(
                metadata={"scenario": text},
                keep=lambda topic, count: np.full(count, topic == TRUTH[0]),
            )

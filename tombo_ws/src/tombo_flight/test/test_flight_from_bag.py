"""A recording read back gives the flight's figures: headless or by nodes, with losses or none."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.mcap_sink import Columns, McapSink
from tombo_bag.reader import Bag
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import Phase
from tombo_dynamics.time_base import EPOCH_NS
from tombo_flight.flight import fly_scenario
from tombo_flight.flight_from_bag import flight_from_bag
from tombo_flight.flight_output import write_mcap
from tombo_flight.flight_record import FlightRecord
from tombo_flight.report.flight_plot import draw_flight, png_bytes
from tombo_flight.scenario import load_scenario

pytestmark = pytest.mark.slow

TODAY_S = 1_790_000_000
TRUTH = ("/ground_truth/odometry", "/ground_truth/rotors", "/ground_truth/contact")
LOOSE = {  # what a truth of 250 Hz in place of 1 kHz may change
    "contact_position_m": 2e-3, "settled_error_m": 1e-4, "max_tilt_rad": 2e-3,
    "max_falling_distance_m": 1e-3, "hover_rms_m": 1e-4, "approach_rms_m": 1e-4,
    "recovery_time_s": 0.02, "unstable_phase_s": 0.02,
}  # fmt: skip


@pytest.fixture(scope="module")
def flown() -> FlightRecord:
    return fly_scenario(load_scenario(settings=["mission.approach_time=5.5"]), 0)


@pytest.fixture(scope="module")
def headless(flown: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "flight.mcap"
    write_mcap(flown, path)
    return path


def rewrite(
    source: Path,
    target: Path,
    *,
    shift_s: int = 0,
    log_time: Callable[[np.ndarray], np.ndarray] = lambda stamps: stamps,
    keep: Callable[[str, int], np.ndarray] | None = None,
    metadata: dict[str, str] | None = None,
    edit: Callable[[str, list[bytes]], list[bytes]] = lambda topic, messages: messages,
) -> Path:
    """The same messages with other stamps, log times, losses, metadata and content."""
    bag = Bag(source)
    with McapSink(target) as sink:
        if metadata is not None:
            sink.add_metadata(FLIGHT_METADATA, metadata)
        parts = []
        for topic, raw in bag.messages(bag.topics).items():
            typename = bag.topics[topic].typename
            there = np.ones(len(raw.messages), bool)
            if keep is not None:
                there = keep(topic, len(raw.messages))
            if not there.any():
                continue
            times = log_time(raw.log_times_ns + shift_s * 10**9)[there]
            kept = [data for data, wanted in zip(raw.messages, there, strict=True) if wanted]
            chosen = [shifted(data, typename, shift_s) for data in kept] if shift_s else kept
            chosen = edit(topic, chosen)
            parts.append(Columns(sink.add_channel(topic, typename), times, chosen))
        sink.write_columns(*parts)
    return target


def shifted(data: bytes, typename: str, shift_s: int) -> bytes:
    if typename.endswith(("TFMessage", "MarkerArray")):
        return data
    (seconds,) = struct.unpack_from("<i", data, 4)
    return data[:4] + struct.pack("<i", seconds + shift_s) + data[8:]


def metadata_of(path: Path, *left_out: str) -> dict[str, str]:
    found = Bag(path).metadata[FLIGHT_METADATA]
    return {key: value for key, value in found.items() if key not in left_out}


def assert_same_figures(found: dict[str, Any], wanted: dict[str, Any]) -> None:
    assert list(found) == list(wanted)
    for key, value in wanted.items():
        if key in ("wall_time_s", "real_time_factor"):
            continue
        if isinstance(value, float | list):
            assert found[key] == pytest.approx(value, abs=LOOSE.get(key, 2e-6)), key
        else:
            assert found[key] == value, key


def kinds(record: FlightRecord) -> list[tuple[str, float]]:
    return [(str(event["kind"]), float(event["time_s"])) for event in record.events]


def test_a_headless_flight_read_back_has_the_same_figures_and_events(flown, headless):
    found = flight_from_bag(headless, wall_time_s=2.0)

    assert_same_figures(found.summary, flown.summary)
    assert found.summary["collided"] and found.summary["detected"]
    assert found.summary["wall_time_s"] == 2.0
    assert [kind for kind, _ in kinds(found)] == [kind for kind, _ in kinds(flown)]
    for (_, at_s), (_, wanted_s) in zip(kinds(found), kinds(flown), strict=True):
        assert at_s == pytest.approx(wanted_s, abs=0.021)
    assert found.scenario == flown.scenario
    assert found.t == pytest.approx(flown.t, abs=1e-12)
    assert np.array_equal(found.mocap_position, flown.mocap_position)
    assert found.mocap_arrival == pytest.approx(flown.mocap_arrival, abs=1e-8)


@pytest.mark.parametrize("name", ["gyro", "accel", "rotor_command"])
def test_what_is_recorded_at_each_tick_comes_back_at_its_tick(flown, headless, name):
    assert np.array_equal(flight_from_bag(headless).log[name], flown.log[name])


def test_what_is_recorded_less_often_comes_back_close(flown, headless):
    log = flight_from_bag(headless).log

    for name, most in (("position", 2e-3), ("est_position", 5e-3), ("attitude", 5e-3)):
        known = np.isfinite(flown.log[name][:, 0])  # no estimates before the first
        assert known[200:].all()
        assert np.abs(log[name] - flown.log[name])[known].max() < most
    still = flown.log["contact"][:, 0] == 0.0
    assert np.abs(log["velocity"] - flown.log["velocity"])[still].max() < 0.2
    assert np.array_equal(log["contact"][:, 0], flown.log["contact"][:, 0])
    wrong = log["mode"] != flown.log["mode"]
    assert not wrong.any()


def test_a_flight_of_today_with_losses_begins_at_its_first_pose(flown, headless, tmp_path):
    """As the nodes record it: stamps since 1970, best effort, no epoch in the file."""
    rng = np.random.default_rng(0)

    def keep(topic: str, count: int) -> np.ndarray:
        if topic not in TRUTH[:2]:
            return np.ones(count, bool)
        kept = rng.random(count) > 0.02
        kept[[0, -1]] = True
        return kept

    path = rewrite(
        headless, tmp_path / "nodes.mcap", shift_s=TODAY_S, keep=keep,
        log_time=lambda stamps: stamps + 200_000, metadata=metadata_of(headless, "epoch_ns"),
    )  # fmt: skip
    found = flight_from_bag(path)

    assert_same_figures(found.summary, flown.summary)
    assert found.t[0] == 0.0
    assert found.t.size == flown.t.size


def test_a_recorder_on_another_clock_knows_when_a_collision_was_known(flown, headless, tmp_path):
    """Simulated time at twice the speed: the recorder's clock goes half as fast."""
    wall_ns = TODAY_S * 10**9

    def log_time(stamps: np.ndarray) -> np.ndarray:
        return wall_ns + (stamps - EPOCH_NS) // 2

    def keep(topic: str, count: int) -> np.ndarray:
        """Without the last second of truth: what came later is known all the same."""
        return np.arange(count) < count - (250 if topic == TRUTH[0] else 0)

    found = flight_from_bag(
        rewrite(
            headless, tmp_path / "fast.mcap", log_time=log_time, keep=keep,
            metadata=metadata_of(headless),
        )
    )  # fmt: skip

    assert found.summary["detection_latency_s"] == pytest.approx(
        flown.summary["detection_latency_s"], abs=2e-6
    )
    assert found.mocap_arrival == pytest.approx(flown.mocap_arrival, abs=2e-6)


def test_time_begins_shortly_before_the_missions_first_word(flown, headless, tmp_path):
    """The simulator is there before all nodes are; three poses and a step go before the word."""

    def keep(topic: str, count: int) -> np.ndarray:
        return np.arange(count) >= (1 if topic == "/mission/status" else 0)

    path = rewrite(
        headless, tmp_path / "late.mcap", keep=keep, metadata=metadata_of(headless, "epoch_ns")
    )
    found = flight_from_bag(path)

    begun_s = flown.t[flown.log["mode"][:, 0] > 0.0][0]
    contact_s = flown.summary["collision_time_s"] - found.summary["collision_time_s"]
    assert contact_s == pytest.approx(begun_s - 0.12, abs=0.0041)
    assert found.t[0] == 0.0
    assert found.mocap_t[0] == pytest.approx(flown.mocap_t[0] - contact_s, abs=1e-6)


def test_a_descent_that_the_reaction_orders_is_the_mode_flown(flown, headless, tmp_path):
    """The mission does not know of it: it stands in the set point only.

    Set points begin with the estimates, and the 200th is followed a tick after it is published.
    """

    def edit(topic: str, messages: list[bytes]) -> list[bytes]:
        if topic != "/setpoint":
            return messages
        return [*messages[:200], *(data[:-1] + b"\x08" for data in messages[200:250])]

    path = rewrite(
        headless, tmp_path / "blind.mcap", edit=edit, metadata=metadata_of(headless),
        keep=lambda topic, count: np.arange(count) < (250 if topic == "/setpoint" else count),
    )  # fmt: skip
    mode = flight_from_bag(path).log["mode"][:, 0]
    descent = int(flown.published["/setpoint"][0][200]) + 1

    assert np.array_equal(mode[:descent], flown.log["mode"][:descent, 0])
    assert (mode[descent : descent + 1000] == 8).all()


def test_a_recording_that_ends_with_the_missions_last_word_has_landed(headless, tmp_path, flown):
    """The set point that would have said so too is no longer there."""
    ticks, setpoints = flown.published["/setpoint"]
    before = int(np.argmax(setpoints["phase"] == Phase.LANDED))
    path = rewrite(
        headless, tmp_path / "ended.mcap", metadata=metadata_of(headless),
        keep=lambda topic, count: np.arange(count) < (before if topic == "/setpoint" else count),
    )  # fmt: skip

    assert flight_from_bag(path).summary["landed"]
    assert flight_from_bag(path).log["mode"][ticks[before] - 2, 0] != Phase.LANDED


def test_a_recording_without_scenario_is_read_with_the_defaults(headless, tmp_path, flown):
    found = flight_from_bag(rewrite(headless, tmp_path / "bare.mcap"))

    assert found.summary["scenario"] == "recording"
    assert found.summary["collision_time_s"] == flown.summary["collision_time_s"]
    assert found.scenario["obstacle"]["x_m"] == pytest.approx(flown.scenario["obstacle"]["x_m"])


def test_a_flight_of_which_only_the_truth_is_there_can_still_be_drawn(headless, tmp_path):
    path = rewrite(
        headless, tmp_path / "truth.mcap", metadata=metadata_of(headless),
        keep=lambda topic, count: np.full(count, topic in TRUTH),
    )  # fmt: skip
    found = flight_from_bag(path)

    assert found.summary["collided"]
    assert not found.summary["detected"]
    assert found.summary["hover_rms_m"] is None
    assert math.isnan(found.log["est_position"][0, 0])
    assert png_bytes(draw_flight(found)).startswith(b"\x89PNG")


def test_a_scenario_that_is_none_is_refused(headless, tmp_path):
    for text in ('{"vehicle": {"mass": -1}}', "[1", '{"obstacle": {"x_m": 1}}'):
        path = rewrite(
            headless, tmp_path / "bad.mcap", metadata={"scenario": text},
            keep=lambda topic, count: np.full(count, topic == TRUTH[0]),
        )  # fmt: skip
        with pytest.raises(InputError, match="its scenario can't be used"):
            flight_from_bag(path)

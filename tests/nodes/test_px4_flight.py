"""The paper's experiment over MAVLink in real time, with all files of a headless flight."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import pytest

from in_time import in_time
from tombo_bag.formats.reader import Bag
from tombo_bag.recording import Recording
from tombo_bag.topics import COLLISION_EVENT, MISSION_STATUS, PX4_STATUS, TRUE_ODOMETRY
from tombo_dynamics.messages import Phase
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario
from tombo_flight.suite.px4_connection import find_vehicle, free_udp_port
from tombo_px4.bridge.axes_proof import AxesEvidence, AxesFile
from tombo_px4.bridge.bridge_params import LinkParams

pytest.importorskip("rclpy")

_COMPILES_S = 300.0
_APPROACH_S = 5.0
"""The way to the obstacle begins as soon as the vehicle hovers."""
SHORT = (f"mission.approach_time={_APPROACH_S}", "mission.hold_time=1.0", "mission.land_speed=0.7")
FLIGHT = ("--px4", *(word for setting in SHORT for word in ("--set", setting)))


@pytest.mark.real_time
def test_the_vehicle_recovers_as_in_the_headless_flight(flight_run):
    folder, figures = flight_run
    headless = fly_scenario(load_scenario(settings=SHORT), 0).summary
    px4 = figures["px4"]
    mission = Recording(folder / "flight.mcap").columns(MISSION_STATUS.name)
    approach_ns = mission["stamp_ns"][mission["phase"] == Phase.APPROACH][0]
    contact_ns = Recording(folder / "flight.mcap").columns(COLLISION_EVENT.name)["stamp_ns"][0]
    with in_time():  # a vehicle whose poses and set points are late flies another flight
        assert figures["collided"] and figures["landed"] and not figures["crashed"]
        assert figures["detections"] == 1 and figures["false_alarms"] == 0
        assert figures["contact_rotor"] == headless["contact_rotor"] == "front_left"
        # the bridge shows the axes above the ground before; no two flights in real time are equal
        way_s = (contact_ns - approach_ns) * 1e-9
        assert way_s == pytest.approx(headless["collision_time_s"] - _APPROACH_S, abs=1.0)
        assert 0.02 < figures["max_falling_distance_m"] < 0.95
        assert 2.0 < figures["recovery_time_s"] < 7.5
        assert figures["settled_error_m"] < 0.15
        assert figures["hover_rms_m"] < 0.15
        assert px4["armed_s"] < 5.0
        assert px4["offboard_duration_s"] > 8.0
        assert 5.0 < px4["mocap_latency_ms"] < 60.0
        assert px4["poses_sent"] == pytest.approx(30.0 * figures["duration_s"], rel=0.4)
        assert px4["setpoints_sent"] > 15.0 * px4["offboard_duration_s"]
        assert figures["loops"]["sim"]["rate_hz"] == pytest.approx(1000.0, rel=0.2)


@pytest.mark.real_time
def test_the_summary_says_what_px4_did(flight_run):
    folder, figures = flight_run
    px4 = figures["px4"]
    assert figures["mode"] == "px4" and figures["died"] == {}
    assert "known_from" not in figures, "the truth of a simulated vehicle is known"
    modes = [mode for _, mode in px4["modes"]]
    assert [modes.index(mode) for mode in ("hold", "offboard", "land")] == [0, 1, 2]
    assert px4["armed_s"] > 0.0
    assert px4["armed_duration_s"] > px4["offboard_duration_s"] > 0.0
    assert px4["armed_s"] + px4["armed_duration_s"] < figures["duration_s"], "not disarmed"
    texts = [text for _, text in px4["status_texts"]]
    assert "Takeoff detected" in texts and "Disarmed by landing" in texts
    # the clock of the simulated PX4 began with it; ours long before
    assert px4["time_offset_ns"] > 10**18
    assert px4["messages_in"] > 3_000 and px4["messages_out"] > 500
    assert px4["firmware"] == "1.17.0"
    bag = Bag(folder / "flight.mcap", check=True)
    assert not bag.damage and bag.topics[PX4_STATUS.name].count >= 5


@pytest.mark.real_time
def test_px4_stands_for_estimator_and_controller(flight_run):
    folder, figures = flight_run
    assert {path.name for path in folder.iterdir()} == {
        "flight.mcap", "flight.png", "report.html", "scenario.yaml", "summary.json"
    }  # fmt: skip
    assert set(figures["loops"]) == {
        "sim", "detector", "reaction", "mission", "recorder", "px4_bridge"
    }  # fmt: skip
    topics = Bag(folder / "flight.mcap").topics
    assert not {"/rotor_command", "/attitude_setpoint", "/estimator/status"} & set(topics)
    with in_time():
        assert topics["/odometry"].count > 50.0 * figures["duration_s"]


@pytest.fixture
def lab(start):
    """A PX4 and a motion capture that are there before the flight: URL, and node."""
    port = free_udp_port()
    quiet = ("-p", "ground_url:=''", "-p", "effects.mocap_noise.position:=0.0007")
    node = start(
        "tombo_px4.px4_sim_node", "-p", f"onboard_url:=udpout://127.0.0.1:{port}", *quiet,
        "-p", "effects.mocap_noise.attitude:=0.002",
    )  # fmt: skip
    return f"udpin://127.0.0.1:{port}", node


def test_ctrl_c_in_the_air_lands_the_vehicle(world, lab, domain, tmp_path):
    world.subscribe(TRUE_ODOMETRY, MISSION_STATUS)
    world.meet(TRUE_ODOMETRY, patience_s=_COMPILES_S)
    url, node = lab
    proof = tmp_path / "axes.yaml"
    record = AxesEvidence("2026-11-24T10:00:00+00:00", "lab", "544f4d424f", tilt_rad=(0.0, 0.0))
    AxesFile(str(proof)).add(record)
    words = ("fly", "hover", "--px4", url, "--yes", "--domain", str(domain), "-o", "out", "--json")
    words += ("--set", "mission.height=1.2")
    words += ("--bridge", f"px4.axes_evidence={proof}", "--bridge", "px4.tracked_body=lab")
    command = subprocess.Popen(
        [sys.executable, "-m", "tombo_bringup.cli.main", *words],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        # the mission is there once all is loaded, however long this takes on a busy machine
        world.wait_for(MISSION_STATUS, lambda m: True, patience_s=_COMPILES_S)
        world.wait_for(TRUE_ODOMETRY, lambda m: m.pose.pose.position.z > 0.8, patience_s=120.0)
        # a landing that PX4 flies in the middle of a mission is none of the mission's phases
        world.wait_for(MISSION_STATUS, lambda m: m.phase == m.HOVER, patience_s=120.0, since=0)
        command.send_signal(signal.SIGINT)
        out, err = command.communicate(timeout=120.0)
    finally:
        command.kill()
        command.wait()
    assert command.returncode == 130, err
    assert "a PX4 quadrotor, system 1, disarmed, in mode hold. This arms it" in err
    summary = json.loads(out)
    px4 = summary["px4"]
    assert summary["interrupted"] and "land" in [mode for _, mode in px4["modes"]]
    assert px4["status_texts"][-1][1] == "Disarmed by landing"
    assert "landing; Ctrl-C again leaves it to PX4" in err and "still armed" not in err
    assert summary["died"] == {} and summary["landed"]

    # the port is free again: nothing that was started is left
    params = LinkParams(url=url)
    vehicle = find_vehicle(params, patience_s=60.0)
    assert vehicle is not None and not vehicle.armed
    world.hear()
    assert world.heard[TRUE_ODOMETRY.name][-1].pose.pose.position.z < 0.25
    assert "No offboard signal" not in node.output, "its fail-safe brought it down, not our word"

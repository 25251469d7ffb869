"""A flight over MAVLink: the vehicle at the other end, and a summary without ground truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bag_rewrite import metadata_of, rewrite
from px4_bench import speaking

from tombo_bag.columnar_cdr import encode
from tombo_bag.flight import Flight
from tombo_bag.flight_time import stamp
from tombo_bag.flight_topics import write_flight
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.recording import Recording
from tombo_bag.topics import DIAGNOSTICS, PX4_STATUS
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import EPOCH_NS
from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import write_mcap
from tombo_flight.recorded_flight import measured_track, read_flight
from tombo_flight.scenario import load_scenario
from tombo_flight.suite.node_diagnostics import NodeStatus
from tombo_flight.suite.node_flight import over_mavlink
from tombo_flight.suite.px4_connection import find_vehicle, px4_connection
from tombo_flight.suite.px4_flight import READY_S, START_S, BridgeMonitor, px4_metrics
from tombo_px4.bridge.bridge_params import LinkParams
from tombo_px4.bridge.vehicle_parameters import parse_assignments


def test_without_a_url_both_ends_meet_on_a_free_port_of_this_machine():
    connection = px4_connection(None, ["px4.stream_rate=50", "link.own_system=200"])

    port = int(connection.link.url.rpartition(":")[2])
    assert connection.simulated
    assert connection.link.url == f"udpin://127.0.0.1:{port}"
    assert connection.parameters["sim"]["onboard_url"] == f"udpout://127.0.0.1:{port}"
    assert connection.parameters["px4_bridge"]["px4"]["stream_rate"] == 50.0
    assert connection.parameters["px4_bridge"]["link"]["own_system"] == 200
    assert px4_connection(None, []).link.url != connection.link.url


def test_with_a_url_nothing_is_simulated():
    connection = px4_connection("udpin://127.0.0.1:14540", [])

    assert not connection.simulated
    assert set(connection.parameters) == {"px4_bridge"}
    assert over_mavlink(connection)["without"] == ("sim",)


def test_a_vehicle_is_known_by_its_heartbeat():
    with speaking(1, armed=True) as url:
        found = find_vehicle(LinkParams(url=url), patience_s=60.0)

    assert found is not None
    assert (found.system, found.component, found.armed, found.mode) == (1, 1, True, "hold")
    assert found.description == "a PX4 quadrotor, system 1, armed, in mode hold"


@pytest.mark.slow
def test_nobody_at_the_other_end_is_said():
    connection = px4_connection(None, [])
    with pytest.raises(InputError, match=r"no heartbeat within 0\.3 s; accepted: a link on which"):
        find_vehicle(connection.link, patience_s=0.3)


def test_another_system_is_named_and_how_to_reach_it():
    with speaking(7, 2) as url, pytest.raises(
        InputError, match=r"system 7 speaks here, waiting for 1: set link.system=7"
    ):  # fmt: skip
        find_vehicle(LinkParams(url=url), patience_s=0.5)


def test_an_autopilot_that_is_no_px4_is_refused():
    with speaking(1, autopilot=3) as url, pytest.raises(InputError, match="pilot 3 is not PX4"):
        find_vehicle(LinkParams(url=url), patience_s=60.0)


@pytest.mark.slow
def test_a_parameter_that_px4_does_not_know_is_refused_before_the_flight():
    with (
        speaking(1) as url,
        pytest.raises(InputError, match="PX4 does not know NO_SUCH; accepted"),
    ):
        find_vehicle(LinkParams(url=url), parameters=("NO_SUCH",), patience_s=5.0)


def test_poses_of_a_model_need_no_proof_and_others_do():
    assert px4_connection(None, []).bridge.axes_evidence == "simulated"
    assert px4_connection("udpin://127.0.0.1:14540", []).bridge.axes_evidence == ""
    with pytest.raises(InputError, match="prove the axes by hand"):
        px4_connection("udpin://127.0.0.1:14540", ["px4.axes_evidence=simulated"])


def test_a_stop_ends_the_waiting():
    assert find_vehicle(px4_connection(None, []).link, stop=lambda: True) is None


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly_scenario(load_scenario(settings=["mission.approach_time=5.5"]), 0)


@pytest.fixture(scope="module")
def real(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a real vehicle: no ground truth."""
    folder = tmp_path_factory.mktemp("bag")
    write_mcap(flight, folder / "whole.mcap")
    return without(folder / "whole.mcap", folder / "real.mcap", "/ground_truth")


def without(source: Path, target: Path, prefix: str) -> Path:
    def keep(topic: str, count: int) -> np.ndarray:
        return np.full(count, not topic.startswith(prefix))

    return rewrite(source, target, metadata=metadata_of(source, "epoch_ns"), keep=keep)


@pytest.mark.slow
def test_of_a_real_vehicle_the_mocap_is_what_is_known(flight, real):
    found, wanted = read_flight(real).summary, flight.summary

    assert found["known_from"] == "mocap"
    assert "known_from" not in wanted
    assert found["collided"] and found["landed"] and not found["crashed"]
    # contact is the detector's, from poses at 30 Hz
    shift_s = wanted["collision_time_s"] - found["collision_time_s"]
    assert found["max_falling_distance_m"] == pytest.approx(
        wanted["max_falling_distance_m"], abs=0.06
    )
    assert found["recovery_time_s"] == pytest.approx(wanted["recovery_time_s"], abs=0.5)
    assert found["unstable_phase_s"] == pytest.approx(wanted["unstable_phase_s"], abs=0.2)
    assert found["settled_error_m"] == pytest.approx(wanted["settled_error_m"], abs=0.01)
    assert found["hover_rms_m"] == pytest.approx(wanted["hover_rms_m"], abs=0.01)
    assert abs(shift_s) < 1.5
    for key in ("contact_point_m", "contact_rotor", "detection_latency_s", "strikes"):
        assert found[key] is None, key


@pytest.mark.slow
def test_with_neither_truth_nor_poses_there_is_no_flight(real, tmp_path):
    path = without(real, tmp_path / "blind.mcap", "/mocap")
    with pytest.raises(InputError, match="no poses on /mocap/pose"):
        read_flight(path)


def test_poses_are_put_in_order_and_bad_ones_left_out():
    ms = 1_000_000
    stamps = np.array([0, 20, 10, 20, 30, 40]) * ms
    x = np.array([0.0, 2.0, 1.0, 2.0, np.nan, 4.0])
    position = np.column_stack([x, np.zeros(6), np.ones(6)])
    attitude = np.tile([0.0, 0.0, 0.0, 1.0], (6, 1))
    attitude[5] = 0.0
    poses = {"stamp_ns": stamps, "position": position, "attitude": attitude}
    track = measured_track(poses)

    assert track is not None
    assert track["stamp_ns"].tolist() == [0, 10 * ms, 20 * ms]
    assert track["position"][:, 0].tolist() == [0.0, 1.0, 2.0]
    assert track["velocity_in_map"] == pytest.approx(np.tile([100.0, 0.0, 0.0], (3, 1)))
    assert measured_track({name: column[5:] for name, column in poses.items()}) is None


READY = {
    "connected": True, "armed": False, "mode": "hold", "stage": "ready", "why": "",
    "status_text": "", "findings": [],
}  # fmt: skip


def watched(*looks: tuple[float, dict[str, object] | None, int | None, bool]) -> BridgeMonitor:
    """A watch that has had looks at: time, changes of the status, phase, over."""
    found = BridgeMonitor()
    for time_s, status, phase, over in looks:
        found.see(None if status is None else {**READY, **status}, phase, time_s, over=over)
    return found


def test_a_vehicle_that_arms_and_disarms_is_at_rest_in_the_end():
    looks = [(0.0, {}, 0, False), (3.0, {"armed": True}, 1, False), (30.0, None, 7, True)]
    assert not watched(*looks).at_rest
    assert watched(*looks).refusal == ""
    assert watched(*looks, (32.0, {"armed": False}, 7, True)).at_rest
    # one that stays armed is not waited for without end
    assert watched(*looks, (50.0, None, 7, True)).at_rest


@pytest.mark.parametrize(
    ("looks", "reason"),
    [
        (
            [(1.0, {"stage": "given up", "why": "arming denied: 'Resolve ...'"}, 1, False)],
            "PX4 did not take off: arming denied: 'Resolve ...'",
        ),
        ([(1.0, {"findings": ["a", "b"]}, 7, False)], "PX4 was not armed within 0 s: a; b"),
        ([(START_S + 1, None, None, False)], "the bridge has said nothing for 61 s"),
        ([(1.0, {}, 0, False), (READY_S + 2, {"connected": False}, None, False)], "no heartbeat"),
        (
            [(40.0, {}, 0, False), (READY_S + 41, {"findings": ["nothing is fused"]}, 0, False)],
            "PX4 was not armed within 26 s: nothing is fused",
        ),
    ],
)
def test_a_vehicle_that_does_not_arm_is_given_up_with_the_reason(looks, reason):
    found = watched((0.0, None, None, False), *looks).refusal
    assert found.endswith(reason) and bool(found) == bool(reason)


@pytest.mark.parametrize(
    ("last", "phase", "reason"),
    [
        ({"status_text": "Disarmed by auto preflight disarming"}, 7, "auto preflight disarming"),
        ({"stage": "given up", "why": "disarmed in flight", "status_text": "x"}, 1, "in flight"),
        ({"why": "landed"}, 1, ""),
        ({"armed": True}, 7, ""),
    ],
)
def test_what_arms_and_stays_on_the_ground_is_given_up(last, phase, reason):
    looks = [(0.0, {"armed": True}, 1, False), (5.0, last, phase, False)]
    found = watched(*looks).refusal
    assert found.endswith(reason) and bool(found) == bool(reason)
    assert not reason or found.startswith("it armed, but by its poses it never left the ground: ")


LOST = NodeStatus(1, "flight_lost: poses stand still: PX4 lands", {"fault.flight_lost": "active"})


def test_a_loss_is_named_by_the_bridge_and_not_by_px4s_last_words():
    """A body that lies on the floor: by its poses nothing has lifted off."""
    words = {"status_text": "Disarmed by landing"}
    found = watched((0.0, {"armed": True}, 1, False))
    assert found.loss == ""
    found.see(None, 1, 4.0, over=False, bridge=LOST)  # the report may come before the status
    landing = {"armed": True, "stage": "landing", "why": "poses stand still"}
    found.see({**READY, **landing}, 2, 4.1, over=False, bridge=LOST)
    over = NodeStatus(0, "", {"fault.flight_lost": "over, 1 times"})
    found.see({**READY, **words, "why": "landed"}, 7, 12.0, over=False, bridge=over)
    assert found.loss == "poses stand still"
    assert found.refusal.endswith("it never left the ground: poses stand still")


@pytest.mark.parametrize(
    ("counted", "why"), [("axes_wrong", "axes"), ("disarmed", "in flight"), ("mode_taken", "")]
)
def test_only_what_nobody_has_asked_for_is_a_loss(counted, why):
    found = watched((0.0, {"armed": True}, 1, False))
    bridge = NodeStatus(1, why, {f"fault.{counted}": "active, 1 times"})
    found.see(READY, 2, 5.0, over=False, airborne=True, bridge=bridge)
    found.see(READY, 7, 9.0, over=True, airborne=True, bridge=bridge)
    assert (found.loss, found.refusal) == (why, "")


def test_parameters_of_px4_go_to_the_bridge():
    connection = px4_connection(None, ["px4_parameters=[EKF2_EV_CTRL=11, NAV_DLL_ACT=0]"])
    wanted = ["EKF2_EV_CTRL=11", "NAV_DLL_ACT=0"]
    assert connection.parameters["px4_bridge"]["px4_parameters"] == wanted
    assert "px4_parameters" not in px4_connection(None, []).parameters["px4_bridge"]
    safe = px4_connection(None, ["px4_parameters=safe"])
    assert safe.parameters["px4_bridge"]["px4_parameters"] == ["safe"]
    both = parse_assignments(px4_connection(None, ["px4_parameters=[safe, mocap]"]).writes)
    assert both["COM_OBL_RC_ACT"] == 4 and both["SYS_HAS_GPS"] == 0 == both["EKF2_RNG_CTRL"]


def test_a_px4_that_signs_wants_a_key_on_this_side(tmp_path):
    key = tmp_path / "key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o600)
    with speaking(1, key=key.read_bytes()) as url:
        with pytest.raises(InputError, match="PX4 signs its messages and this side has no key"):
            find_vehicle(LinkParams(url=url), patience_s=60.0)
        assert find_vehicle(LinkParams(url=url, key_file=str(key)), patience_s=60.0) is not None


@pytest.mark.slow
def test_the_summary_tells_what_the_bridge_has_told(flight, tmp_path):
    path = tmp_path / "flight.mcap"
    states = [
        (0.5, {"mode": "hold", "stage": "ready"}),
        (1.0, {"mode": "offboard", "stage": "arming"}),
        (1.5, {"mode": "offboard", "stage": "offboard", "armed": True, "offboard": True}),
        (9.0, {"mode": "land", "stage": "landing", "armed": True, "status_text": "Landing"}),
        (11.0, {"mode": "land", "stage": "ready", "status_text": "Disarmed"}),
    ]  # fmt: skip
    values = {"timesync_offset_ns": -5, "mocap_latency_ms": 10.5, "link.received": 77,
              "link.unsigned": 3, "refused.range": 2, "refused.time": 0, "link.url": "udpin://",
              "timesync_round_trip_us": None}  # fmt: skip
    report = {
        "status": [
            {"name": "px4_bridge",
             "values": [{"key": k, "value": str(v)} for k, v in values.items()]}
        ]
    }  # fmt: skip
    with McapSink(path) as sink:
        write_flight(sink, flight)
        for spec, times, messages in (
            (PX4_STATUS, [t for t, _ in states], [status(t, **more) for t, more in states]),
            (DIAGNOSTICS, [2.0], [encode(DIAGNOSTICS.typename, report)]),
        ):
            stamps = np.array([EPOCH_NS + round(t * 1e9) for t in times])
            sink.write_columns(
                Columns(sink.add_channel(spec.name, spec.typename), stamps, messages)
            )
    record = read_flight(path)
    with Recording(path) as recording:
        found = px4_metrics(recording, record)

    assert record.epoch_ns == EPOCH_NS
    assert (found["armed_s"], found["armed_duration_s"]) == (1.5, 9.5)
    assert (found["offboard_s"], found["offboard_duration_s"]) == (1.5, 7.5)
    assert found["modes"] == [[0.5, "hold"], [1.0, "offboard"], [9.0, "land"]]
    assert found["status_texts"] == [[9.0, "Landing"], [11.0, "Disarmed"]]
    assert found["firmware"] == "1.17.0"
    assert (found["time_offset_ns"], found["mocap_latency_ms"]) == (-5, 10.5)
    assert (found["messages_in"], found["messages_out"]) == (77, None)
    assert found["time_round_trip_us"] is None


def status(time_s: float, **more: object) -> bytes:
    header = {"stamp": stamp(EPOCH_NS + round(time_s * 1e9)), "frame_id": "map"}
    return encode(PX4_STATUS.typename, {"header": header, "firmware": "1.17.0", **more})

import json
import math

import numpy as np
import pytest

from tombo_bag.flight import Flight, Topic
from tombo_bag.topics import MISSION_STATUS, MOCAP_POSE, REACTION_STATUS, TRUE_CONTACT
from tombo_dynamics.errors import InputError
from tombo_web.live_session import FRAME_HZ, LiveSession
from tombo_web.live_view import SCENE, STALE_POSE_S, LiveView, TopicMessage
from tombo_web.playback import Playback

LATENCY_S = 0.012


def flight_of(duration_s=10.0, contact_s=6.0):
    """A vehicle that climbs at 0.1 m/s, seen at 100 Hz, with one touch of 3 ms."""
    t = np.arange(0.0, duration_s, 0.01)
    position = np.stack((0 * t, 0 * t, 0.1 * t), axis=1)
    attitude = np.tile((0.0, 0.0, 0.0, 1.0), (len(t), 1))
    touch = contact_s + np.arange(4) * 0.001
    columns = {
        "in_contact": np.array([True, True, True, False]),
        "rotor": np.full(4, 2),
        "force": np.array([[5.0, 0, 0], [9.0, 0, 0], [4.0, 0, 0], [0.0, 0, 0]]),
    }
    return Flight(
        {
            MOCAP_POSE.name: Topic.of(
                t, {"position": position, "attitude": attitude}, t + LATENCY_S
            ),
            MISSION_STATUS.name: Topic.of(np.array([0.0, 2.0]), {"phase": np.array([1, 2])}),
            TRUE_CONTACT.name: Topic.of(touch, columns),
        },
        name="climb",
        summary={"collision_time_s": contact_s},
    )


def session_of(flight=None, **options):
    return LiveSession(Playback(flight or flight_of(), **options), "climb", None)


def column(frame, name):
    first = sum(width for other, (width, _) in list(SCENE.items())[: list(SCENE).index(name)])
    return frame["row"][first : first + SCENE[name][0]]


class Suite:
    """Stands for running nodes: no playback, but requests."""

    seekable, now_s = False, 0.0

    def __init__(self):
        self.asked = []

    def begin(self):
        return []

    def advance(self, elapsed_s):
        return []

    def request(self, name):
        self.asked.append(name)


@pytest.mark.parametrize("speed", [0.1, 1.0, 4.0])
def test_playback_shows_the_newest_pose_that_had_come_at_its_speed(speed):
    session = session_of(speed=speed)
    for _ in range(60):
        frame = session.advance(1.0 / FRAME_HZ)
    t = frame["t"]
    assert t == pytest.approx(min(speed * 60 / FRAME_HZ, 9.99 + LATENCY_S), abs=1e-3)
    assert column(frame, "position")[2] == pytest.approx(0.1 * (t - LATENCY_S), abs=0.0011)
    assert frame["pose"]["latency_ms"] == pytest.approx(1e3 * LATENCY_S, abs=1e-6)


def test_a_touch_of_three_milliseconds_is_in_one_frame_with_its_largest_force():
    session = session_of()
    session.obey({"do": "seek", "value": 5.98}, 0.0, trusted=False)
    forces = [column(session.advance(1.0 / FRAME_HZ), "contact_N")[0] for _ in range(5)]
    assert sorted(forces) == [0.0, 0.0, 0.0, 0.0, 9.0]


def test_pause_step_and_seek():
    session = session_of()
    session.obey({"do": "pause"}, 0.0, trusted=False)
    assert session.advance(1.0)["t"] == session.advance(1.0)["t"]
    before = session.advance(0.0)["t"]
    session.obey({"do": "step", "value": 0.25}, 0.0, trusted=False)
    assert session.advance(0.0)["t"] == pytest.approx(before + 0.25)
    session.obey({"do": "seek", "value": 8.0}, 0.0, trusted=False)
    hello = session.hello()
    assert session.sought() and not session.sought()
    frames = hello["frames"]
    assert frames[0]["t"] < 0.1 and frames[-1]["t"] == pytest.approx(8.0, abs=0.04)
    assert [c["text"] for f in frames for c in f["changes"] if c["kind"] == "phase"] == [
        "takeoff",
        "hover",
    ]
    session.obey({"do": "seek", "value": 1.0}, 0.0, trusted=False)
    assert session.advance(0.0)["state"]["phase"] == "takeoff"
    session.obey({"do": "seek", "value": 99.0}, 0.0, trusted=False)
    assert session.advance(0.0)["t"] == pytest.approx(9.99 + LATENCY_S)


def test_picked_signals_come_in_every_frame_and_unknown_ones_are_refused():
    session = session_of()
    for _ in range(5):
        session.advance(1.0 / FRAME_HZ)
    session.obey({"do": "pick", "value": ["/mocap/pose.position.z"]}, 0.0, trusted=False)
    frame = session.advance(1.0 / FRAME_HZ)
    assert frame["values"]["/mocap/pose.position.z"] == pytest.approx(column(frame, "position")[2])
    with pytest.raises(InputError, match="no such signal"):
        session.obey({"do": "pick", "value": ["/nothing.x"]}, 0.0, trusted=False)


@pytest.mark.parametrize(
    "request_",
    [
        {},
        {"do": "speed", "value": 0},
        {"do": "seek", "value": math.nan},
        {"do": "step", "value": 10**400},
        {"do": "pick", "value": "/mocap/pose.position.z"},
        {"do": "pick", "value": ["x"] * 17},
        {"do": "hold"},
    ],
)
def test_what_cannot_be_done_is_refused_with_what_is_accepted(request_):
    with pytest.raises(InputError, match=r"accepted|no such"):
        session_of().obey(request_, 0.0, trusted=True)


def test_kill_takes_a_second_press_and_trust():
    session = LiveSession(suite := Suite(), "suite", None)
    with pytest.raises(InputError, match="accepted from the page"):
        session.obey({"do": "land"}, 0.0, trusted=False)
    session.obey({"do": "hold"}, 0.0, trusted=True)
    session.obey({"do": "kill"}, 1.0, trusted=True)
    session.obey({"do": "kill"}, 9.0, trusted=True)  # too late for the first
    assert suite.asked == ["hold"]
    session.obey({"do": "kill"}, 10.0, trusted=True)
    assert suite.asked == ["hold", "kill"]
    session.obey({"do": "kill"}, 10.1, trusted=True)  # the next kill takes two again
    assert suite.asked == ["hold", "kill"]


def test_frames_are_json_also_where_numbers_are_not_finite():
    view = LiveView()
    pose = {"position": np.full(3, math.nan), "attitude": np.array([0, 0, 0, 1.0])}
    view.take(TopicMessage(MOCAP_POSE.name, pose, 1.0, 1.01))
    marks = {"state": 0, "x_c": np.full(3, math.nan), "x_r": np.zeros(3), "n_r": np.ones(3)}
    view.take(TopicMessage(REACTION_STATUS.name, marks, 1.0, 1.0))
    frame = json.loads(json.dumps(view.frame(1.05, ["/nothing"]), allow_nan=False))
    assert column(frame, "position") == [None, None, None]
    assert frame["marks"]["x_c_m"] is None and frame["marks"]["x_r_m"] == [0.0, 0.0, 0.0]


def test_silent_poses_are_a_fault_and_so_is_their_return_told():
    view = LiveView()
    pose = {"position": np.zeros(3), "attitude": np.array([0, 0, 0, 1.0])}
    told = []
    for k in range(100):
        now = 0.02 * k
        if not 0.5 < now < 1.0:
            view.take(TopicMessage(MOCAP_POSE.name, pose, now - 0.01, now))
        told += [(c["time_s"], c["text"]) for c in view.frame(now, [])["changes"]]
    assert [text for _, text in told] == ["none", "come again"]
    assert told[0][0] == pytest.approx(0.5 + STALE_POSE_S, abs=0.041)
    assert told[1][0] == pytest.approx(1.0, abs=0.021)


def status(topic, now, **fields):
    return TopicMessage(topic.name, fields, now, now)


def test_a_suite_that_is_started_again_is_another_flight():
    suite = Suite()
    session = LiveSession(suite, "suite", None)
    pose = {"position": np.zeros(3), "attitude": np.array([0, 0, 0, 1.0])}
    reacted = {"state": 1, "x_c": np.ones(3), "x_r": np.zeros(3), "n_r": np.ones(3)}

    def frame(*messages):
        suite.advance = lambda elapsed_s: list(messages)
        return session.advance(1.0 / FRAME_HZ)

    frame(status(MISSION_STATUS, 0.0, phase=0), status(MOCAP_POSE, 0.0, **pose))
    flown = frame(status(MISSION_STATUS, 1.0, phase=4), status(REACTION_STATUS, 1.0, **reacted))
    assert flown["marks"]["x_c_m"] == [1.0, 1.0, 1.0] and not session.sought()
    assert flown["state"]["reaction"] == "reacting"
    again = frame(status(MISSION_STATUS, 9.0, phase=0))
    assert session.sought(), "pages are not told to begin again"
    assert again["marks"]["x_c_m"] is None and again["state"] == {"phase": "idle"}
    assert session.hello()["frames"] == [again]

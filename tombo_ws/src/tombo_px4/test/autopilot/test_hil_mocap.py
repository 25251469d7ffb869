"""Motion capture for PX4: poses over UDP in PX4's own clock, or on the simulator link itself."""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from endpoint_bench import Client
from hil_bench import Bench, bench, hover_world
from pymavlink.dialects.v20 import common as MAVLINK

from tombo_dynamics.records import numbers
from tombo_px4.frames import enu_from_ned, ros_quaternion
from tombo_px4.hil.lockstep import HilSimulator, MocapFeed
from tombo_px4.hil.params import HilParams
from tombo_px4.link.mavlink_link import Link


@pytest.fixture
def onboard() -> Iterator[Client]:
    """PX4's on-board MAVLink port."""
    made = Client(system=1, component=1)
    yield made
    made.socket.close()


@pytest.fixture
def fed(onboard: Client) -> Iterator[Bench]:
    """A flight whose poses go to `onboard`."""
    clock = itertools.count(1)
    link = Link(f"udpout://{onboard.address}", system=1, component=197, clock=lambda: next(clock))
    onboard.there = link.address
    b = Bench()
    b.hil = HilSimulator(hover_world(), 1, HilParams(), b.link, speed=0.0, mocap=MocapFeed(link))
    yield b
    b.close()
    link.close()


def poses(messages: list[Any]) -> list[Any]:
    return [m for m in messages if m.get_type() == "ODOMETRY"]


def assert_true(message: Any, truth: dict[int, np.ndarray]) -> None:
    """The pose is what the vehicle's was at the message's stamp."""
    body = truth[message.time_usec]
    position = enu_from_ned([message.x, message.y, message.z])
    assert position == pytest.approx(body[:3], abs=0.006)
    attitude = ros_quaternion(message.q)
    assert abs(attitude @ body[6:10]) == pytest.approx(1.0, abs=1e-4)


class Truths(dict[int, np.ndarray]):
    """True states by time [us], of every tick: poses are captured between steps too."""

    def __init__(self, b: Bench) -> None:
        super().__init__()
        simulator = b.hil.flight.simulator
        advance = simulator.advance

        def watched(command: Any) -> None:
            advance(command)
            self[1000 * simulator.tick] = numbers(simulator.plant.state)

        simulator.advance = watched


@pytest.mark.slow
def test_poses_go_out_in_px4s_frames_and_clock(fed, onboard):
    truth = Truths(fed)
    heard = []
    while fed.seconds < 3.0:
        fed.turn()
        heard += [(fed.hil.flight.time_us, m) for m in poses(onboard.collect())]
    assert len(heard) == pytest.approx(90, abs=2)
    for now_us, message in heard[1:]:
        assert 7_000 <= now_us - message.time_usec <= 18_000
        assert_true(message, truth)
        assert message.estimator_type == MAVLINK.MAV_ESTIMATOR_TYPE_VISION
        assert message.frame_id == MAVLINK.MAV_FRAME_LOCAL_NED
        assert message.get_srcComponent() == 197
    stamps = [m.time_usec for _, m in heard]
    assert np.mean(np.diff(stamps)) == pytest.approx(33_333, abs=400)


def test_a_timesync_is_answered_with_px4s_own_clock(fed, onboard):
    fed.fly(1.0)
    onboard.collect()
    asked = 1000 * fed.hil.flight.time_us
    onboard.send(onboard.mav.timesync_encode(0, asked))
    onboard.send(onboard.mav.timesync_encode(77, asked + 5))  # an answer to somebody else's
    fed.fly(1.1)
    answers = [m for m in onboard.collect() if m.get_type() == "TIMESYNC"]
    assert [m.ts1 for m in answers] == [asked]
    assert 0 <= answers[0].tc1 - asked <= 12_000_000
    beats = [m for m in onboard.collect() if m.get_type() == "HEARTBEAT"]
    assert beats == []


@pytest.mark.slow
def test_the_feed_lives_on_when_px4_starts_again(fed, onboard):
    fed.fly(2.5)
    fed.peer.close()
    fed.peer = type(fed.peer)(fed.link.port)
    onboard.collect()
    fed.until(lambda: fed.hil.flights == 2)
    fed.fly(1.0)
    heard = onboard.collect()
    assert [m.get_type() for m in heard].count("HEARTBEAT") == 1
    stamps = [m.time_usec for m in poses(heard)]
    assert len(stamps) == pytest.approx(30, abs=2)
    assert max(stamps) <= 1_000_000


@pytest.mark.slow
def test_poses_on_the_simulator_link_precede_the_sensors_of_their_step():
    with bench(mocap=True) as b:
        truth = Truths(b)
        b.peer.keep = True
        b.fly(3.0)
        heard = b.peer.heard
        odometry = poses(heard)
        assert len(odometry) == pytest.approx(90, abs=2)
        for message in odometry[1:]:
            assert_true(message, truth)
        sensors = [i for i, m in enumerate(heard) if m.get_type() == "HIL_SENSOR"]
        for i, message in enumerate(heard):
            if message.get_type() == "ODOMETRY" and message.time_usec > 100_000:
                after = next(heard[k] for k in sensors if k > i)
                assert 7_000 <= after.time_usec - message.time_usec <= 18_000


def test_a_wrong_stamp_goes_out_and_one_from_before_the_clock_does_not():
    world = hover_world("effects.mocap_stamp_error.offset=-0.09")
    with bench(world, mocap=True) as b:
        b.peer.keep = True
        truth = Truths(b)
        b.fly(1.0)
    sent = poses(b.peer.heard)
    assert len(sent) == pytest.approx(27, abs=1)
    late = [m.time_usec + 90_000 for m in sent]
    assert all(stamp in truth for stamp in late)
    assert min(m.time_usec for m in sent) >= 0

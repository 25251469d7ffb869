"""Frames, clocks, axes: a line for each mistake of a recording's poses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tombo_flight.replay.poses import PoseTrack, check_poses, find_up_axis


def part(track: PoseTrack, rows: slice | np.ndarray) -> PoseTrack:
    return PoseTrack(*(column[rows] for column in vars(track).values()))


def only(track: PoseTrack) -> str:
    findings = check_poses(track, 0.25)
    assert len(findings) == 1, findings
    assert "\n" not in findings[0]
    return findings[0]


def test_a_sound_flight_gives_no_finding(flight):
    assert check_poses(flight, 0.25) == []


def test_no_poses_or_few_give_no_finding(flight):
    assert check_poses(PoseTrack.none(), 0.25) == []
    assert check_poses(part(flight, slice(2)), 0.25) == []


def test_a_frame_other_than_map(flight):
    found = only(replace(flight, frame=np.full(len(flight.frame), "world")))
    assert "frame_id is 'world' in 1198 of 1198 poses" in found
    assert "--frame-ok 'world'" in found
    assert check_poses(flight.renamed("world"), 0.25) == []


def test_numbers_that_are_none_and_quaternions_that_are_none(flight):
    position, attitude = flight.position.copy(), flight.attitude.copy()
    position[5, 1] = np.nan
    attitude[7] = 0.0
    attitude[9:12] *= 1.05
    findings = check_poses(replace(flight, position=position, attitude=attitude), 0.25)
    assert findings[0] == "1 of 1198 poses are not finite"
    assert findings[1] == "1 of 1198 quaternions are zero"
    assert findings[2] == "3 of 1198 quaternions are not unit (norm 1.050 to 1.050)"
    assert len(findings) == 3


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (3.21, "stamps run 3.2 s ahead of arrival"),
        (0.05, "stamps run 40 ms ahead of arrival"),
        (-3.2005, "stamps run 3.2 s behind arrival"),
    ],
)
def test_two_clocks_with_an_offset(flight, seconds, words):
    shifted = flight.shifted(round(1e9 * seconds))
    found = only(shifted)
    assert found.startswith(words)
    advice = float(found.split("--shift-stamps ")[1].split()[0].rstrip(")"))
    assert advice == pytest.approx(-seconds, abs=0.01)
    assert check_poses(shifted.shifted(round(1e9 * advice)), 0.25) == []


def test_a_clock_that_is_set_in_flight(flight):
    stamps = flight.stamp_ns.copy()
    stamps[600:] += 400_000_000
    findings = check_poses(replace(flight, stamp_ns=stamps), 0.25)
    assert any("jumps once, by 400 ms" in finding for finding in findings), findings
    assert not any("drift" in finding for finding in findings)


def test_stamps_of_zero(flight):
    unstamped = replace(flight, stamp_ns=np.zeros_like(flight.stamp_ns))
    assert "1198 of 1198 stamps are zero (--stamp-on-arrival" in only(unstamped)
    assert check_poses(unstamped.with_arrival_stamps(), 0.25) == []


def turned_up(track: PoseTrack, order: list[int], signs: list[float]) -> PoseTrack:
    """The same flight in axes that a lab may stream."""
    position = track.position[:, order] * signs
    vector = track.attitude[:, :3][:, order] * signs
    attitude = np.column_stack([vector, track.attitude[:, 3]])
    return replace(track, position=position, attitude=attitude)


@pytest.mark.parametrize("bag", ["paper_collision_7", "aggressive_2", "no_obstacle_1"])
def test_y_up_as_motive_streams_it(poses, bag):
    findings = check_poses(turned_up(poses(bag), [0, 2, 1], [1.0, 1.0, -1.0]), 0.25)
    assert "axis y looks like up" in findings[-1]
    assert "and tilt agrees" in findings[-1]


def test_y_up_in_a_recording_that_begins_and_ends_in_flight(flight):
    airborne = part(flight, slice(250, 980))
    assert check_poses(airborne, 0.25) == []
    assert "axis y looks like up" in only(turned_up(airborne, [0, 2, 1], [1.0, 1.0, -1.0]))


def drifting(track: PoseTrack) -> PoseTrack:
    since = track.stamp_ns - track.stamp_ns[0]
    return replace(track, stamp_ns=track.stamp_ns - (since * 1e-3).astype(np.int64))


def restamped(track: PoseTrack, *order: int) -> PoseTrack:
    """Stamps from the 100th on are those of these poses."""
    stamps = track.stamp_ns.copy()
    stamps[100 : 100 + len(order)] = stamps[list(order)]
    return replace(track, stamp_ns=stamps)


def frozen(track: PoseTrack) -> PoseTrack:
    position, attitude = track.position.copy(), track.attitude.copy()
    position[400:420], attitude[400:420] = position[400], attitude[400]
    return replace(track, position=position, attitude=attitude)


def rolled_over(track: PoseTrack) -> PoseTrack:
    x, y, z, w = track.attitude.T
    return replace(track, attitude=np.stack([w, z, -y, -x], axis=1))


def only_positions_turned(track: PoseTrack) -> PoseTrack:
    return replace(turned_up(track, [0, 2, 1], [1.0, 1.0, -1.0]), attitude=track.attitude)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda track: replace(track, position=1000.0 * track.position), ("millimetres?",)),
        (drifting, ("fall behind arrival by 35 ms over 40 s (8", "drift")),
        (lambda track: restamped(track, 101, 100), ("stamps go backwards once, by 0.0",)),
        (lambda track: restamped(track, 99), ("1 of 1198 stamps are those of the pose before",)),
        (
            lambda track: part(track, np.r_[0:500, 530:1198]),
            ("1 gap of more than 0.25 s", "1.03 s after 16.6 s"),
        ),
        (frozen, ("stands still to the last bit once, for up to 19 poses",)),
        (lambda track: turned_up(track, [2, 0, 1], [1.0, 1.0, 1.0]), ("axis x looks like up",)),
        (only_positions_turned, ("axis y looks like up", "tilt does not agree")),
        (rolled_over, ("base_link z points down",)),
    ],
)
def test_a_mistake_is_one_finding(flight, change, words):
    found = only(change(flight))
    for word in words:
        assert word in found


@pytest.mark.parametrize("tilt_rad", [0.0, 0.1])
@pytest.mark.parametrize("length_s", [3.0, 20.0])
def test_a_body_that_is_carried_about_tells_no_axis(length_s, tilt_rad):
    t = np.arange(0.0, length_s, 0.02)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        away = 1.0 - np.cos(2.0 * np.pi * t / length_s)
        position = away[:, None] * [1.0, 0.5, 0.1] + [0.0, 0.0, 1.0]
        rate, phase = rng.uniform(1.0, 4.0, 3), rng.uniform(0.0, 6.3, 3)
        turn = [tilt_rad, tilt_rad, 0.3] * np.sin(rate * t[:, None] + phase)
        attitude = Rotation.from_rotvec(turn).as_quat()
        assert find_up_axis(t, position, attitude) == []

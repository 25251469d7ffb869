"""Frames, clocks, axes: what is wrong with a recording's poses is said in one line each."""

from dataclasses import replace

import numpy as np
import pytest

from tombo_flight.replay.prechecks import check_poses
from tombo_flight.replay.recorded import PoseTrack


def part(track: PoseTrack, rows: slice | np.ndarray) -> PoseTrack:
    return PoseTrack(*(column[rows] for column in vars(track).values()))


def only(track: PoseTrack) -> str:
    findings = check_poses(track, 0.25)
    assert len(findings) == 1, findings
    assert "\n" not in findings[0]
    return findings[0]


def test_a_sound_flight_gives_no_finding(flight):
    assert check_poses(flight, 0.25) == []


@pytest.mark.parametrize("bag", ["aggressive_2", "no_obstacle_1", "soft_strike_3"])
def test_no_axis_or_clock_is_suspected_in_sound_flights(poses, bag):
    findings = check_poses(poses(bag), 0.25)
    assert all("gap" in finding for finding in findings), findings


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


def test_millimetres(flight):
    assert "millimetres?" in only(replace(flight, position=1000.0 * flight.position))


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


def test_clocks_that_drift(flight):
    since = flight.stamp_ns - flight.stamp_ns[0]
    found = only(replace(flight, stamp_ns=flight.stamp_ns - (since * 1e-3).astype(np.int64)))
    assert "fall behind arrival by 35 ms over 40 s (8" in found
    assert "drift" in found


def test_a_clock_that_is_set_in_flight(flight):
    stamps = flight.stamp_ns.copy()
    stamps[600:] += 400_000_000
    findings = check_poses(replace(flight, stamp_ns=stamps), 0.25)
    assert any("jumps once, by 400 ms" in finding for finding in findings), findings
    assert not any("drift" in finding for finding in findings)


def test_stamps_that_go_backwards_or_repeat(flight):
    stamps = flight.stamp_ns.copy()
    stamps[100], stamps[101] = stamps[101], stamps[100]
    assert "stamps go backwards once, by 0.0" in only(replace(flight, stamp_ns=stamps))
    stamps = flight.stamp_ns.copy()
    stamps[100] = stamps[99]
    assert "1 of 1198 stamps are those of the pose before" in only(
        replace(flight, stamp_ns=stamps)
    )


def test_stamps_of_zero(flight):
    unstamped = replace(flight, stamp_ns=np.zeros_like(flight.stamp_ns))
    assert "1198 of 1198 stamps are zero (--stamp-on-arrival" in only(unstamped)
    assert check_poses(unstamped.with_arrival_stamps(), 0.25) == []


def test_a_gap(flight):
    track = part(flight, np.r_[0:500, 530:1198])
    assert "1 gap of more than 0.25 s" in only(track)
    assert "1.03 s after 16.6 s" in only(track)


def test_a_pose_that_freezes_in_flight(flight):
    position, attitude = flight.position.copy(), flight.attitude.copy()
    position[400:420], attitude[400:420] = position[400], attitude[400]
    assert "stands still to the last bit once, for up to 19 poses" in only(
        replace(flight, position=position, attitude=attitude)
    )


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


def test_x_up(flight):
    assert "axis x looks like up" in only(turned_up(flight, [2, 0, 1], [1.0, 1.0, 1.0]))


def test_positions_turned_up_but_attitudes_not(flight):
    mixed = replace(turned_up(flight, [0, 2, 1], [1.0, 1.0, -1.0]), attitude=flight.attitude)
    assert "axis y looks like up" in only(mixed)
    assert "tilt does not agree" in only(mixed)


def test_a_body_whose_z_points_down(flight):
    x, y, z, w = flight.attitude.T
    rolled_over = np.stack([w, z, -y, -x], axis=1)
    assert "base_link z points down" in only(replace(flight, attitude=rolled_over))

"""Poses of any system become poses of base_link in map, stamped with their capture."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tombo_dynamics.errors import InputError
from tombo_mocap.params import MocapParams
from tombo_mocap.tracked_poses import TrackedBody, TrackedPoses

_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
_AT = np.array([1.0, 2.0, 3.0])
_MAP_FROM_Y_UP = Rotation.from_euler("x", 90.0, degrees=True)
_YAW_OF_NOSE_DEG = {"+x": 0.0, "+y": 90.0, "-x": 180.0, "-y": -90.0}


def body(stamp_ns=1_000_000_000, position=_AT, attitude=_LEVEL, name="tombo"):
    return TrackedBody(name, stamp_ns, np.array(position), np.array(attitude))


def only_pose(bodies, **params):
    (pose,) = TrackedPoses(MocapParams(**params)).poses(bodies)
    return pose


def test_a_system_with_z_up_is_map_already():
    pose = only_pose([body()])
    assert pose.frame_id == "map"
    assert pose.stamp_ns == 1_000_000_000
    np.testing.assert_allclose(pose.position, _AT)
    np.testing.assert_allclose(pose.attitude, _LEVEL)


@pytest.mark.parametrize("nose", _YAW_OF_NOSE_DEG)
@pytest.mark.parametrize("up", ["z_up", "y_up"])
def test_axes_of_world_and_body_are_turned(up, nose):
    """A vehicle with a known attitude, seen by a system with these axes, is seen as it is."""
    truth = Rotation.from_euler("ZYX", [40.0, 20.0, -10.0], degrees=True)
    place = np.array([0.5, -1.0, 2.0])
    map_from_world = _MAP_FROM_Y_UP if up == "y_up" else Rotation.identity()
    # the rigid body was defined level, its chosen axis to the nose
    turned = truth * Rotation.from_euler("z", -_YAW_OF_NOSE_DEG[nose], degrees=True)
    seen = map_from_world.inv() * turned * map_from_world
    pose = only_pose(
        [body(position=map_from_world.inv().apply(place), attitude=seen.as_quat())],
        up=up, nose=nose,
    )  # fmt: skip
    np.testing.assert_allclose(pose.position, place, atol=1e-12)
    difference = Rotation.from_quat(pose.attitude) * truth.inv()
    assert difference.magnitude() < 1e-9


def test_the_stamp_is_the_capture_not_the_arrival():
    assert only_pose([body(stamp_ns=2_000_000_000)], delay=0.008).stamp_ns == 1_992_000_000


def test_the_named_body_is_taken_among_others():
    bodies = [body(name="wand", position=[9.0, 9.0, 9.0]), body()]
    np.testing.assert_allclose(only_pose(bodies, body="tombo").position, _AT)


def test_several_bodies_without_a_name_are_not_guessed():
    poses = TrackedPoses(MocapParams())
    assert poses.poses([body(name="wand"), body()]) == []
    assert poses.names == {"wand", "tombo"}


@pytest.mark.parametrize(
    ("wrong", "counter"),
    [
        ({"position": [np.nan, 0.0, 0.0]}, "not_finite"),
        ({"attitude": [0.0, 0.0, 0.0, 0.0]}, "not_finite"),
        ({"attitude": [np.nan, 0.0, 0.0, 1.0]}, "not_finite"),
        ({"stamp_ns": 1_000_000_000}, "not_newer"),
        ({"stamp_ns": 999_999_999}, "not_newer"),
    ],
)
def test_what_is_no_new_pose_is_counted_and_dropped(wrong, counter):
    poses = TrackedPoses(MocapParams())
    assert len(poses.poses([body()])) == 1
    assert poses.poses([body(**{"stamp_ns": 2_000_000_000} | wrong)]) == []
    assert getattr(poses.counters, counter) == 1
    assert len(poses.poses([body(stamp_ns=3_000_000_000)])) == 1


@pytest.mark.parametrize(
    ("params", "named"),
    [
        ({"system": "kinect"}, "mocap.system"),
        ({"system": "mock", "up": "x"}, "mocap.up"),
        ({"system": "mock", "nose": "z"}, "mocap.nose"),
        ({"system": "mock", "delay": 1.0}, "mocap.delay"),
        ({"system": "vicon"}, "mocap.host"),
        ({"system": "ros"}, "mocap.topic"),
    ],
)
def test_bad_parameters_are_named(params, named):
    with pytest.raises(InputError, match=named):
        MocapParams(**params).check()

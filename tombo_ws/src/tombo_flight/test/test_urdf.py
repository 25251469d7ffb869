"""The URDF of a vehicle, read as robot_state_publisher would."""

from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tombo_dynamics.vehicle import ROTOR_NAMES, SPIN
from tombo_flight.urdf import vehicle_urdf
from tombo_flight.vehicle_file import read_vehicle


def numbers(element, key):
    return np.array([float(word) for word in element.get(key).split()])


def tip(robot, blade, fold, length):
    """Place of a blade's tip (3) in base_link, with its joint at an angle, by the joints above."""
    point, child, angle = np.array([length, 0.0, 0.0]), blade, fold
    joints = {joint.find("child").get("link"): joint for joint in robot.iter("joint")}
    while child != "base_link":
        joint = joints[child]
        origin, axis = joint.find("origin"), joint.find("axis")
        if axis is not None:
            point = Rotation.from_rotvec(angle * numbers(axis, "xyz")).apply(point)
        turned = Rotation.from_euler("xyz", numbers(origin, "rpy")).apply(point)
        point, angle = turned + numbers(origin, "xyz"), 0.0
        child = joint.find("parent").get("link")
    return point


@pytest.mark.parametrize("name", ["tombo_s500", "px4_x500"])
def test_joints_make_one_tree_and_its_mass_is_the_vehicle(name):
    vehicle = read_vehicle(name)
    robot = ElementTree.fromstring(vehicle_urdf(vehicle))
    links = [link.get("name") for link in robot.iter("link")]
    children = [joint.find("child").get("link") for joint in robot.iter("joint")]
    parents = {joint.find("parent").get("link") for joint in robot.iter("joint")}
    assert len(set(links)) == len(links) == 13
    assert sorted([*children, "base_link"]) == sorted(links) and parents <= set(links)
    assert float(robot.find("link/inertial/mass").get("value")) == vehicle.vehicle.mass
    kinds = {joint.get("type") for joint in robot.iter("joint")}
    assert kinds == {"continuous", "revolute" if name == "tombo_s500" else "fixed"}


@pytest.mark.parametrize("rotor", range(4))
def test_a_straight_blade_reaches_the_tip_and_a_folded_one_lies_back(rotor):
    vehicle = read_vehicle("tombo_s500").vehicle
    robot = ElementTree.fromstring(vehicle_urdf(read_vehicle("tombo_s500")))
    hub, length = vehicle.rotor_positions()[rotor], vehicle.rotor_radius - vehicle.nodus_radius
    for number, outward in ((0, 1.0), (1, -1.0)):
        blade = f"{ROTOR_NAMES[rotor]}_fold_{number}"
        straight = tip(robot, blade, 0.0, length) - hub
        assert straight == pytest.approx([outward * vehicle.rotor_radius, 0.0, 0.0], abs=1e-5)
        (limit,) = robot.findall(f"joint[@name='{blade}']/limit")
        folded = tip(robot, blade, float(limit.get("upper")), length) - hub
        forward = np.cross([0.0, 0.0, SPIN[rotor]], straight)  # the blade's velocity
        assert folded @ straight == pytest.approx(
            vehicle.nodus_radius * vehicle.rotor_radius, 1e-3
        )
        assert folded @ forward == pytest.approx(-length * vehicle.rotor_radius, 1e-3)

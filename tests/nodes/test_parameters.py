"""Parameters given to the nodes that fly: refused ones end the node with a line that says why."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")


@pytest.mark.parametrize(
    ("module", "parameter", "named"),
    [
        ("tombo_sim.sim_node", "vehicle.mass:=-1.0", "vehicle.mass: -1.0 is out of bounds"),
        ("tombo_sim.sim_node", "effects.imu_noise.gyro:=-1.0", "effects.imu_noise.gyro"),
        ("tombo_control.estimator_node", "estimator.jump_min:=wide", "estimator.jump_min"),
        ("tombo_control.controller_node", "propeller.law:=newest", "newest"),
    ],
)
def test_a_refused_parameter_ends_the_node_with_one_line(start, module, parameter, named):
    node = start(module, "-p", parameter)
    assert node.process.wait(120.0) == 2, node.output
    (line,) = node.output.strip().splitlines()
    assert line.startswith("Error: ")
    assert named in line

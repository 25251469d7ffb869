"""The ways of the AUTO modes, followed by a vehicle that does exactly what it is told."""

import numpy as np
import pytest
from vehicle_bench import table_with

from tombo_px4.autopilot.navigator import Navigator
from tombo_px4.modes import AUTO_HOLD, AUTO_LAND, AUTO_RTL, AUTO_TAKEOFF, Mode

HOME = np.array([0.5, -0.5, 0.2])


class Follower:
    def __init__(self, position, **parameters: float) -> None:
        self.navigator = Navigator(table_with(**parameters))
        self.position = np.array(position, dtype=float)
        self.velocity = np.zeros(3)
        self.time_s = 100.0
        self.yaw = 0.7

    def fly(self, mode: Mode, seconds: float) -> np.ndarray:
        rows = []
        for _ in range(round(seconds * 50)):
            wanted = self.navigator.follow(
                mode, self.time_s, self.position, self.velocity, self.yaw, HOME
            )
            if self.position[2] > 0.2 or wanted.position[2] > 0.2:
                self.position, self.velocity = wanted.position.copy(), wanted.velocity.copy()
            self.yaw = wanted.yaw
            self.time_s += 0.02
            rows.append(np.concatenate([self.position, self.velocity, wanted.acceleration]))
        return np.array(rows)


def test_take_off_rises_above_home_and_is_finished_there():
    follower = Follower(HOME, MIS_TAKEOFF_ALT=3.0, MPC_TKO_SPEED=0.8)
    rows = follower.fly(AUTO_TAKEOFF, 3.0)
    assert not follower.navigator.finished
    rows = np.vstack([rows, follower.fly(AUTO_TAKEOFF, 3.0)])
    assert follower.navigator.finished
    assert follower.position == pytest.approx([*HOME[:2], HOME[2] + 3.0])
    assert rows[:, 5].max() == pytest.approx(0.8) and follower.yaw == 0.7


def test_going_to_a_place_in_hold():
    follower = Follower([1.0, 2.0, 3.0], MPC_XY_CRUISE=2.0)
    follower.fly(AUTO_HOLD, 1.0)
    follower.navigator.go_to(np.array([5.0, 2.0, 4.0]), 1.5)
    rows = follower.fly(AUTO_HOLD, 8.0)
    assert follower.position == pytest.approx([5.0, 2.0, 4.0]) and follower.yaw == 1.5
    assert np.linalg.norm(rows[:, 3:6], axis=1).max() < 2.0 + 1e-9
    follower.navigator.leave()  # a new hold does not go there again
    follower.position = np.array([0.0, 0.0, 3.0])
    assert follower.fly(AUTO_HOLD, 1.0)[-1, 0] == pytest.approx(0.0)


def test_land_goes_straight_down_at_its_speed_and_below_the_ground():
    follower = Follower([1.0, 2.0, 5.0], MPC_LAND_SPEED=0.5)
    rows = follower.fly(AUTO_LAND, 20.0)
    assert (rows[:, :2] == [1.0, 2.0]).all()
    assert rows[:, 5].min() == pytest.approx(-0.5)
    wanted = follower.navigator.follow(
        AUTO_LAND, follower.time_s, follower.position, np.zeros(3), 0.0, HOME
    )
    assert wanted.position[2] < -2.0 and follower.navigator.landing


def test_return_climbs_goes_home_and_lands():
    follower = Follower([6.0, 4.0, 2.2], RTL_RETURN_ALT=4.0, NAV_ACC_RAD=0.3)
    rows = follower.fly(AUTO_RTL, 40.0)
    top = rows[:, 2].max()
    assert top == pytest.approx(HOME[2] + 4.0)
    on_the_way = (np.linalg.norm(rows[:, :2] - [6, 4], axis=1) > 0.01) & (
        np.linalg.norm(rows[:, :2] - HOME[:2], axis=1) > 0.4
    )
    assert (rows[on_the_way, 2] > top - 0.01).all()  # nothing sideways below the return height
    assert rows[-1, :2] == pytest.approx(HOME[:2]) and rows[-1, 2] < HOME[2] + 0.1


def test_references_are_smooth():
    """Position is the integral of velocity, velocity that of acceleration."""
    follower = Follower([6.0, 4.0, 2.2])
    rows = follower.fly(AUTO_RTL, 30.0)
    rows = rows[rows[:, 2] > HOME[2] + 0.1]
    steps = np.diff(rows[:, :3], axis=0) - 0.01 * (rows[1:, 3:6] + rows[:-1, 3:6])
    assert np.abs(steps).max() < 2e-3
    assert np.abs(np.diff(rows[:, 3:6], axis=0)).max() < 0.03 and np.isfinite(rows).all()

"""Wind in logs: a made-up vehicle that holds its course by leaning against a horizontal force."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Airframe, Flight, Series
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks import check_log

DRAG, STEP = 0.35, 0.01


def flight(steady=(0.0, 0.0), lean=0.0, offset=0.0):
    """Figures of 1 m, flown exactly: the lean is what the motion and the push [m/s^2] ask for.

    `lean` [rad]: of the body as it was defined; `offset` [m/s^2]: of the accelerometer along x.
    """
    t = np.arange(0.0, 30.0, STEP)
    rates = np.array([0.9, 1.3])
    place, speed = np.sin(np.outer(t, rates)), rates * np.cos(np.outer(t, rates))
    up = np.full((t.size, 1), GRAVITY)
    thrust = np.hstack([-(rates**2) * place + DRAG * speed - np.array(steady), up])
    heading = Rotation.from_euler("z", 0.3 + 0.5 * np.sin(0.2 * t))
    ahead, left, lift = heading.inv().apply(thrust).T
    pitch, roll = np.arctan2(ahead, lift), np.arctan2(-left, np.hypot(ahead, lift))
    body = heading * Rotation.from_euler("YX", np.column_stack([pitch, roll]))
    felt = body.inv().apply(np.hstack([-(rates**2) * place, up]))
    felt[:, 0] += offset
    turned = (body[:-1].inv() * body[1:]).as_rotvec() / STEP
    gyro = np.vstack([turned, turned[-1:]])
    rng = np.random.default_rng(1)
    values = {
        "position": (np.hstack([place, np.full((t.size, 1), 1.5)]), 0.0003),
        "attitude": ((body * Rotation.from_euler("y", lean)).as_quat(), 0.0005),
        "accel": (felt, 0.05),
        "gyro": (gyro, 0.005),
    }
    noisy = {n: Series(t, v + s * rng.standard_normal(v.shape)) for n, (v, s) in values.items()}
    log = Flight.measured("windy", "", noisy)
    return replace(log, airframe=Airframe("unknown", 2.0, 0.2, 0.1))


def wind_text(log):
    """Findings on wind."""
    return " ".join(f.message for f in check_log(log).findings if f.check == "wind")


def test_steady_wind_is_told_with_its_force_and_by_drag_its_speed():
    text = wind_text(flight(steady=(1.2, -1.6)))
    size, spread = (float(x) for x in text.split("own drag, ")[1].split(" N ")[0].split(" ± "))
    assert abs(size - 4.0) < spread < 1.5  # 2 kg by 2 m/s^2
    assert "towards 307 deg" in text
    assert float(text.split("air of ")[1].split(" m/s")[0]) == pytest.approx(2.0 / DRAG, rel=0.1)


def test_the_speed_is_not_told_where_drag_is_not_known():
    """A hover shows the force alone."""
    log, rng = flight(), np.random.default_rng(2)
    t = log.series["position"].t
    body = Rotation.from_euler("y", -np.arctan2(2.0, GRAVITY))
    values = {
        "position": np.tile([0.0, 0.0, 1.5], (t.size, 1)),
        "attitude": np.tile(body.as_quat(), (t.size, 1)),
        "accel": np.tile(body.inv().apply([0.0, 0.0, GRAVITY]), (t.size, 1)),
    }
    noisy = {n: Series(t, v + 5e-4 * rng.standard_normal(v.shape)) for n, v in values.items()}
    text = wind_text(log.with_series(noisy))
    assert "not known without the drag coefficient" in text and "towards 0 deg" in text


@pytest.mark.parametrize(
    "fault", [{}, {"lean": np.radians(4.0)}, {"offset": 0.8}, {"steady": (0.15, 0.1)}]
)
def test_no_wind_is_told_of_a_leaning_body_an_offset_or_a_breath(fault):
    assert not wind_text(flight(**fault))

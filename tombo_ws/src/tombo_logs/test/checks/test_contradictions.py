"""Wrong units, frames and orders are said with the channel's name, and never used."""

import numpy as np
import pytest
from made_flight import CLIMB, STAND, made_flight, poses_only, smooth_step, with_values, wrote
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Series
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotation import unwrap_quaternions
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks import check_log
from tombo_px4.frames import ned_from_enu, px4_quaternion

FLIGHT = made_flight()
IMU = {"gyro", "accel"}
FRD = np.array([1.0, -1.0, -1.0])


def euler(degrees_in, degrees_out):
    def change(q):
        angles = Rotation.from_quat(q).as_euler("ZYX", degrees=degrees_in)
        return Rotation.from_euler("ZYX", angles, degrees=degrees_out).as_quat()

    return change


def with_turn(*angles):
    def change(q):
        return (Rotation.from_quat(q) * Rotation.from_euler("xyz", angles, degrees=True)).as_quat()

    return change


def ned(log):
    places = with_values(log, "position", ned_from_enu)
    return with_values(
        places, "attitude", lambda q: unwrap_quaternions(px4_quaternion(q)[:, [1, 2, 3, 0]])
    )


@pytest.mark.parametrize(
    ("channel", "change", "check", "texts"),
    [
        ("gyro", lambda w: np.degrees(w), "unit", ("degrees declared as radians", "57.")),
        ("gyro", lambda w: np.radians(w), "unit", ("radians declared as degrees",)),
        ("accel", lambda a: a / GRAVITY, "unit", ("g declared as m/s^2", "about 9.81")),
        ("accel", lambda a: a * GRAVITY, "unit", ("m/s^2 declared as g",)),
        ("accel", lambda a: a - [0, 0, GRAVITY], "unit", ("gravity taken out",)),
        ("accel", lambda a: a * FRD, "frame", ("its -z is up", "FRD")),
        ("accel", lambda a: a[:, [0, 2, 1]], "frame", ("its y is up",)),
        ("gyro", lambda w: w * [1, -1, 1], "frame", ("mirrored", "[x, -y, z]")),
        ("gyro", lambda w: w[:, [1, 0, 2]], "frame", ("mirrored", "[y, x, z]")),
        ("gyro", lambda w: w[:, [1, 0, 2]] * [-1, 1, 1], "frame", ("90", "[y, -x, z]")),
    ],
)
def test_an_imu_that_contradicts_the_poses_is_left_out(channel, change, check, texts):
    checked = check_log(with_values(FLIGHT, channel, change))
    assert not IMU & set(checked.series)
    faults = [f for f in wrote(checked, *texts) if f.severity == "fault"]
    assert [(f.check, f.channel) for f in faults] == [(check, channel)]


def test_a_turned_rigid_body_is_a_fault_with_its_correction():
    off = with_values(FLIGHT, "attitude", with_turn(4.0, -3.0, 35.0))
    checked = check_log(off)
    (fault,) = [f for f in checked.findings if f.severity == "fault"]
    assert (fault.check, fault.channel) == ("frame", "attitude")
    assert not IMU & set(checked.series)
    text = fault.message.partition("turn_deg: [")[2].partition("]")[0]
    angles = [float(x) for x in text.split(",")]
    back = check_log(with_values(off, "attitude", with_turn(*angles)))
    assert set(back.series) == set(FLIGHT.series)
    assert not [f for f in back.findings if f.check == "frame"]


@pytest.mark.parametrize(("yaw", "severity"), [(3.0, "info"), (8.0, "warning")])
def test_a_slightly_turned_one_is_left_to_the_diagnosis(yaw, severity):
    checked = check_log(with_values(FLIGHT, "attitude", with_turn(0.0, 0.0, yaw)))
    assert set(checked.series) == set(FLIGHT.series)
    (note,) = [f for f in checked.findings if f.check == "frame"]
    assert note.severity == severity and f"yaw {yaw}" in note.message


@pytest.mark.parametrize("only_poses", [False, True])
@pytest.mark.parametrize(
    ("channel", "change", "complaint"),
    [
        ("position", lambda p: 1000.0 * p, "position.*mm declared as m"),
        ("position", lambda p: 0.001 * p, "position.*m declared as mm"),
        ("position", lambda p: p * [1, -1, 1], "position.*mirrored"),
        ("position", lambda p: p[:, [1, 0, 2]], "position.*mirrored"),
        ("attitude", lambda q: q[:, [3, 0, 1, 2]], "attitude.*wxyz read as xyzw"),
        ("attitude", lambda q: q * [-1, -1, -1, 1], "map from base_link"),
        ("attitude", lambda q: 3.0 * q, "attitude.*norm 3"),
        ("attitude", euler(True, False), "attitude.*degrees declared as radians"),
        ("attitude", euler(False, True), "attitude.*radians declared as degrees"),
        ("attitude", with_turn(180.0, 0.0, 0.0), "attitude: body z points along"),
        ("position", lambda p: 0.0 * p, "position: one value throughout"),
    ],
)
def test_poses_that_contradict_themselves_are_refused(channel, change, complaint, only_poses):
    off = with_values(FLIGHT, channel, change)
    with pytest.raises(InputError, match=complaint) as error:
        check_log(poses_only(off) if only_poses else off)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "change", [lambda p: p[:, [1, 0, 2]] * [-1, 1, 1], lambda p: p[:, [0, 2, 1]] * [1, 1, -1]]
)
def test_a_turned_track_is_told_by_the_accelerometer(change):
    """Yaw by 90 deg, and y up, of the position alone."""
    with pytest.raises(InputError, match="position: it moves 90 deg off"):
        check_log(with_values(FLIGHT, "position", change))


@pytest.mark.parametrize(
    ("width", "channels"),
    [
        (1.0, set(FLIGHT.series)),
        (1.0, {"position", "attitude"}),
        (0.02, set(FLIGHT.series)),
        (0.02, {"position", "attitude", "rotor_command"}),
    ],
)
def test_ned_for_enu_is_refused_also_in_hover(width, channels):
    """By the lean, or the height at which the motors are slow."""
    off = ned(made_flight(width=width))
    with pytest.raises(InputError, match="as in ENU"):
        check_log(off.with_series({name: off.series[name] for name in channels}))


def with_descent(log):
    """A flight from its hover on, which then goes 0.6 m lower; motors hold it."""
    drop = 0.6 * smooth_step(np.arange(0.0, 40.0, 0.01) - 2.0)
    series = {}
    for name, s in log.series.items():
        keep = (s.t > STAND + CLIMB - 0.1) & (s.t < s.t[-1] - STAND - CLIMB)
        series[name] = Series(s.t[keep] - s.t[keep][0], s.values[keep])
    position = series["position"]
    down = np.column_stack([0.0 * position.t, 0.0 * position.t, drop[: position.t.size]])
    series["position"] = Series(position.t, position.values - down)
    return log.with_series(series)


@pytest.mark.parametrize("only_poses", [False, True])
def test_a_flight_that_begins_in_a_steady_hover_and_goes_lower_is_none(only_poses):
    flight = with_descent(made_flight(width=0.3))
    z = flight.series["position"].values[:, 2]
    assert np.ptp(z[:60]) < 0.004 and np.median(z) < z[0] - 0.3
    checked = check_log(poses_only(flight) if only_poses else flight)
    assert not [f for f in checked.findings if f.severity == "fault"]


def test_effects_of_the_registry_are_no_contradictions():
    """Sizes that the diagnosis has to name: bias, scale, lever arm, marker offset, tilt."""
    flight = with_values(FLIGHT, "accel", lambda a: 1.1 * a + [0.9, -0.9, 0.5])
    flight = with_values(flight, "gyro", lambda w: w + np.array([0.2, -0.1, 0.1]))
    flight = with_values(flight, "attitude", with_turn(3.0, -3.0, 10.0))
    flight = with_values(flight, "position", lambda p: p + np.array([0.0, 0.0, 0.1]))
    checked = check_log(flight)
    assert set(checked.series) == set(FLIGHT.series)
    said = {(f.check, f.severity, f.channel) for f in checked.findings if f.severity != "info"}
    imu = {("offset", "warning", channel) for channel in ("gyro", "accel")}
    assert said == {*imu, ("frame", "warning", "attitude")}

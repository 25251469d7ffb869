import numpy as np
import pytest

from tombo_bag.flight import Flight, Series, Topic
from tombo_bag.topics import BATTERY, IMU, MOCAP_POSE, SETPOINT
from tombo_diagnosis.report.log_page import MOST_LOGS, log_figures, log_page
from tombo_dynamics.errors import InputError
from tombo_flight.report.page import Picture, page_html

NOT_JUDGED = InputError("too short")


def log_of(name="a", offset_m=0.3, **more):
    """20 s at 100 Hz: 0.3 m from a set point that steps at 10 s."""
    t = np.arange(0.0, 20.0, 0.01)
    wanted_t = np.array([0.0, 10.0])
    wanted = np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0]])
    position = wanted[(t >= 10.0).astype(int)] + np.array([0.0, offset_m, 0.0])
    attitude = np.tile((0.0, 0.0, 0.0, 1.0), (len(t), 1))
    pose = Topic.of(t, {"position": position, "attitude": attitude}, t + 0.02)
    setpoint = Topic.of(wanted_t, {"position": wanted})
    return Flight({MOCAP_POSE.name: pose, SETPOINT.name: setpoint, **more}, name)


def imu(hz, amplitude):
    t = np.arange(0.0, 20.0, 0.002)
    accel = np.zeros((len(t), 3))
    accel[:, 2] = 9.81 + amplitude * np.sin(2 * np.pi * hz * t)
    return Topic.of(t, {"gyro": np.zeros((len(t), 3)), "accel": accel})


def test_the_error_of_position_is_that_beside_the_set_point_that_held():
    assert log_figures(log_of())["error of position, RMS [m]"] == pytest.approx(0.3)


def test_latency_and_gaps_of_the_motion_capture():
    figures = log_figures(log_of())
    assert figures["poses [Hz]"] == pytest.approx(100.0)
    assert figures["latency of poses, median [ms]"] == pytest.approx(20.0)
    assert figures["gaps between poses"] == 0
    flight = log_of()
    pose = flight.topics[MOCAP_POSE.name]
    keep = (pose.t < 5.0) | (pose.t > 5.5)
    holed = Topic.of(pose.t[keep], {n: s.values[keep] for n, s in pose.items()})
    figures = log_figures(Flight({MOCAP_POSE.name: holed}, "holed"))
    assert figures["gaps between poses"] == 1
    assert figures["longest gap [ms]"] == pytest.approx(520.0, abs=11.0)


def test_stamps_later_than_arrival_tell_no_latency():
    pose = log_of().topics[MOCAP_POSE.name]
    ahead = Topic.of(pose.t, {n: s.values for n, s in pose.items()}, pose.t - 0.589)
    figures = log_figures(Flight({MOCAP_POSE.name: ahead}, "ahead"))
    assert figures["latency of poses, median [ms]"] is None
    assert figures["latency of poses, 95 % [ms]"] is None


@pytest.mark.parametrize(("hz", "expected"), [(80.0, 2.0 / np.sqrt(2.0)), (10.0, 0.0)])
def test_vibration_is_what_shakes_above_30_hz(hz, expected):
    figures = log_figures(log_of(**{IMU.name: imu(hz, 2.0)}))
    assert figures["vibration, RMS above 30 Hz [m/s²]"] == pytest.approx(expected, abs=0.05)


def test_motors_at_their_limit():
    t = np.arange(0.0, 10.0, 0.01)
    command = np.full((len(t), 4), 0.6)
    command[t < 2.5, 3] = 1.0
    flight = log_of()
    series = {**flight.series, "motor_command": Series(t, command)}
    figures = log_figures(flight.with_series(series))
    assert figures["time of a motor at its limit [%]"] == pytest.approx(25.0)


def test_six_logs_stand_on_one_page_and_seven_do_not():
    logs = [log_of(str(k)) for k in range(MOST_LOGS + 1)]
    page = log_page(logs[:MOST_LOGS], [NOT_JUDGED] * MOST_LOGS)
    assert [log["log"] for log in page.data["logs"]] == list("012345")
    for count in (0, MOST_LOGS + 1):
        with pytest.raises(InputError, match=f"{count} logs; accepted: 1 to 6"):
            log_page(logs[:count], [NOT_JUDGED] * count)


@pytest.mark.slow
def test_every_picture_of_a_log_with_little_in_it_is_drawn():
    page = log_page([log_of(), log_of("b", **{IMU.name: imu(50.0, 1.0)})], [NOT_JUDGED] * 2)
    pictures = [item for s in page.sections for item in s.items if isinstance(item, Picture)]
    assert [picture.name for picture in pictures] == ["Position", "Attitude", "Body rates",
                                                      "Spectra"]  # fmt: skip
    assert page_html(page).count("<img") == len(pictures)


def damaged(stamps, values):
    """600 samples of every quantity with figures."""
    t = np.asarray(stamps(np.arange(600)), dtype=float)
    rows = np.asarray(values(np.random.default_rng(3).standard_normal((600, 4))))
    return Flight({
        MOCAP_POSE.name: Topic.of(t, {"position": rows[:, :3], "attitude": rows}, t + 0.01),
        SETPOINT.name: Topic.of(t, {"position": rows[:, :3]}),
        IMU.name: Topic.of(t, {"gyro": rows[:, :3], "accel": rows[:, 1:]}),
        BATTERY.name: Topic.of(t, {"voltage": rows[:, :1]}),
        "/motor_command": Topic.of(t, {"command": rows}),
    }, "damaged")  # fmt: skip


def even(k):
    return 0.005 * k


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("stamps", "values"),
    [
        (lambda k: 0.0 * k, lambda x: x),
        (lambda k: 0.01 * (k // 3), lambda x: x),
        (lambda k: even(k) + 3e6 * (k > 300), lambda x: x),
        (even, lambda x: np.nan * x),
        (even, lambda x: np.where(x > 1.0, np.inf, x)),
    ],
    ids=["frozen", "repeated", "gap", "nan", "inf"],
)
def test_figures_of_damaged_logs_are_finite_or_left_out_without_a_warning(stamps, values):
    page = log_page([damaged(stamps, values)], [NOT_JUDGED])
    page_html(page)
    for name, figure in page.data["logs"][0]["figures"].items():
        assert figure is None or np.isfinite(figure), name
    rates = page.data["logs"][0]["figures"]["poses [Hz]"]
    assert rates is None or rates > 0.0

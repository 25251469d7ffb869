"""The second simulator: textbook physics, the documented vehicle, logs that are read as flown."""

from math import sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tombo_bag.schemas import own_definitions
from tombo_benchmarks.diagnosis.foreign_cases import candidates, draw_case, make_case
from tombo_benchmarks.diagnosis.foreign_evaluation import answer_row
from tombo_benchmarks.diagnosis.second_simulator.airframe import Airframe
from tombo_benchmarks.diagnosis.second_simulator.flight import Flown
from tombo_benchmarks.diagnosis.second_simulator.hidden import TYPICAL, Hidden, typical
from tombo_benchmarks.diagnosis.second_simulator.log_files import (
    FORMATS,
    mapping_text,
    vehicle_text,
    write_bag,
    write_table,
)
from tombo_benchmarks.diagnosis.second_simulator.sensors import Stream, measure
from tombo_benchmarks.diagnosis.second_simulator.strangers import Stranger
from tombo_benchmarks.diagnosis.second_simulator.vehicles import (
    CRAZYFLIE,
    GRAVITY,
    PLACES,
    ROTORS,
    S500,
    SPINS,
    X500,
)
from tombo_diagnosis.flight.nominal import nominal_model, parameters, tolerances_of
from tombo_dynamics.rotor_maps import rotor_thrust, rotor_torque
from tombo_dynamics.vehicle import ARM_X, ARM_Y, ROTOR_NAMES, SPIN
from tombo_flight.vehicle_file import vehicle_from_text
from tombo_logs.readers.log_reader import read_logs

STILL = [0.0, 0.0, 0.0]


def moved(frame, state, target, seconds, step=0.004):
    for k in range(round(seconds / step)):
        state = frame.step(state, target, STILL, k * step, step)
    return state


# Truth of the numbers: those of the suite's own records.


def test_the_s500_is_the_documented_one():
    known = nominal_model()
    v, effects = known.vehicle, known.effects
    assert (S500.mass, S500.arm, S500.lag) == (v.mass, v.arm_length, v.motor_time_constant)
    assert S500.inertia == (v.inertia_xx, v.inertia_yy, v.inertia_zz)
    assert (S500.rotor_height, S500.rotor_radius) == (v.rotor_height, v.rotor_radius)
    assert (S500.rotor_inertia, S500.battery) == (v.rotor_inertia, v.battery_voltage)
    assert S500.speeds == (v.rotor_speed_min, v.rotor_speed_max)
    assert S500.drag == tuple(effects["linear_rotor_drag"].values())
    assert S500.ground == effects["ground_effect"]["strength"]
    assert S500.air_motion == effects["gusts"]["deviation"]
    for speed in np.linspace(120.0, 810.0, 40):
        thrust, torque = S500.thrust_and_torque(speed)
        assert thrust == pytest.approx(rotor_thrust(known.maps, speed), rel=5e-4)
        assert torque == pytest.approx(rotor_torque(known.maps, speed), rel=5e-4)
        assert S500.speed_for(thrust) == pytest.approx(speed, rel=1e-4)
    order = [ROTOR_NAMES.index(name) for name in ROTORS]
    np.testing.assert_allclose(PLACES, np.column_stack([ARM_X, ARM_Y])[order])
    np.testing.assert_allclose(SPINS, SPIN[order])


@pytest.mark.parametrize("quad", [S500, CRAZYFLIE, X500], ids=lambda q: q.name)
def test_sizes_are_those_of_the_registry(quad):
    scales = {p.label: p.scale for p in parameters(quad.mass, quad.arm)}
    for name, own in TYPICAL.items():
        for p in own:
            assert typical(name, p, quad) == pytest.approx(scales[f"{name}.{p}"]), (name, p)


@pytest.mark.parametrize("quad", [CRAZYFLIE, X500], ids=lambda q: q.name)
def test_a_vehicle_file_says_what_flies(quad):
    file = vehicle_from_text(vehicle_text(quad), quad.name)
    v = file.vehicle
    assert (v.mass, v.arm_length, v.motor_time_constant) == (quad.mass, quad.arm, quad.lag)
    assert (v.inertia_xx, v.inertia_yy, v.inertia_zz) == quad.inertia
    assert (v.rotor_height, v.rotor_inertia) == (quad.rotor_height, quad.rotor_inertia)
    high = quad.speeds[1]
    speeds = np.linspace(0.3 * high, high, 40)
    own = np.array([quad.thrust_and_torque(n) for n in speeds])
    thrust = [rotor_thrust(file.maps, n) for n in speeds]
    np.testing.assert_allclose(thrust, own[:, 0], rtol=1e-3)
    torque = [rotor_torque(file.maps, n) for n in speeds]
    np.testing.assert_allclose(torque, own[:, 1], rtol=1e-3)
    # A battery at 90 % turns the rotors at 90 % of what is asked.
    share = 0.9
    weak = [quad.thrust_and_torque(share * n)[0] for n in speeds]
    voltage = np.full(40, share * quad.battery)
    asked = np.repeat(quad.throttle(speeds)[:, None], 4, axis=1)
    driven = file.drive.thrust(asked, voltage)
    np.testing.assert_allclose(driven, np.repeat(np.array(weak)[:, None], 4, axis=1), rtol=1e-4)
    assert tolerances_of(file) == pytest.approx({
        "mass_error.fraction": 0.01, "thrust_coefficient_error.fraction": 0.02,
        "inertia_error.xx": 0.05, "inertia_error.yy": 0.05, "inertia_error.zz": 0.05,
    }, rel=1e-4)  # fmt: skip


# Physics.


def test_a_free_spin_keeps_momentum_and_energy():
    """Euler's equations of three different moments of inertia, without any force."""
    frame = Airframe(S500, Hidden({"inertia_error.yy": 0.6}), Stranger())
    state = frame.at_rest([0.0, 0.0, 50.0])
    state[10:13] = [3.0, 0.4, -2.0]
    state[13:17] = [0.0] * 4
    frame.drag = 0.0, 0.0, 0.0

    def momentum_and_energy(s):
        turn = Rotation.from_quat([*s[7:10], s[6]])
        spin = np.array(frame.inertia) * s[10:13]
        return np.append(turn.apply(spin), 0.5 * spin @ s[10:13])

    after = moved(frame, state, [0.0] * 4, 1.5)
    np.testing.assert_allclose(momentum_and_energy(after), momentum_and_energy(state), rtol=1e-6)
    assert after[2] == pytest.approx(50.0 - 0.5 * GRAVITY * 1.5**2, abs=1e-9)
    assert abs(after[11] - state[11]) > 0.5


@pytest.mark.slow
def test_it_hovers_and_terminal_speed_is_force_over_drag():
    frame = Airframe(S500, Hidden({"ground_effect.strength": -1.0}), Stranger())
    hover = [S500.hover_speed] * 4
    after = moved(frame, frame.at_rest([0.0, 0.0, 2.0]), hover, 3.0)
    np.testing.assert_allclose(after[:6], [0.0, 0.0, 2.0, 0.0, 0.0, 0.0], atol=1e-3)
    lean = 0.1
    state = frame.at_rest([0.0, 0.0, 2.0])
    state[6:10] = [np.cos(lean / 2), 0.0, np.sin(lean / 2), 0.0]
    after = moved(frame, state, hover, 120.0, step=0.04)
    force = S500.mass * GRAVITY * np.array([np.sin(lean), np.cos(lean) - 1.0])
    turn = np.array([[np.cos(lean), np.sin(lean)], [-np.sin(lean), np.cos(lean)]])
    drag = turn @ np.diag(S500.drag[:2]) @ turn.T
    np.testing.assert_allclose(after[3:6:2], np.linalg.solve(drag, force), rtol=2e-3)


@pytest.mark.slow
def test_a_hanging_load_swings_as_a_double_pendulum_and_weighs():
    load = Stranger("slung_load", load=0.15, cord=0.7)
    frame = Airframe(S500, Hidden({"ground_effect.strength": -1.0}), load)
    total = (S500.mass + 0.15) * GRAVITY / 4.0
    frame.drag = 0.0, 0.0, 0.0
    state = frame.at_rest([0.0, 0.0, 2.0])
    state[17] += 0.02
    speed = S500.speed_for(total)
    state[13:17] = [speed] * 4
    crossings, before = [], None
    for k in range(1500):
        state = frame.step(state, [speed] * 4, STILL, 0.0, 0.004)
        apart = state[17] - state[0]
        if before is not None and before < 0.0 <= apart:
            crossings.append(k * 0.004)
        before = apart
    period = float(np.mean(np.diff(crossings)))
    # A mass that hangs from a free one: its frequency is larger by the ratio of the masses.
    expected = 2.0 * np.pi / sqrt(GRAVITY / 0.7 * (1.0 + 0.15 / S500.mass))
    assert period == pytest.approx(expected, rel=0.03)


# Logs.


def circling():
    """A made flight: a circle with yaw, roll and pitch."""
    t = np.arange(0.0, 4.0, 0.004)
    place = np.column_stack([np.cos(t), np.sin(2.0 * t), 1.0 + 0.2 * t])
    turn = Rotation.from_euler("ZYX", np.column_stack([t, 0.3 * np.sin(t), 0.2 * np.cos(t)]))
    q = turn.as_quat()[:, [3, 0, 1, 2]]
    rates = np.column_stack([np.sin(t), np.cos(t), 0.5 + 0.0 * t])
    felt = np.column_stack([0.5 * np.sin(t), 0.3 + 0.0 * t, 9.8 + np.cos(t)])
    rotor = 500.0 + np.arange(4) * 10.0 + np.sin(t)[:, None]
    electric = np.column_stack([12.0 - 0.01 * t, 8.0 + 0.0 * t])
    rows = (place, 0.0 * place, q, rates, 0.0 * rates, felt, rotor, rotor + 5.0, electric)
    return Flown(t, *(r[:, None, :] for r in rows))


@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_a_log_is_read_as_it_was_flown(kind, tmp_path):
    flown = circling()
    streams = measure(flown, 0, Hidden(), "imu_rpm", "plain", np.random.default_rng(3))
    if kind == "bag":
        path, mapping = tmp_path / "bag", None
        write_bag(path, streams, own_definitions()["tombo_msgs/msg/RotorSpeeds"])
    else:
        path, mapping = tmp_path / "log.csv", tmp_path / "mapping.yaml"
        write_table(path, streams, kind == "turned_table")
        mapping.write_text(mapping_text(streams, kind == "turned_table", None))
    (log,) = read_logs([path], mapping=None if mapping is None else str(mapping), names={})
    series = log.series
    assert set(series) == {
        "position", "attitude", "gyro", "accel", "rotor_speed", "rotor_command", "voltage",
        "current",
    }  # fmt: skip
    order = [ROTORS.index(name) for name in ROTOR_NAMES]
    truth = {
        "position": flown.position, "gyro": flown.rates, "accel": flown.felt,
        "rotor_speed": flown.rotor[..., order], "rotor_command": flown.command[..., order],
        "voltage": flown.electric[..., :1], "current": flown.electric[..., 1:],
    }  # fmt: skip
    noise = {"position": 7e-4, "gyro": 0.008, "accel": 0.22, "rotor_speed": 1.5, "voltage": 0.01}
    zero = streams["pose"].t[0] - series["position"].t[0]
    for name, rows in truth.items():
        t = series[name].t + zero
        expected = np.column_stack([np.interp(t, flown.t, x) for x in rows[:, 0].T])
        off = series[name].values - expected
        assert np.abs(off.mean(axis=0)).max() < 0.1 * noise.get(name, 0.5), name
        assert off.std() < 1.2 * noise.get(name, 0.5), name
    pose = series["attitude"]
    at = [np.interp(pose.t + zero, flown.t, x) for x in flown.attitude[:, 0, [1, 2, 3, 0]].T]
    off = Rotation.from_quat(pose.values) * Rotation.from_quat(np.column_stack(at)).inv()
    assert off.magnitude().mean() < 0.005
    late = series["position"].arrival - series["position"].t
    assert float(np.mean(late)) == pytest.approx(0.010, abs=0.002)


@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_motor_commands_are_read_as_they_were_asked(kind, tmp_path):
    t = 0.004 * np.arange(1000)
    asked = 0.5 + 0.3 * np.sin(t[:, None] + np.arange(4))
    streams = measure(circling(), 0, Hidden(), "mocap", "plain", np.random.default_rng(3))
    streams["throttle"] = Stream(t, asked)
    del streams["command"]
    if kind == "bag":
        path, mapping = tmp_path / "bag", None
        write_bag(path, streams, own_definitions()["tombo_msgs/msg/RotorSpeeds"])
    else:
        path, mapping = tmp_path / "log.csv", tmp_path / "mapping.yaml"
        write_table(path, streams, kind == "turned_table")
        mapping.write_text(mapping_text(streams, kind == "turned_table", None))
    (log,) = read_logs([path], mapping=None if mapping is None else str(mapping), names={})
    assert "rotor_command" not in log.series
    order = [ROTORS.index(name) for name in ROTOR_NAMES]
    np.testing.assert_allclose(log.series["motor_command"].values, asked[:, order], atol=1e-5)


@pytest.mark.slow
def test_an_imu_askew_reads_in_its_own_axes():
    flown = circling()
    angles = {"yaw": 0.3, "pitch": -0.2, "roll": 0.1}
    hidden = Hidden({f"imu_misalignment.{a}": x for a, x in angles.items()})
    straight, turned = (
        measure(flown, 0, h, "imu", "plain", np.random.default_rng(3))["imu"].values
        for h in (Hidden(), hidden)
    )
    axes = Rotation.from_euler("ZYX", list(angles.values()))  # of the IMU, in the body
    for own in (slice(0, 3), slice(3, 6)):
        seen = axes.apply(turned[:, own]) - straight[:, own]
        assert np.abs(seen.mean(axis=0)).max() < 0.05
        assert np.abs(turned[:, own] - straight[:, own]).max() > 0.05


# Score.


def said(verdict, *causes, members=()):
    return {
        "verdict": verdict, "set": list(members), "confidence": 0.9, "summary": "", "seconds": 1.0,
        "causes": [{"effect": c, "theta": {}} for c in causes], "prechecks": [], "candidates": [],
    }  # fmt: skip


def test_what_is_truly_there_besides_is_no_mistake():
    case = make_case((3, 1), "none", "", (), X500)
    assert answer_row(case, said("named", "linear_rotor_drag"))["verdict"] == "none"
    row = answer_row(case, said("named", "linear_rotor_drag", "motor_lag"))
    assert (row["verdict"], row["causes"]) == ("named", ["motor_lag"])
    case = make_case((3, 1), "none", "", (), S500)
    assert answer_row(case, said("named", "linear_rotor_drag"))["verdict"] == "named"
    case = make_case((3, 2), "single", "large", ("cog_offset",), S500)
    row = answer_row(case, said("named", "imu_lever_arm", "cog_offset"))
    assert row["causes"] == ["cog_offset"]


def test_a_case_follows_from_seed_and_number():
    for number in range(20):
        assert draw_case(4, number) == draw_case(4, number)
    assert draw_case(4, 1) != draw_case(5, 1)


def test_what_is_told_of_a_vehicle_says_what_can_be_a_cause():
    told = [
        case.known for case in (draw_case(4, n) for n in range(600)) if case.vehicle is not S500
    ]
    assert told.count("airframe") / len(told) == pytest.approx(0.25, abs=0.08)
    assert set(told) == {"airframe", "file"}
    lifted = {"mass_error", "thrust_coefficient_error"}
    assert lifted <= set(candidates("file", "mocap"))
    assert not lifted & set(candidates("airframe", "mocap"))
    assert "imu_misalignment" in candidates("file", "imu")
    assert "imu_misalignment" not in candidates("file", "mocap_rpm")


def test_an_error_of_a_parameter_is_that_of_its_departure_from_the_nominal_model():
    """By a vehicle file the model has drag already; by the airframe alone it has none."""
    case = make_case((3, 3), "single", "large", ("linear_rotor_drag",), X500)
    true = X500.drag[0] + case.truth["linear_rotor_drag.d_xy"]

    def error(nominal, value):
        fit = {"value": value, "nominal": nominal, "low": value - 0.01, "high": value + 0.01}
        answer = said("named", "linear_rotor_drag") | {
            "causes": [{"effect": "linear_rotor_drag", "theta": {"d_xy": fit}}]
        }
        (found,) = answer_row(case, answer)["parameters"].values()
        assert found["covered"] == [value == true]
        return found["error"]

    assert error(0.0, true) == error(0.4, true) == 0.0
    assert error(0.0, 0.5 * true) == pytest.approx(0.5)
    assert error(0.4, 0.4) == pytest.approx(1.0)

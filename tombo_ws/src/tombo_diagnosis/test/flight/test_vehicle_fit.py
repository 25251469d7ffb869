"""A vehicle as its flights show it: hidden values are fitted, with their interval."""

import types
from dataclasses import replace

import numpy as np
import pytest
from measured_flights import HEALTHY, LIVELY, ROTOR_DRAWS, SLOW, as_log, fly, logs, with_hidden

from tombo_bag.flight import Series
from tombo_diagnosis.flight import vehicle_fit
from tombo_diagnosis.flight.calibrate import speed_in_hover
from tombo_diagnosis.flight.diagnose import diagnose_flights
from tombo_diagnosis.flight.nominal import held_against, nominal_model
from tombo_diagnosis.flight.vehicle_fit import fit_drive, fit_vehicle
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotor_maps import speed_for_thrust
from tombo_flight.vehicle_file import read_vehicle, vehicle_from_text, vehicle_text

pytestmark = pytest.mark.slow

DRAG, LAG, INERTIA, IMU_YAW, BODY_YAW = 0.6, 0.02, 0.15, 0.08, -0.06
HIDDEN = {
    "linear_rotor_drag": {"d_xy": DRAG, "d_z": HEALTHY["linear_rotor_drag"]["d_z"]},
    "motor_lag": {"extra_tau": LAG},
    "inertia_error": {"zz": INERTIA},
    "imu_misalignment": {"yaw": IMU_YAW},
    "mocap_body_misalignment": {"yaw": BODY_YAW},
}


@pytest.fixture(scope="module")
def flights():
    return list(logs(HIDDEN, count=3))


@pytest.fixture(scope="module")
def base():
    return read_vehicle("tombo_s500")


@pytest.fixture(scope="module")
def fitted(flights, base):
    return fit_vehicle(flights, base)


def test_lag_inertia_and_drag_are_found(fitted, base):
    vehicle = fitted.file.vehicle
    lag = base.vehicle.motor_time_constant + LAG
    assert vehicle.motor_time_constant == pytest.approx(lag, abs=0.003)
    assert vehicle.inertia_zz == pytest.approx(base.vehicle.inertia_zz * (1 + INERTIA), rel=0.04)
    assert vehicle.inertia_xx == pytest.approx(base.vehicle.inertia_xx, rel=0.03)
    assert fitted.file.effects["linear_rotor_drag"]["d_xy"] == pytest.approx(DRAG, rel=0.05)
    result = fitted.fitted["motor_lag.extra_tau"]
    assert result.low < LAG < result.high


def test_how_imu_and_markers_are_turned_is_found(fitted):
    effects = fitted.file.effects
    assert effects["imu_misalignment"]["yaw"] == pytest.approx(IMU_YAW, abs=0.015)
    assert effects["mocap_body_misalignment"]["yaw"] == pytest.approx(BODY_YAW, abs=0.015)


def test_each_flight_was_asked_back_against_the_others(fitted):
    healthy = fitted.file.healthy
    assert healthy.left_out == 3 and healthy.accused == len(fitted.false_alarms) == 0


def test_accused_healthy_flights_lower_the_confidence(flights, fitted):
    file = replace(fitted.file, healthy=replace(fitted.file.healthy, accused=3))
    diagnosis = diagnose_flights(held_against(flights[:1], file), nominal_model(vehicle=file))[0]
    assert diagnosis.confidence <= 1.0 / 5.0


def test_an_accused_flight_is_counted_and_reported(base, monkeypatch):
    def diagnosed(logs, nominal):
        diagnosis = types.SimpleNamespace(verdict="none", summary="")
        if logs[0].name == "flight 2":
            diagnosis = types.SimpleNamespace(verdict="named", summary="mass error")
        assert nominal.healthy.flights == 1  # it has seen the other flight alone
        return diagnosis, None

    monkeypatch.setattr(vehicle_fit, "diagnose_flights", diagnosed)
    result = fit_vehicle(logs(courses=SLOW, count=2, length=12.0), base)
    assert dict(result.false_alarms) == {"flight 2": "mass error"}
    assert (result.file.healthy.left_out, result.file.healthy.accused) == (2, 1)


def test_rotors_that_differ_from_flight_to_flight_are_healthy(base):
    effects = with_hidden(HIDDEN | {"thrust_scatter": {"deviation": 0.06}})
    flights = [
        as_log(fly(effects, LIVELY[k % 2], 300 + k, draws=draws), f"flight {k + 1}")
        for k, draws in enumerate((ROTOR_DRAWS, -ROTOR_DRAWS))
    ]
    result = fit_vehicle(flights, base)
    assert 0.03 < result.file.healthy.spread["thrust_scatter.deviation"] < 0.15
    assert not result.false_alarms


def test_a_change_of_a_fitted_vehicle_is_still_found(fitted):
    """The spread of healthy flights does not hide a tenth more mass."""
    laden = logs(HIDDEN | {"mass_error": {"fraction": 0.12}}, seed=2, count=1)
    file = fitted.file
    diagnosis = diagnose_flights(held_against(laden, file), nominal_model(vehicle=file))[0]
    assert diagnosis.verdict != "none"


def test_measured_speeds_show_the_speed_in_hover():
    known = read_vehicle("tombo_s500")
    hover = speed_for_thrust(known.maps, known.vehicle.hover_thrust())
    assert speed_in_hover(logs(count=2)) == pytest.approx(hover, rel=0.05)


def test_poses_alone_are_accepted_with_an_own_vehicle():
    """As with the suite's own: thrust from the track."""
    (log,) = logs(count=1, sensors="poses")
    bare = log.with_series({k: log.series[k] for k in ("position", "attitude")})
    vehicle = read_vehicle("px4_x500")
    diagnosis = diagnose_flights(held_against([bare], vehicle), nominal_model(vehicle=vehicle))[0]
    assert diagnosis.vehicle == vehicle.name and "thrust from the track" in diagnosis.model


def test_the_file_holds_what_was_fitted_and_what_healthy_flights_leave(fitted):
    again = vehicle_from_text(vehicle_text(fitted.file), "a fit")
    assert again.vehicle == fitted.file.vehicle and again.effects == fitted.file.effects
    assert again.healthy == fitted.file.healthy and again.healthy.flights == 3
    assert 0.0 < again.healthy.spread["inertia_error.zz"] < 0.2
    assert again.tolerance("vehicle.inertia_zz") > 0.0


def test_with_the_fitted_vehicle_nothing_is_wrong_any_more(flights, fitted):
    file = fitted.file
    diagnosis = diagnose_flights(held_against(flights, file), nominal_model(vehicle=file))[0]
    assert diagnosis.verdict == "none"
    assert diagnosis.confidence <= 4.0 / 5.0  # three flights certify no more


def commanded(log, gain=0.5, offset=0.1, exponent=1.2, full=12.0):
    """A flight with motor commands and a supply in place of speeds: T = (a + b u)(V/12)^p."""
    speed = log.series["rotor_command"]
    thrust = read_vehicle("tombo_s500").vehicle.hover_thrust() * (speed.values / 512.3) ** 2
    volts = np.linspace(12.4, 11.2, speed.t.size)
    command = (thrust / ((volts / full) ** exponent)[:, None] - offset) / (10.0 * gain)
    series = {k: v for k, v in log.series.items() if k not in ("rotor_command", "rotor_speed")}
    series |= {
        "motor_command": Series(speed.t, command),
        "voltage": Series(speed.t, volts[:, None]),
    }
    return log.with_series(series)


def test_thrust_by_command_and_supply_is_found(base):
    flights = [commanded(log) for log in logs(count=3)]
    drive, error = fit_drive(flights, base.vehicle.mass)
    command = np.linspace(0.5, 0.8, 20)[:, None] * np.ones(4)
    for volts in (11.4, 12.2):
        true = (0.1 + 5.0 * command) * (volts / 12.0) ** 1.2
        result = drive.thrust(command, np.full(20, volts))
        assert result == pytest.approx(true, rel=0.05)
    assert drive.supply_exponent == pytest.approx(1.2, abs=0.4)
    assert 0.0 < error < 0.05


def test_without_commands_there_is_no_drive(base):
    (log,) = logs(count=1)
    bare = {k: v for k, v in log.series.items() if k not in ("rotor_command", "rotor_speed")}
    with pytest.raises(InputError, match=r"flight 1.*accepted: a log with motor_command"):
        fit_vehicle([log.with_series(bare)], base)


def test_what_a_further_flight_leaves_is_passed_rarely():
    rng = np.random.default_rng(0)
    passed = []
    for _ in range(400):
        flights = np.exp(rng.normal(0.0, 0.5, (5, 6)))
        passed.append(np.mean(flights[4] > vehicle_fit._upper_bounds(flights[:4].tolist())))
    assert np.mean(passed) == pytest.approx(0.025, abs=0.01)
    assert vehicle_fit._upper_bounds([[1.0, 2.0, 0.0]]) == (1.0, 2.0, 0.0)

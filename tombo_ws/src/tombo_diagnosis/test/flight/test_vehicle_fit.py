"""A vehicle as its flights show it: what was hidden in them is found, with its interval."""

from dataclasses import replace

import numpy as np
import pytest
from measured_flights import HEALTHY, logs

from tombo_diagnosis.flight.diagnose import diagnose
from tombo_diagnosis.flight.scenario_nominal import held_against, nominal_model
from tombo_diagnosis.flight.vehicle_fit import fit_drive, fit_vehicle
from tombo_dynamics.errors import InputError
from tombo_flight.vehicle_file import read_vehicle, vehicle_from_text, vehicle_text
from tombo_logs.flight_log import Series

pytestmark = pytest.mark.slow

DRAG, LAG, INERTIA = 0.6, 0.02, 0.15
HIDDEN = {
    "linear_rotor_drag": {"d_xy": DRAG, "d_z": HEALTHY["linear_rotor_drag"]["d_z"]},
    "motor_lag": {"extra_tau": LAG},
    "inertia_error": {"zz": INERTIA},
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
    found = fitted.seen["motor_lag.extra_tau"]
    assert found.low < LAG < found.high


def test_the_file_holds_what_was_fitted_and_what_healthy_flights_leave(fitted):
    again = vehicle_from_text(vehicle_text(fitted.file), "a fit")
    assert again.vehicle == fitted.file.vehicle and again.effects == fitted.file.effects
    assert again.healthy == fitted.file.healthy and again.healthy.flights == 3
    assert 0.0 < again.healthy.spread["mass_error.fraction"] < 0.2
    assert again.tolerance("vehicle.inertia_zz") > 0.0


def test_with_the_fitted_vehicle_nothing_is_wrong_any_more(flights, fitted):
    file = fitted.file
    said = diagnose(held_against(flights, file), nominal_model(vehicle=file))
    assert said.verdict == "none"
    assert said.confidence <= 4.0 / 5.0  # three flights certify no more


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
    return replace(log, series=series)


def test_thrust_by_command_and_supply_is_found(base):
    flights = [commanded(log) for log in logs(count=3)]
    drive, error = fit_drive(flights, base.vehicle.mass)
    command = np.linspace(0.5, 0.8, 20)[:, None] * np.ones(4)
    for volts in (11.4, 12.2):
        true = (0.1 + 5.0 * command) * (volts / 12.0) ** 1.2
        found = drive.thrust(command, np.full(20, volts))
        assert found == pytest.approx(true, rel=0.05)
    assert drive.supply_exponent == pytest.approx(1.2, abs=0.4)
    assert 0.0 < error < 0.05


def test_without_commands_there_is_no_drive(base):
    (log,) = logs(count=1)
    bare = {k: v for k, v in log.series.items() if k not in ("rotor_command", "rotor_speed")}
    with pytest.raises(InputError, match=r"flight 1.*accepted: a log with motor_command"):
        fit_vehicle([replace(log, series=bare)], base)

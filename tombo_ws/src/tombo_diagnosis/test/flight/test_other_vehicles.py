"""Vehicles that the suite does not know: thrust is fitted to their flights, also to real ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measured_flights import SLOW, logs, nominal

from tombo_bag.flight import Airframe, Series
from tombo_diagnosis.flight.calibrate import calibrated
from tombo_diagnosis.flight.diagnose import diagnose_flights
from tombo_diagnosis.flight.fit.prediction import residuals
from tombo_diagnosis.flight.fit.track import track_of
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotor_maps import speed_for_thrust
from tombo_logs.checks import check_log
from tombo_logs.readers.log_reader import read_logs

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).resolve().parents[6] / "shared" / "data" / "flights"
CRASH = "B2_circle_medium_rep3"
real_data = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"real data absent: no {FOLDER}")
FRAME = Airframe("Unknown", 1.3, 0.24, 0.12)


@pytest.fixture(scope="module")
def real():
    names = ("B10_lissajous_fast_rep1", CRASH, "B3_figure8_fast_rep1")
    return [check_log(log) for log in read_logs([FOLDER / f"{name}.csv.gz" for name in names])]


@pytest.fixture(scope="module")
def diagnosis(real):
    return diagnose_flights(real, nominal())[0]


@real_data
def test_drag_is_named_on_the_real_flights(diagnosis):
    assert diagnosis.verdict in ("named", "partly_explained")
    drag = next(c for c in diagnosis.causes if c.effect == "linear_rotor_drag")
    size = next(f for f in drag.theta if f.name == "d_xy")
    assert 0.003 < size.low < size.value < size.high < 0.05  # of 27 g: about 0.4 1/s


@real_data
def test_the_error_in_flights_held_out_falls(diagnosis):
    gains = {g.channel: g for g in diagnosis.gain if g.horizon == "one step"}
    assert gains["force x"].reduction >= 0.75 and gains["force y"].reduction >= 0.60
    for axis in "xy":
        own = gains[f"force {axis}"]
        assert 0.0 < own.low <= own.reduction <= own.high < 1.0
        assert 0.1 < own.before < 0.5


@real_data
def test_the_crash_is_excluded_and_reported(real, diagnosis):
    assert any(f.check == "crash" and f.flight == CRASH for f in diagnosis.prechecks)
    track = track_of(next(log for log in real if log.name == CRASH))
    crash = next(f for log in real for f in log.findings if f.check == "crash")
    assert not track.fast_rows[track.fast.t > crash.start_s - 0.05].any()
    assert track.fast_rows.any()


@real_data
def test_what_a_vehicle_file_can_not_show_is_reported(diagnosis):
    assert any("certified" in note for note in diagnosis.notes)
    fitted = {c.effect: c for c in diagnosis.candidates}
    assert not fitted["mass_error"].excited and "fit" in fitted["mass_error"].remark
    assert "mass_error" not in {c.effect for c in diagnosis.causes}
    assert not [r for r in diagnosis.residuals if r.channel.startswith("turning")]


def as_other(log, gain=1.0, offset=0.0):
    """Return a flight of our vehicle as of one with motor commands only."""
    speed = log.series["rotor_command"]
    drive = gain * (speed.values / 600.0) ** 2 + offset
    series = {k: v for k, v in log.series.items() if k not in ("rotor_command", "rotor_speed")}
    return replace(
        log.with_series({**series, "motor_command": Series(speed.t, drive)}), airframe=FRAME
    )


@pytest.mark.parametrize("gain,offset,sensors", [(0.4, 0.1, "imu"), (1.0, 0.0, "mocap")])
def test_thrust_follows_from_any_linear_motor_command(gain, offset, sensors):
    flights = [as_other(log, gain, offset) for log in logs(sensors=sensors)]
    model, changed = calibrated(flights)
    assert model.calibrated and not model.moments and "mass_error.fraction" in model.fitted
    assert ("mocap_stamp_error.offset" in model.fitted) == (sensors == "mocap")
    left = residuals(track := track_of(changed[0]), model, model.theta)
    force = left["fast"][:, 2] if sensors == "imu" else left["slow"][:, 2]
    assert abs(force.mean()) < 0.1 and force.std() < 0.3
    assert track.command.min() > 0.0
    assert "motor_command" in changed[0].series and "rotor_command" in changed[0].series


def test_measured_speeds_are_no_commands():
    """Taken as commands they would lag behind themselves: a motor that leads would be named."""
    flights = [replace(log, airframe=FRAME) for log in logs(sensors="imu_rpm")]
    flights = [
        f.with_series({k: v for k, v in f.series.items() if k != "rotor_command"}) for f in flights
    ]
    model, changed = calibrated(flights)
    assert "rotor_command" not in changed[0].series
    assert changed[0].series["rotor_speed"] is flights[0].series["rotor_speed"]
    assert 400.0 < float(speed_for_thrust(model.maps, model.vehicle.hover_thrust())) < 600.0
    diagnosis = diagnose_flights(flights, nominal())[0]
    assert "motor_lag" not in {c.effect for c in diagnosis.causes}


def test_poses_alone_of_a_vehicle_without_a_file_allow_no_more_than_their_number():
    """What its healthy flights leave is not known: no noise of poses is called gusts."""
    quick = np.random.default_rng(4)
    kept = ("position", "attitude")
    flights = []
    for log in logs(sensors="mocap")[:2]:
        series = {name: log.series[name] for name in kept}
        place = series["position"]
        noisy = place.values + quick.normal(0.0, 0.004, place.values.shape)
        series["position"] = replace(place, values=noisy)
        flights.append(replace(log.with_series(series), airframe=FRAME))
    diagnosis = diagnose_flights(flights, nominal())[0]
    assert diagnosis.confidence <= (len(flights) + 1) / (len(flights) + 2) + 1e-9
    assert not {"gusts", "mocap_noise"} & {c.effect for c in diagnosis.causes}


def test_drag_of_a_vehicle_without_a_file_is_found_with_its_size():
    """The nominal model of such a vehicle knows no drag: all is found, 0.3 N s/m."""
    diagnosis = diagnose_flights([as_other(log) for log in logs()], nominal())[0]
    drag = next(c for c in diagnosis.causes if c.effect == "linear_rotor_drag")
    assert next(f.value for f in drag.theta if f.name == "d_xy") == pytest.approx(0.3, rel=0.15)


def test_thrust_that_comes_late_is_not_called_a_wrong_stamp():
    """By 25 ms behind the rotors' speed, as hysteresis is: without a gyro both look the same."""
    flights = [replace(log, airframe=FRAME) for log in logs(sensors="mocap_rpm")]
    early = [
        replace(f.series["rotor_speed"], t=f.series["rotor_speed"].t - 0.025) for f in flights
    ]
    kept = ("position", "attitude")
    flights = [
        f.with_series({**{k: f.series[k] for k in kept}, "rotor_speed": s})
        for f, s in zip(flights, early, strict=True)
    ]
    diagnosis = diagnose_flights(flights, nominal())[0]
    assert not {"mocap_stamp_error", "thrust_scatter"} & {c.effect for c in diagnosis.causes}
    remark = next(c.remark for c in diagnosis.candidates if c.effect == "mocap_stamp_error")
    assert "taken up" in remark


def test_wind_on_a_vehicle_without_a_file_is_named_with_its_speed():
    """No drag is known of it, so no wind can act on it: the log's own check says that one does."""
    hidden = {"steady_wind": {"east": -6.0, "north": 5.0}}
    flights = [
        check_log(as_other(log, gain=0.4)) for log in logs(hidden, sensors="imu", length=22.0)
    ]
    assert all("wind" in {f.check for f in flight.findings} for flight in flights)
    assert calibrated(flights)[0].effects["linear_rotor_drag"]["d_xy"] > 0.1
    diagnosis = diagnose_flights(flights, nominal())[0]
    assert diagnosis.verdict in ("named", "partly_explained")
    wind = next(c for c in diagnosis.causes if c.effect == "steady_wind")
    sizes = {f.name: f.value for f in wind.theta}
    assert sizes["east"] == pytest.approx(-6.0, abs=1.0)
    assert sizes["north"] == pytest.approx(5.0, abs=1.0)


def test_without_wind_no_drag_is_taken_as_known():
    still = [check_log(as_other(log, gain=0.4)) for log in logs(sensors="imu")]
    assert not calibrated(still)[0].effects


def test_a_drive_that_does_not_change_is_taken_in_proportion():
    flights = [as_other(log) for log in logs(count=1)]
    steady = flights[0].series["motor_command"]
    still = replace(steady, values=np.full_like(steady.values, 0.5))
    flights = [flights[0].with_series({**flights[0].series, "motor_command": still})]
    _, changed = calibrated(flights)
    speed = changed[0].series["rotor_command"].values
    assert np.ptp(speed) < 1e-6 and speed.mean() == pytest.approx(1000.0, rel=0.05)


def test_without_motor_commands_there_is_no_model():
    (log,) = logs(count=1)
    bare = {k: v for k, v in log.series.items() if k not in ("rotor_command", "rotor_speed")}
    with pytest.raises(InputError, match=r"flight 1.*motor_command"):
        calibrated([replace(log.with_series(bare), airframe=FRAME)])


def test_a_flight_without_commands_is_left_out_and_the_others_are_diagnosed():
    flights = [replace(log, airframe=FRAME) for log in logs(courses=SLOW, count=2, length=12.0)]
    series = {k: v for k, v in flights[0].series.items() if not k.startswith("rotor")}
    diagnosis = diagnose_flights([flights[0].with_series(series), flights[1]], nominal())[0]
    assert [f.name for f in diagnosis.flights] == [flights[1].name]
    left_out = next(f for f in diagnosis.prechecks if "no motor commands" in f.message)
    assert left_out.flight == flights[0].name

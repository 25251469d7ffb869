"""Gains and oscillations of controllers: simulated with known gains, and real ones."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from tombo_bag.flight import Airframe, Series
from tombo_diagnosis.change.diagnose import diagnose_change
from tombo_diagnosis.control.actuators import with_asked_rotors
from tombo_diagnosis.control.controller import controller_report
from tombo_diagnosis.control.gains import LoopGain
from tombo_diagnosis.control.signals import DrivePlant
from tombo_diagnosis.flight.diagnose import diagnose_flights
from tombo_diagnosis.flight.nominal import nominal_model
from tombo_diagnosis.rotor_demand import MODES
from tombo_dynamics.yaml_text import read_yaml
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario
from tombo_logs.checks import check_log
from tombo_logs.readers.csv_mapping import load_mapping
from tombo_logs.readers.log_reader import read_log
from tombo_logs.readers.vehicle_airframe import vehicle_of

DATA = Path(__file__).parents[6] / "shared" / "data" / "crazyswarm2"
MAPPING = Path(__file__).parents[5] / "examples" / "crazyswarm2.yaml"
OSCILLATING = (22, 30, 45, 76, 113, 119, 146, 149, 179)
FLIP = 28

pytestmark = pytest.mark.slow
real = pytest.mark.skipif(not DATA.is_dir(), reason=f"real data absent: no {DATA}")


@cache
def plant():
    model = nominal_model()
    return DrivePlant(model.vehicle, model.maps, model.maps.torque_ratio)


def gains_of(control):
    """Return the gains of the cascade as a flight shows them, by label.

    Position P on velocity PID is one PID on position, as long as nothing is at a limit.
    """
    rows = [("attitude", "yaw", "P", "1/s", control.yaw_p)]
    for axis, rate, attitude in (
        ("yaw", (control.yaw_rate_p, control.yaw_rate_i, None), None),
        ("roll", (control.rate_p, control.rate_i, control.rate_d), control.attitude_p),
        ("pitch", (control.rate_p, control.rate_i, control.rate_d), control.attitude_p),
    ):
        units = {"P": "s/rad", "I": "/rad", "D": "s^2/rad"}
        for (term, unit), value in zip(units.items(), rate, strict=True):
            space = "" if term == "I" else " "
            rows.append(("rate", axis, term, f"rad/s^2{space}{unit}", value))
        rows.append(("attitude", axis, "P", "1/s", attitude))
    place = control.velocity_p * control.position_p + control.velocity_i
    for axis in "xy":
        rows.append(("position", axis, "P", "1/s^2", place))
        rows.append(("position", axis, "I", "1/s^3", control.velocity_i * control.position_p))
        rows.append(("position", axis, "D", "1/s", control.velocity_p))
    known = [LoopGain(*row, row[-1], row[-1]) for row in rows if row[-1] is not None]
    return {gain.label: gain for gain in known}


def report(*settings, seed=3, name="no_obstacle"):
    scenario = load_scenario(name, [f"control.{s}" for s in settings])
    flight = fly_scenario(scenario, seed)
    usual = gains_of(load_scenario("no_obstacle").control)
    found = controller_report([flight], plant(), [*usual.values()], "the usual one")
    return found, gains_of(scenario.control)


@pytest.mark.parametrize(
    ("setting", "differing"),
    [
        ("rate_p=33", {"rate roll P", "rate pitch P"}),
        ("rate_d=0.6", {"rate roll D", "rate pitch D"}),
        ("rate_i=60", {"rate roll I", "rate pitch I"}),
        ("attitude_p=8.4", {"attitude roll P", "attitude pitch P"}),
        ("velocity_p=3.6", {f"position {a} {g}" for a in "xy" for g in "PD"}),
    ],
)
def test_a_changed_gain_is_named_with_its_size(setting, differing):
    found, true = report(setting)
    assert {c.gain.label for c in found.changed} == differing
    for change in found.changed:
        gain, size = change.gain, true[change.gain.label].value
        assert gain.value == pytest.approx(size, rel=0.15)
        assert gain.low <= size <= gain.high


def test_set_points_that_jump_accuse_no_gain():
    found, true = report(seed=7, name="aggressive")
    assert found.changed == ()
    loops = [g for g in found.gains if g.loop == "position"]
    assert {f"{g.axis} {g.term}" for g in loops} == {f"{a} {t}" for a in "xy" for t in "PID"}
    for gain in loops:
        assert gain.value == pytest.approx(true[gain.label].value, rel=0.1), gain.label


@pytest.mark.parametrize("seed", [3, 8])
def test_unchanged_gains_are_known_and_not_accused(seed):
    found, true = report(seed=seed)
    assert found.changed == () and found.oscillations == () and found.summary == ""
    assert len(found.gains) > 12
    for gain in found.gains:
        rel = 0.15 if gain.term == "I" else 0.1
        assert gain.value == pytest.approx(true[gain.label].value, rel=rel), gain.label
        assert gain.low <= true[gain.label].value <= gain.high


@pytest.mark.parametrize(
    ("settings", "loop"),
    [(("attitude_p=20", "rate_p=9"), "attitude"), (("velocity_p=15",), "position")],
)
def test_an_oscillation_has_its_loop(settings, loop):
    ((_, swing),) = report(*settings)[0].oscillations
    assert swing.loop == loop and 1.0 < swing.hertz < 3.0


@pytest.mark.parametrize("lost", [0.0, 0.25])
def test_actuators_that_give_less_than_is_asked_for_are_told(lost):
    settings = [f"effects.thrust_coefficient_error.fraction={-lost}"]
    scenario = load_scenario("no_obstacle", settings)
    flight = as_foreign(fly_scenario(scenario, 3))
    found = controller_report([flight], None)
    (gain,) = [g for g in found.gains if g.loop == "actuators"]
    assert gain.value == pytest.approx(1.0 - lost, abs=0.03)
    assert gain.low < 1.0 - lost < gain.high
    assert ("actuators are weaker" in found.summary) == bool(lost)


def test_set_points_say_what_each_rotor_is_asked_for():
    """Torque of the motion itself and the collective give the thrust of each rotor, as it was."""
    flight = as_foreign(fly_scenario(load_scenario("no_obstacle"), 3))
    assert with_asked_rotors(flight) is flight, "it has commands of its own"
    without = flight.with_series(
        {n: s for n, s in flight.series.items() if n not in ("rotor_command", "rotor_speed")}
    )
    asked = with_asked_rotors(without).series["rotor_command"]
    air = (asked.t > 3.0) & (asked.t < asked.t[-1] - 1.0)
    truth = flight.log["rotor_thrust"][np.searchsorted(flight.t, asked.t[air])]
    wanted = asked.values[air] ** 2
    step = asked.t[1] - asked.t[0]
    for roll_or_pitch in MODES[1:3]:  # moments that do not come from thrust are faster than 20 ms
        true, estimate = (
            gaussian_filter1d(x @ roll_or_pitch, 0.02 / step) for x in (truth, wanted)
        )
        assert np.corrcoef(true, estimate)[0, 1] > 0.8
        scale = truth.mean() / wanted.mean()
        assert scale * np.std(estimate) == pytest.approx(np.std(true), rel=0.25)


def as_foreign(flight):
    """Return a simulated flight as a log of a vehicle of which mass and arms are known."""
    vehicle = plant().vehicle
    frame = Airframe("S500", vehicle.mass, vehicle.arm_length, vehicle.rotor_radius)
    inertia = np.diag([vehicle.inertia_xx, vehicle.inertia_yy, vehicle.inertia_zz])
    rates = flight.log["rates"]
    momentum = rates @ inertia
    torque = np.gradient(momentum, flight.t, axis=0) + np.cross(rates, momentum)
    return replace(flight, airframe=frame).with_series(
        {**flight.series, "torque_setpoint": Series(flight.t, torque)}
    )


def test_a_log_without_set_points_says_that_nothing_is_known():
    flight = fly_scenario(load_scenario("no_obstacle"), 3)
    assert controller_report([flight.with_series(flight.series)], plant()).gains
    named = {n for n in flight.topics if "setpoint" not in n}
    bare = controller_report([_only(flight, named)], plant())
    assert bare.gains == () and "no set points" in bare.unknown[0]


def _only(flight, topics):
    return replace(flight, topics={n: flight.topics[n] for n in topics})


def numbers():
    return sorted(int("".join(filter(str.isdigit, p.name.split(".")[0]))) for p in logs())


def logs():
    return sorted(DATA.glob("log*.csv.gz"))


def flight(number):
    (path,) = DATA.glob(f"log{number:02d}[._]*csv.gz")
    return read_log(path, path.name, load_mapping(MAPPING))


@real
@pytest.mark.parametrize("number", [8, 70, 103, 126, 160, 178, 203])
def test_gains_of_a_real_controller_are_those_that_were_written_down(number):
    written = read_yaml(DATA / f"info{number:02d}.yaml", "gains")
    found = {g.label: g for g in controller_report([flight(number)], None).gains}
    names = {"P": "KR", "D": "Kw", "I": "KI"}
    for axis, letter in (("roll", "x"), ("pitch", "y")):
        for term, name in names.items():
            gain = found.get(f"attitude {axis} {term}")
            if gain is not None:
                assert gain.value == pytest.approx(written[f"{name}_{letter}"], rel=0.15)
    assert "attitude roll P" in found and "attitude roll D" in found


@real
def test_real_oscillations_are_told_from_other_flights():
    right = [
        bool(controller_report([flight(n)], None).oscillations) == (n in (*OSCILLATING, FLIP))
        for n in numbers()
    ]
    assert sum(right) >= 0.9 * len(right)


UPGRADED, STANDARD, LOADED = (103, 111, 126, 137), (148, 156, 160, 178), (184, 201, 203, 205)


@real
@pytest.mark.parametrize(
    ("numbers", "said"),
    [(UPGRADED, "stronger"), (STANDARD, ""), (LOADED, "the vehicle weighs more")],
)
def test_real_actuators_that_are_others_than_believed_are_told(numbers, said):
    for number in numbers:
        summary = controller_report([flight(number)], None).summary
        assert said in summary if said else "rotors give" not in summary


@real
def test_stronger_motors_are_told_without_commands_of_rotors():
    def changed(new, old):
        logs = [[check_log(flight(n)) for n in numbers] for numbers in (new, old)]
        nominal = nominal_model(vehicle=vehicle_of(logs[0][0].airframe))
        return diagnose_change(*logs, nominal)[0]

    found = changed(STANDARD[:2], UPGRADED)
    assert "mass_error" in found.set  # which no log tells from thrust of all rotors
    assert changed(STANDARD[2:], STANDARD[:2]).verdict == "none"
    assert changed(UPGRADED[3:], UPGRADED[:3]).verdict == "none"


@real
def test_a_real_load_on_a_thread_is_named_with_its_grams():
    """About 5 g, its authors write; 5.3 g by force across the thread, without a model."""
    found = diagnose_flights([check_log(flight(184))], nominal_model())[0]
    (load,) = [c for c in found.causes if c.effect == "hanging_load"]
    (mass,) = [f for f in load.theta if f.name == "mass"]
    assert mass.low < 0.0053 < mass.high
    assert 0.004 < mass.value < 0.006


NANOBENCH = DATA.parent / "nanobench_controllers"


@pytest.mark.skipif(not NANOBENCH.is_dir(), reason=f"real data absent: no {NANOBENCH}")
def test_two_real_controllers_are_told_apart_and_neither_from_itself():
    flights = {
        kind: [
            read_log(p, p.name, load_mapping("nanobench")) for p in NANOBENCH.glob(f"{kind}_*.gz")
        ]
        for kind in ("pid", "mell")
    }
    gains = {kind: controller_report(each, None).gains for kind, each in flights.items()}
    for one, other in (("pid", "mell"), ("mell", "pid")):
        found = controller_report(flights[one], None, gains[other], "the other")
        assert "another than the other" in found.summary
        for k, flight in enumerate(flights[one]):
            rest = controller_report(flights[one][:k] + flights[one][k + 1 :], None)
            assert controller_report([flight], None, rest.gains, "the others").changed == ()

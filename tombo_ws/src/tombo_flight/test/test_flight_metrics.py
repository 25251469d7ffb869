"""The figures of a flight, on flights made by hand whose figures are known."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_bag.flight import Flight
from tombo_collision.decision import Decision
from tombo_dynamics.messages import CollisionEvent, Phase, Trigger
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.flight import fly_scenario
from tombo_flight.flight_metrics import detection_of, first_sustained, lowest_point, summarize
from tombo_flight.flight_output import flight_summary
from tombo_flight.scenario import Scenario, load_scenario
from tombo_sim.kernel import FIGURE_COLUMNS

CONTACT = 4.0
EPOCH_NS = 1_790_000_000 * 10**9
X_R = np.array([0.9, 0.0, 2.0])
PAPER: Scenario = load_scenario()
EMPTY: Scenario = load_scenario("no_obstacle")


def offset_by(x, y, z):
    """A place at a distance from x_r."""
    return X_R + np.array([x, y, z])


class Made:
    """A flight of 15 s: on the floor, up to 2 m at 1 s, contact at 4 s, at x_r ever after."""

    def __init__(self, scenario=PAPER, seconds=15.0):
        self.scenario = scenario
        self.t = np.arange(round(seconds * 1000)) * 1e-3
        n = self.t.size
        self.log = {
            "position": np.tile(X_R, (n, 1)),
            "velocity": np.zeros((n, 3)),
            "attitude": np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
            "rates": np.zeros((n, 3)),
            "fold": np.zeros((n, 4)),
            "damage": np.zeros((n, 4)),
            "contact": np.zeros((n, 5)),
            "contact_force": np.zeros((n, 3)),
            "mode": np.full((n, 1), float(Phase.HOVER)),
            "position_setpoint": np.tile(X_R, (n, 1)),
        }
        self.detections, self.reactions = [], []
        self.set("position", 0.0, 1.0, [0.0, 0.0, 0.18])
        self.set("mode", 0.0, 0.5, Phase.IDLE)
        self.set("mode", 0.5, 1.5, Phase.TAKEOFF)

    def set(self, name, begin, end, value, axis=slice(None)):
        where = (self.t >= begin - 1e-9) & (self.t < end - 1e-9)
        self.log[name][where, axis] = value
        return self

    def tilted(self, begin, end, angle):
        return self.set(
            "attitude", begin, end, [math.sin(0.5 * angle), 0.0, 0.0, math.cos(0.5 * angle)]
        )

    def touched(self, at=CONTACT, rotor=2.0, point=(1.9, 0.1, 2.0)):
        self.set("contact", at, at + 0.01, [1.0, rotor, *point])
        return self.set("mode", at + 0.05, 99.0, Phase.REACT)

    def detected(self, stamp, arrival, trigger="innovation", rotor=-1):
        place = np.array([1.7, 0.0, 2.0])
        ahead = np.array([1.0, 0.0, 0.0])
        count = len(self.detections) + 1
        stamp_ns, number = EPOCH_NS + round(stamp * 1e9), Trigger[trigger.upper()]
        event = CollisionEvent(
            stamp_ns, "map", number, stamp_ns, place, ahead, 0.99, 80.0, count, rotor
        )
        self.detections.append(detection_of(event, arrival, EPOCH_NS))
        return self

    def reacted(self, x_r=X_R):
        self.reactions.append(Decision(x_r - [-0.8, 0.0, 0.0], np.array([-1.0, -0.0, -0.0]), x_r))
        return self

    def figures(self):
        return self.summary()[0]

    def summary(self):
        flight = Flight({}, t=self.t, log=self.log)
        return summarize(flight, self.scenario, 7, self.detections, self.reactions, 0.05)


def collision():
    """Contact, detection 40 ms later, away from x_r for 3 s, then there."""
    made = Made().touched().detected(CONTACT + 0.03, CONTACT + 0.04).reacted()
    return made.set("position", CONTACT, CONTACT + 3.0, offset_by(0.5, 0.0, 0.0))


def times(events, kind):
    return [event["time_s"] for event in events if event["kind"] == kind]


# --- Contact and detection ------------------------------------------------------------------


def test_contact_is_told_as_it_was():
    figures, events = collision().summary()
    assert figures["collided"]
    assert figures["collision_time_s"] == CONTACT
    assert figures["contact_rotor"] == "front_left"
    assert figures["contact_point_m"] == [1.9, 0.1, 2.0]
    assert figures["contact_position_m"] == [1.4, 0.0, 2.0]
    assert [e for e in events if e["kind"] == "contact"] == [
        {"time_s": CONTACT, "kind": "contact", "text": "front left touches"}
    ]
    assert Made().touched(rotor=-1.0).figures()["contact_rotor"] == "frame"


def test_latency_runs_from_the_true_contact_to_the_arrival():
    figures = collision().figures()
    assert figures["detected"]
    assert figures["detection_latency_s"] == pytest.approx(0.04)
    assert figures["detection_time_s"] == pytest.approx(CONTACT + 0.04)
    assert figures["false_alarms"] == 0


def test_an_event_before_contact_is_a_false_alarm_not_the_detection():
    made = Made().touched().detected(3.0, 3.01).detected(CONTACT, CONTACT + 0.012)
    figures = made.figures()
    assert figures["false_alarms"] == 1
    assert figures["detections"] == 2
    assert figures["detection_latency_s"] == pytest.approx(0.012)


def test_a_known_region_may_be_ahead_of_the_contact():
    made = Made().touched().detected(CONTACT - 0.17, CONTACT - 0.16, "region").reacted()
    assert made.figures()["detection_latency_s"] == pytest.approx(-0.16)
    assert made.figures()["false_alarms"] == 0
    # with both triggers too: it is the event's own trigger that counts
    made.scenario = replace(PAPER, detector=replace(PAPER.detector, trigger="both"))
    assert made.figures()["false_alarms"] == 0


@pytest.mark.parametrize("trigger", ["innovation", "region"])
def test_every_event_without_an_obstacle_is_a_false_alarm(trigger):
    figures = Made(EMPTY).detected(5.0, 5.01, trigger).figures()
    assert figures["false_alarms"] == 1
    assert not figures["detected"]


# --- Falling, unstable, recovered -----------------------------------------------------------


def test_falling_distance_is_from_contact_to_the_lowest_until_settled():
    made = collision()
    made.set("position", CONTACT + 0.4, CONTACT + 0.6, 1.37, axis=2)
    made.set("position", 12.0, 12.5, 0.5, axis=2)  # long after it has settled
    assert made.figures()["max_falling_distance_m"] == pytest.approx(0.63)


def test_falling_distance_without_settling_ends_at_the_landing():
    made = Made().touched()
    made.set("position", 5.0, 5.5, 1.2, axis=2)
    made.set("position", 9.0, 99.0, 0.18, axis=2).set("mode", 8.9, 99.0, Phase.LAND)
    assert made.figures()["max_falling_distance_m"] == pytest.approx(0.8)


def test_unstable_until_level_and_slow_for_three_tenths_of_a_second():
    made = collision().tilted(CONTACT + 0.001, CONTACT + 0.6, 0.3)
    assert made.figures()["unstable_phase_s"] == pytest.approx(0.6)
    made.tilted(CONTACT + 0.85, CONTACT + 0.9, 0.18)  # calm for 0.25 s only
    assert made.figures()["unstable_phase_s"] == pytest.approx(0.9)
    made.set("rates", CONTACT + 1.1, CONTACT + 1.5, [0.0, 0.8, 0.8])  # 1.13 rad/s
    assert made.figures()["unstable_phase_s"] == pytest.approx(1.5)
    made.set("rates", CONTACT + 1.6, CONTACT + 1.7, [0.0, 0.0, 0.99])
    made.tilted(CONTACT + 1.6, CONTACT + 1.7, 0.169)
    assert made.figures()["unstable_phase_s"] == pytest.approx(1.5)
    made.tilted(9.0, 9.1, 0.5)  # later samples do not count
    assert made.figures()["unstable_phase_s"] == pytest.approx(1.5)


def test_recovered_when_near_and_slow_for_a_second_before_landing():
    landing = collision().set("mode", CONTACT + 3.9, 99.0, Phase.LAND)
    assert landing.figures()["recovery_time_s"] is None
    made = collision()
    assert made.figures()["recovery_time_s"] == pytest.approx(3.0)
    made.set("velocity", CONTACT + 3.0, CONTACT + 3.2, [0.0, 0.11, 0.0])
    assert made.figures()["recovery_time_s"] == pytest.approx(3.2)
    made.set("position", CONTACT + 4.1, CONTACT + 4.15, offset_by(0.0, 0.0, 0.101))
    assert made.figures()["recovery_time_s"] == pytest.approx(4.15)
    made.set("position", CONTACT + 6.0, CONTACT + 7.0, offset_by(0.0, 0.09, 0.0))
    assert made.figures()["recovery_time_s"] == pytest.approx(4.15)


def test_settled_error_is_the_mean_distance_until_landing():
    made = collision().set("position", CONTACT + 3.0, 99.0, offset_by(0.03, 0.04, 0.0))
    made.set("mode", 12.0, 99.0, Phase.LAND).set("position", 12.0, 99.0, 0.18, axis=2)
    figures, events = made.summary()
    assert figures["settled_error_m"] == pytest.approx(0.05)
    assert times(events, "settled") == [CONTACT + 3.0]


def test_not_recovered_without_reaction_or_at_another_place():
    without = collision()
    without.reactions.clear()
    elsewhere = collision()
    elsewhere.reactions[0] = replace(elsewhere.reactions[0], x_r=offset_by(0.0, 0.2, 0.0))
    for made in (without, elsewhere):
        assert made.figures()["recovery_time_s"] is None
        assert made.figures()["settled_error_m"] is None


def test_after_a_second_collision_it_is_the_last_x_r_that_counts():
    made = collision()
    made.reacted(np.array([5.0, 5.0, 2.0]))
    assert made.figures()["recovery_time_s"] is None
    made.reacted(X_R)
    assert made.figures()["recovery_time_s"] == pytest.approx(3.0)
    assert made.figures()["x_r_m"] == pytest.approx(X_R.tolist())


# --- Crash ----------------------------------------------------------------------------------

ON_THE_FLOOR = [0.9, 0.0, 0.17]
"""Legs 1 cm in the floor."""


def on_the_floor(made, at, sinks, *, until=99.0):
    """Down from `at` on; it hits the floor so fast [m/s]."""
    made.set("position", at, until, ON_THE_FLOOR)
    return made.set("velocity", at, at + 0.001, [0.0, 0.0, -sinks])


def test_a_hard_hit_of_the_ground_is_a_crash():
    figures, events = on_the_floor(collision(), 5.0, 3.0).summary()
    assert figures["crashed"]
    assert figures["crash_time_s"] == 5.0
    assert times(events, "crash") == [5.0]
    assert on_the_floor(collision(), 5.0, 3.0, until=5.002).figures()["crashed"]


@pytest.mark.parametrize("mode", [Phase.APPROACH, Phase.LAND])
def test_how_hard_it_is_decides_and_not_who_lands(mode):
    """PX4 lands at 0.7 m/s by itself; a quarter of the energy of a fall of 0.2 m is too much."""
    for sinks, crashes in ((0.3, False), (0.7, False), (0.9, False), (1.1, True), (20.0, True)):
        made = on_the_floor(Made().set("mode", 4.9, 99.0, mode), 5.0, sinks)
        assert made.figures()["crashed"] is crashes, sinks
        # landing that is commanded afterwards does not mend it
        made.set("mode", 6.0, 99.0, Phase.LANDED)
        assert made.figures()["landed"] is not crashes, sinks


def test_a_motor_on_the_ground_is_a_crash_however_slow():
    low = Made().set("position", 5.0, 5.5, [0.9, 0.0, 0.12])
    assert not low.figures()["crashed"]  # on folded legs, say
    assert low.tilted(5.2, 5.3, 1.5).figures()["crash_time_s"] == 5.2


def test_before_it_has_flown_it_cannot_crash():
    made = Made().set("position", 0.0, 99.0, [0.0, 0.0, 0.17])
    assert not made.figures()["crashed"]


def test_turned_over_for_good_is_a_crash_and_a_loop_is_not():
    looped = Made().tilted(5.0, 6.0, 2.5)
    assert not looped.figures()["crashed"]
    assert looped.figures()["max_tilt_rad"] == pytest.approx(2.5)
    over = Made().tilted(5.0, 6.0, 2.5).tilted(9.0, 99.0, 2.2)
    assert over.figures()["crashed"]
    assert over.figures()["crash_time_s"] == 9.0
    assert not Made().tilted(9.0, 99.0, 2.0).figures()["crashed"]


# --- The rest -------------------------------------------------------------------------------


@pytest.mark.parametrize("ticks", [0, 1, 1000, 4001, 7500])
def test_a_flight_cut_off_at_any_time_has_figures(ticks):
    made = collision().tilted(CONTACT + 0.001, CONTACT + 0.6, 0.3)
    made.t = made.t[:ticks]
    made.log = {name: column[:ticks] for name, column in made.log.items()}
    figures = made.figures()
    assert figures["duration_s"] == pytest.approx(ticks * 1e-3)
    assert figures["collided"] == (ticks > 4000)
    assert not figures["crashed"]
    assert figures["recovery_time_s"] is None
    if ticks == 7500:  # calm, but not yet a second at x_r
        assert figures["unstable_phase_s"] == pytest.approx(0.6)
    elif ticks > 4001:
        assert figures["unstable_phase_s"] is None


def test_peak_force_is_the_largest_vector_from_contact_on():
    made = collision().set("contact_force", 3.9, 3.95, 99.0)  # before the contact
    made.set("contact_force", 4.0, 4.01, [3.0, 0.0, 4.0]).set(
        "contact_force", 6.0, 6.01, [4.5] * 3
    )
    figures, _ = made.summary()
    assert figures["peak_contact_force_n"] == pytest.approx(4.5 * math.sqrt(3.0), abs=1e-6)
    assert Made().summary()[0]["peak_contact_force_n"] is None


@pytest.mark.parametrize(
    ("trigger", "rotor", "named"),
    [("imu", 2, "front_left"), ("imu", -1, None), ("innovation", 0, None)],
)
def test_the_struck_rotor_is_named_by_the_imu_alone(trigger, rotor, named):
    figures, _ = Made().touched().detected(4.003, 4.004, trigger, rotor).summary()
    assert figures["struck_rotor"] == named
    assert figures["contact_known_s"] == pytest.approx(0.004)


def test_strikes_and_broken_rotors_are_counted():
    made = collision().set("fold", 4.0, 4.1, 0.9, axis=2)
    made.set("fold", 4.3, 4.4, 0.7, axis=2).set("fold", 4.3, 4.4, 0.6, axis=0)
    made.set("fold", 4.6, 4.7, 0.4, axis=1)
    made.set("damage", 4.3, 99.0, 1.0, axis=2).set("damage", 4.0, 99.0, 0.9, axis=1)
    figures, events = made.summary()
    assert figures["strikes"] == 3
    assert figures["rotors_broken"] == 1
    assert times(events, "rotor_broken") == [4.3]


def test_tracking_is_measured_before_contact_only():
    made = collision()
    made.set("position", 1.5, 2.5, offset_by(0.03, 0.04, 0.0))
    made.set("mode", 2.5, CONTACT, Phase.APPROACH)
    made.set("position", 2.5, CONTACT, offset_by(0.0, 0.0, 0.12))
    figures = made.figures()
    assert figures["hover_rms_m"] == pytest.approx(0.05)
    assert figures["approach_rms_m"] == pytest.approx(0.12)
    idle = Made().set("mode", 0.0, 99.0, Phase.IDLE).figures()
    assert idle["hover_rms_m"] is None


def down(phase, place=(0.0, 0.0, 0.0)):
    """A flight that ends on the ground, away from its set point."""
    made = Made().set("mode", 10.0, 99.0, phase)
    ground = np.array([0.9, 0.0, 0.18])
    made.set("position_setpoint", 10.0, 99.0, ground)
    return made.set("position", 11.0, 99.0, ground + place)


@pytest.mark.parametrize(
    ("place", "text"),
    [((100.0, 0.0, 0.0), "100.0 m beside its set point"), ((0.0, 0.0, 2.0), "2.2 m up")],
)
def test_a_vehicle_that_ends_elsewhere_has_not_landed(place, text):
    figures = down(Phase.LANDED, place).figures()
    assert not figures["landed"] and text in figures["ends_elsewhere"]
    assert down(Phase.LANDED).figures()["ends_elsewhere"] is None
    turned = down(Phase.LANDED).tilted(11.0, 99.0, 3.0).figures()
    assert not turned["landed"] and "overturned" in turned["ends_elsewhere"]


def test_the_figures_read_no_column_that_they_do_not_name():
    made = collision()
    made.log = {name: made.log[name] for name in FIGURE_COLUMNS}
    assert made.figures()["peak_contact_force_n"] is not None


@given(st.lists(st.booleans(), max_size=30), st.integers(1, 8))
def test_first_lasting_is_the_first_run_of_that_length(values, length):
    condition = np.array(values, dtype=bool)
    starts = [i for i in range(len(values) - length + 1) if all(values[i : i + length])]
    assert first_sustained(condition, length) == (starts[0] if starts else None)


def test_lowest_point_is_a_leg_level_and_a_motor_on_the_side():
    vehicle = VehicleParams()
    turn = 0.5 * math.pi
    attitude = np.array(
        [[0.0, 0.0, 0.0, 1.0], [math.sin(0.5 * turn), 0.0, 0.0, math.cos(0.5 * turn)]]
    )
    low = lowest_point(vehicle, np.array([[0.0, 0.0, 1.0]] * 2), attitude)
    assert low[0] == pytest.approx(1.0 - vehicle.leg_height)
    assert low[1] == pytest.approx(1.0 - vehicle.arm_length / math.sqrt(2.0))


def test_the_docs_define_every_key_of_the_summary():
    text = (Path(__file__).parents[4] / "docs" / "figures.md").read_text()
    cells = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    defined = re.findall(r"`(\w+)`", " ".join(cells))
    record = fly_scenario(replace(EMPTY, duration=0.2), 0)
    assert sorted(defined) == sorted(flight_summary(record))

"""A scripted PX4 flies the simulator in lockstep: hovers, climbs, turns; then all goes wrong."""

from contextlib import closing

import numpy as np
import pytest
from hil_bench import Bench, bench
from hil_peer import Peer, Pilot

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_flight.scenario import load_scenario, world_of
from tombo_px4.hil.link import HilLink
from tombo_px4.hil.lockstep import PATIENCE_NS, Px4Phase


@pytest.fixture
def b():
    with bench() as made:
        yield made


@pytest.mark.slow
def test_px4_flies_a_minute_in_lockstep_without_a_missed_step(b):
    b.record = True
    b.fly(10.0)
    assert b.peer.pilot.goal == (0.0, 0.0, -2.0)
    b.peer.pilot.goal = (2.0, 0.0, -2.0)  # north: map y
    b.fly(22.0)
    b.peer.pilot.goal = (2.0, 1.5, -3.0)  # east and up: map x and z
    b.fly(36.0)
    b.peer.pilot.heading = 0.0  # from east to north: to the left
    b.fly(48.0)
    b.peer.pilot.heading = -1.0
    b.fly(60.0)
    track = np.array(b.track)
    hil = b.hil

    assert b.peer.gap_us == 4000
    assert (hil.steps, hil.boot_steps) == (15_000, 9)
    assert hil.answered == hil.steps - 9 - 1  # the last one is under way
    assert (hil.missed, hil.wrong_time) == (0, 0)
    assert b.link.counters["garbage_bytes"] == b.link.counters["bad_checksum"] == 0

    def mean(start: float, stop: float) -> np.ndarray:
        return track[(track[:, 0] > start) & (track[:, 0] < stop), 1:].mean(axis=0)

    hover, north, up = mean(7, 10), mean(19, 22), mean(33, 36)
    assert hover[2] == pytest.approx(2.18, abs=0.15)
    assert north - hover == pytest.approx([0.0, 2.0, 0.0, 0.0], abs=0.25)
    assert up - north == pytest.approx([1.5, 0.0, 1.0, 0.0], abs=0.25)
    assert hover[3] == pytest.approx(0.0, abs=0.1)
    assert mean(45, 48)[3] == pytest.approx(np.pi / 2, abs=0.12)
    assert mean(57, 60)[3] == pytest.approx(np.pi / 2 + 1.0, abs=0.12)
    height = track[track[:, 0] > 6.0, 3]
    assert height.min() > 1.9
    assert height.max() < 3.5


@pytest.mark.slow
def test_it_hovers_at_another_rate():
    pilot = Pilot()
    pilot.ALIGN = 400
    with bench(pilot=pilot, rate=1000.0) as b:
        b.fly(8.0)
        assert b.peer.gap_us == 1000
        assert b.hil.missed == 0
        assert b.position[2] == pytest.approx(2.18, abs=0.2)


@pytest.mark.slow
def test_the_propeller_folds_when_px4_hits_the_obstacle_and_flies_on():
    world = world_of(load_scenario("paper_collision", ["obstacle.x=1.2", "obstacle.y=0.27"]))
    with bench(world) as b:
        b.fly(6.0)
        assert b.hil.flight.simulator.plant.contact.touching == 0.0
        b.peer.pilot.goal = (0.0, 2.0, -2.0)
        folds = []
        while b.seconds < 12.0 and max(folds, default=0.0) != 1.0:
            if b.turn():
                folds.append(b.hil.flight.simulator.plant.fold.max())
        assert max(folds) == 1.0
        b.fly(b.seconds + 1.0)
        assert b.hil.missed == 0


# ---- the start


def test_a_silent_start_never_blocks():
    with bench(silent=40) as b:
        b.until(lambda: b.hil.steps >= 38)
        assert b.hil.phase is Px4Phase.BOOTING
        assert b.hil.flight.rotors.max() == 0.0
        b.until(lambda: b.hil.answered >= 100)
        assert b.hil.phase is Px4Phase.FLYING
        assert (b.hil.boot_steps, b.hil.missed) == (40, 0)
        assert any("after 40 steps without" in text for text in b.news)


def test_without_px4_time_stands_still(b):
    b.peer.close()
    b.until(lambda: b.hil.flights == 1 and b.hil.phase is Px4Phase.WAITING)
    for _ in range(100):
        b.now_ns += SECOND_NS
        assert not b.hil.advance(b.now_ns)
    assert b.hil.flight.time_us == 0


def test_before_px4_is_armed_the_rotors_stand_still_whatever_it_says(b):
    b.peer.answer = lambda sensor, values: b.peer.controls(sensor, [0.8] * 4, armed=False)
    b.fly(1.0)
    assert b.hil.flight.rotors.max() == 0.0
    b.peer.answer = lambda sensor, values: b.peer.controls(sensor, [0.8] * 4, armed=True)
    b.fly(1.1)
    assert b.hil.flight.rotors.min() > 500.0
    b.peer.answer = lambda sensor, values: b.peer.controls(sensor, [0.8] * 4, armed=False)
    b.fly(1.2)
    assert b.hil.flight.rotors.max() == 0.0
    assert b.news[-2:] == ["armed", "disarmed"]


# ---- answers that are none


@pytest.mark.slow
def test_an_answer_with_another_time_is_counted_and_not_flown(b):
    b.fly(4.0)
    b.peer.answer = lambda sensor, values: (
        b.peer.controls(sensor, [1.0] * 4, shift_us=-4000)
        + b.peer.controls(sensor, [1.0] * 4, shift_us=4000)
        + b.peer.controls(sensor, values)
    )
    before = b.hil.wrong_time
    b.fly(5.0)
    assert b.hil.wrong_time - before == pytest.approx(500, abs=6)
    assert b.hil.missed == 0
    b.hovers()


# ---- silence, and PX4 gone


@pytest.mark.slow
def test_silence_in_flight_is_reported_after_1_s_and_time_slows_down(b):
    b.fly(5.0)
    kept = b.hush()
    steps = b.hil.steps
    while b.hil.steps == steps:
        b.turn()
    b.now_ns += PATIENCE_NS - SECOND_NS // 10
    assert not b.turn()
    assert b.hil.phase is Px4Phase.FLYING
    for expected in (1, 2, 3):
        b.now_ns += PATIENCE_NS
        assert b.turn()
        b.now_ns += PATIENCE_NS // 2
        assert not b.turn()
        assert b.hil.missed == expected
    assert b.hil.phase is Px4Phase.SILENT
    told = [text for text in b.news if "has not answered for 1 s" in text]
    assert len(told) == 1
    assert told[0].endswith("time stands still but for a step a second")
    assert b.seconds < 5.1

    b.peer.answer = kept
    b.now_ns += PATIENCE_NS
    b.fly(7.0)
    assert b.hil.phase is Px4Phase.FLYING
    assert b.news[-1] == "PX4 answers again"
    b.hovers()


@pytest.mark.slow
def test_a_silent_px4_on_the_ground_gets_its_time_and_comes_back():
    """In OFFBOARD without set points it has no controls to send."""
    with bench(speed=1.0, silent=0, rate=500.0) as b:
        b.peer.pilot.ALIGN = 10**6
        b.fly(0.5)
        kept = b.hush()
        b.now_ns += PATIENCE_NS
        b.until(lambda: b.hil.phase is Px4Phase.SILENT)
        start_ns, start_us = b.now_ns, b.hil.flight.time_us
        b.fly(0.8)
        pace = 1e3 * (b.hil.flight.time_us - start_us) / (b.now_ns - start_ns)
        assert 0.3 < pace < 1.0
        told = [text for text in b.news if "has not answered for 1 s" in text]
        assert len(told) == 1
        assert "disarmed, so time goes on" in told[0]
        assert told[0].endswith("is PX4's IMU_INTEG_RATE 500, as hil.rate?")
        b.peer.answer = kept
        b.until(lambda: b.hil.phase is Px4Phase.FLYING)
        assert b.news[-1] == "PX4 answers again"


@pytest.mark.slow
def test_a_new_connection_begins_a_new_flight_on_the_ground(b):
    b.fly(5.0)
    assert b.position[2] > 1.5
    b.peer.close()
    b.until(lambda: b.hil.phase is Px4Phase.WAITING)
    assert "PX4 has left at 5.0" in b.news[-1]
    assert "armed, 2." in b.news[-1]
    assert "begins a new one" in b.news[-1]

    b.peer = Peer(b.link.port)
    b.until(lambda: b.hil.flights == 2)
    assert b.position[2] < 0.2
    assert b.hil.flight.rotors.max() == 0.0
    b.fly(5.0)
    assert b.peer.gap_us == 4000
    assert (b.hil.boot_steps, b.hil.missed) == (9, 0)
    b.hovers()


# ---- pace


@pytest.mark.slow
@pytest.mark.parametrize("speed", [4.0])
def test_the_pace_is_the_speed(speed):
    with bench(speed=speed, silent=0) as b:
        b.until(lambda: b.hil.steps == 10)
        start_ns, start_us = b.now_ns, b.hil.flight.time_us
        b.fly(2.0)
        simulated = b.hil.flight.time_us - start_us
        assert 1e3 * simulated / (b.now_ns - start_ns) == pytest.approx(speed, rel=0.02)
        assert b.hil.slips == 0


def test_a_busy_port_is_one_line():
    taken = "address already in use"
    with closing(HilLink(0)) as link, pytest.raises(InputError, match=f"{link.port}.*{taken}"):
        HilLink(link.port)


def test_a_bad_rate_is_refused():
    with pytest.raises(InputError, match="accepted: 250, 333, 500 or 1000"):
        Bench(rate=400.0)
    with pytest.raises(InputError, match="out of bounds"):
        Bench(rate=100.0)

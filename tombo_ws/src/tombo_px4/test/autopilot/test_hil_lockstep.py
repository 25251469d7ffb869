"""The simulator in lockstep with a PX4 that answers; then it is silent, late, or gone."""

import pytest
from hil_bench import bench
from hil_peer import Peer

from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.hil.lockstep import PATIENCE_NS, Px4Phase


@pytest.fixture
def b():
    with bench() as made:
        yield made


def test_it_lifts_off_in_lockstep_without_a_missed_step(b):
    b.fly(1.4)
    hil = b.hil
    assert b.height > 0.5
    assert b.peer.gap_us == 4000
    assert (hil.steps, hil.boot_steps) == (350, 9)
    assert (hil.missed, hil.wrong_time) == (0, 0)
    assert b.hil.link.counters["garbage_bytes"] == b.hil.link.counters["bad_checksum"] == 0


def test_without_px4_time_stands_still(b):
    b.peer.close()
    b.until(lambda: b.hil.flights == 1 and b.hil.phase is Px4Phase.WAITING)
    for _ in range(100):
        b.now_ns += SECOND_NS
        assert not b.hil.advance(b.now_ns)
    assert b.hil.flight.time_us == 0


# ---- silence, and PX4 gone


def test_silence_in_flight_is_reported_after_1_s_and_time_slows_down(b):
    b.fly(1.0)
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
    assert b.seconds < 1.1

    b.peer.answer = kept
    b.now_ns += PATIENCE_NS
    b.fly(1.2)
    assert b.hil.phase is Px4Phase.FLYING
    assert b.news[-1] == "PX4 answers again"


@pytest.mark.slow
def test_a_silent_px4_on_the_ground_gets_its_time_and_comes_back():
    """In OFFBOARD without set points it has no controls to send."""
    with bench(speed=1.0, silent=0, align=10**6) as b:
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
        b.peer.answer = kept
        b.until(lambda: b.hil.phase is Px4Phase.FLYING)
        assert b.news[-1] == "PX4 answers again"


def test_a_new_connection_begins_a_new_flight_on_the_ground(b):
    b.fly(1.4)
    assert b.height > 0.5
    b.peer.close()
    b.until(lambda: b.hil.phase is Px4Phase.WAITING)
    assert "PX4 has left at 1.4" in b.news[-1]
    assert "armed, 1." in b.news[-1]
    assert "begins a new one" in b.news[-1]

    b.peer = Peer(b.hil.port)
    b.until(lambda: b.hil.flights == 2)
    assert b.height < 0.2
    assert b.hil.flight.simulator.plant.rotor_speed.max() == 0.0
    b.fly(1.0)
    assert b.peer.gap_us == 4000
    assert (b.hil.boot_steps, b.hil.missed) == (9, 0)

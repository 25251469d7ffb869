"""TIMESYNC between simulated clocks that drift, jump, and talk over ways that are never even."""

import random
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_px4.link.timesync import TimeSync, answer_request

US, MS, S = 1_000, 1_000_000, 1_000_000_000
TODAY = 1_800_000_000 * S


@dataclass
class Clock:
    """A clock that reads `begin_ns` at true time 0 and runs too fast by `drift` parts."""

    begin_ns: int = 0
    drift: float = 0.0

    def at(self, true_ns):
        return self.begin_ns + true_ns + round(self.drift * true_ns)

    def set_by(self, ns):
        self.begin_ns += ns


@dataclass
class Exchange:
    """Requests every 100 ms, with the delays of the link and of the other side [ns]."""

    ours: Clock
    theirs: Clock
    there: object = lambda: 30 * US
    back: object = lambda: 30 * US
    wait: object = lambda: 0
    middle: bool = True
    true_ns: int = 0
    sync: TimeSync = field(default_factory=TimeSync)

    def run(self, number, period_ns=100 * MS):
        """Let a number of requests be answered; return the errors of the offset after each."""
        sync = self.sync
        errors = []
        for _ in range(number):
            _, ts1 = sync.request(self.ours.at(self.true_ns))
            came = self.true_ns + self.there()
            left = came + self.wait()
            now = self.theirs.at(left)
            tc1, ts1 = answer_request(ts1, self.theirs.at(came) if self.middle else now, now)
            arrival = left + self.back()
            sync.reply(tc1, ts1, self.ours.at(arrival))
            errors.append(self.error(arrival))
            self.true_ns += period_ns
        return errors

    def error(self, true_ns):
        return abs(self.sync.to_local_time(self.theirs.at(true_ns)) - self.ours.at(true_ns))


def started(theirs, number, **way):
    """An exchange with a clock after a number of answers, and its synchronisation."""
    exchange = Exchange(Clock(TODAY), theirs, **way)
    exchange.run(number)
    return exchange, exchange.sync


def test_it_has_converged_after_ten_answers():
    assert TimeSync().to_local_time(5) == 5 and not TimeSync().converged
    exchange, sync = started(Clock(), 9)
    assert not sync.converged
    exchange.run(1)
    assert sync.converged


def test_a_request_that_waited_for_a_polled_loop_biases_nothing():
    chance = random.Random(1)
    waits = {"wait": lambda: chance.randrange(4 * MS)}
    middle = Exchange(Clock(TODAY), Clock(), **waits).run(100)
    _, plain = started(Clock(), 1, middle=False, **waits)
    assert max(middle) <= 1 * US
    assert abs(plain.offset_ns - TODAY) > 100 * US  # purpose of the middle


@pytest.mark.slow
@given(
    seed=st.integers(0, 10_000),
    drift=st.floats(-100e-6, 100e-6),
    jitter_there=st.integers(1, 8 * MS),
    jitter_back=st.integers(1, 8 * MS),
    begin=st.integers(1, 10**6),
)
def test_the_error_stays_within_a_millisecond(seed, drift, jitter_there, jitter_back, begin):
    """Jitter is of one-sided kinds, most round trips quick, as on a machine with other work."""
    chance = random.Random(seed)

    def way(jitter):
        return lambda: 20 * US + round(jitter * chance.random() ** 4)

    exchange = Exchange(
        Clock(TODAY), Clock(begin * MS, drift), way(jitter_there), way(jitter_back)
    )
    sync = exchange.sync
    errors = exchange.run(300)
    assert max(errors[20:]) < 1 * MS
    assert sync.converged and sync.jumps == 0


@given(st.integers(0, 10_000), st.integers(11 * MS, 900 * MS), st.sampled_from(["there", "back"]))
def test_a_spike_of_the_round_trip_changes_next_to_nothing(seed, spike, where):
    chance = random.Random(seed)
    exchange, sync = started(Clock(S), 30)
    setattr(exchange, where, lambda: spike if chance.random() < 0.3 else 30 * US)
    assert max(exchange.run(100)) < 20 * US
    assert sync.jumps == 0


@pytest.mark.parametrize("by", [-3600 * S, -50 * MS, 50 * MS, 3600 * S])
@pytest.mark.parametrize("whose", ["ours", "theirs"])
def test_a_jump_of_either_clock_is_noticed_within_four_answers(whose, by):
    exchange, sync = started(Clock(7200 * S), 40)
    getattr(exchange, whose).set_by(by)
    errors = exchange.run(4)
    assert errors[-1] < 10 * US
    assert sync.jumps == 1
    assert sync.converged, "stamps go on"
    exchange.run(40)
    assert sync.jumps == 1 and sync.converged


@pytest.mark.parametrize("rate", [-0.02, 0.02])
def test_a_simulated_clock_that_runs_slower_or_faster_is_followed(rate):
    """It is at most as wrong as it has run away since the answer before."""
    errors = Exchange(Clock(TODAY), Clock(S, rate)).run(300)
    assert max(errors[30:]) < 0.02 * 100 * MS


def test_an_answer_counts_once_and_not_from_before_its_request():
    sync = TimeSync()
    sync.request(100)
    sync.reply(0, 100, 200)
    sync.reply(-5, 100, 200)
    sync.reply(50, 100, 99)
    assert sync.offset_ns is None and sync.refused == 3
    sync.reply(50, 100, 200)
    sync.reply(70, 100, 200)
    assert sync.offset_ns == 100 and sync.refused == 4

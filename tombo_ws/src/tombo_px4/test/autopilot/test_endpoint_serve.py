import select
import time
from types import SimpleNamespace

import pytest
from endpoint_bench import bench, of

from in_time import in_time
from tombo_px4.protocol.endpoint import BootClock, _watch, serve

MS = 1_000_000


class FakeTime:
    """A monotonic clock that jumps ahead by what a test says each time it is read."""

    def __init__(self, step_ns):
        self.now_ns = 5_000 * MS
        self.step_ns = step_ns
        self.reads = 0

    def __call__(self):
        self.now_ns += self.step_ns
        self.reads += 1
        return self.now_ns


def test_boot_time_slips_by_what_the_vehicle_is_too_far_behind():
    clock = BootClock(1_000)
    assert clock.boot_ns(1_000 + 7 * MS) == 7 * MS
    assert not clock.slip(200 * MS)
    assert clock.boot_ns(1_000 + 7 * MS) == 7 * MS
    assert clock.slip(250 * MS)
    assert clock.boot_ns(1_000 + 300 * MS) == 50 * MS
    assert clock.slipped_ns == 250 * MS


@pytest.mark.real_time
def test_simulated_time_follows_the_clock_and_telemetry_comes():
    with bench("onboard", "ground") as b:
        end = time.monotonic() + 1.0
        clock = serve(b.endpoint, time.monotonic_ns, time.time_ns, lambda: time.monotonic() > end)
        simulated_s = b.vehicle.boot_us * 1e-6
        with in_time():
            assert 1.0 - clock.slipped_ns * 1e-9 - 0.1 < simulated_s < 1.05
        b.client.collect()
        assert of(b.client.seen, "HEARTBEAT") and of(b.client.seen, "ATTITUDE")
        assert b.endpoint.telemetry.load >= 0.0


@pytest.mark.real_time
def test_a_request_is_answered_before_the_next_stream_is_due():
    """Sleep ends when something comes: asked often, it answers each within its time."""
    with bench("ground") as b:
        asked, answered = [], []
        end = time.monotonic() + 1.0

        def redraw(boot_ns, clock):
            for m in of(b.client.collect(), "TIMESYNC"):
                if m.tc1:
                    answered.append(m.ts1)
            if len(asked) == len(answered) and time.monotonic() < end - 0.2:
                asked.append(len(asked) + 1)
                b.client.send(b.client.mav.timesync_encode(0, asked[-1]))

        serve(b.endpoint, time.monotonic_ns, time.time_ns, lambda: time.monotonic() > end, redraw)
        with in_time():
            assert answered == asked
            assert len(answered) > 50


def test_a_machine_that_is_too_slow_is_told_and_time_slips(fresh):
    fast = FakeTime(300 * MS)
    clock = serve(fresh.endpoint, fast, time.time_ns, lambda: fast.reads > 40)
    assert clock.slipped_ns > 1_000 * MS
    assert any("too slow" in text for _, text in fresh.endpoint.statustext.sent_texts)
    asked_for_ns = clock.boot_ns(fast.now_ns)
    assert asked_for_ns - fresh.vehicle.tick * MS < 1_000 * MS


def test_it_catches_up_after_a_short_pause_without_slipping(fresh):
    clock = FakeTime(0)
    pause = iter([100 * MS])

    def stop():
        clock.now_ns += next(pause, 0)
        clock.now_ns += MS
        return fresh.vehicle.tick >= 120

    boot = serve(fresh.endpoint, clock, time.time_ns, stop)
    assert boot.slipped_ns == 0
    assert fresh.vehicle.tick >= 120


def test_links_are_watched_for_what_comes_as_they_change():
    """Those of TCP come and go."""
    watched = {}
    poll = SimpleNamespace(register=watched.__setitem__, unregister=watched.pop)
    links = [SimpleNamespace(fileno=lambda: 7), SimpleNamespace(fileno=lambda: 8)]
    endpoint = SimpleNamespace(channels=[SimpleNamespace(link=link) for link in links])
    known = _watch(poll, endpoint, {})
    assert watched == {7: select.POLLIN, 8: select.POLLIN}
    links[1].fileno = lambda: 9
    known = _watch(poll, endpoint, known)
    assert watched == {7: select.POLLIN, 9: select.POLLIN}
    assert _watch(poll, endpoint, known) == known

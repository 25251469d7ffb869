import time

from tombo_px4.protocol.endpoint import serve

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


def test_a_machine_that_is_too_slow_is_told_and_time_slips(fresh):
    fast = FakeTime(300 * MS)
    slipped_ns = serve(fresh.endpoint, fast, time.time_ns, lambda: fast.reads > 40)
    assert slipped_ns > 1_000 * MS
    assert any("too slow" in text for text in fresh.said)

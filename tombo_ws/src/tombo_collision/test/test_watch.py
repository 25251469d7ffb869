"""The watch: samples that a motion capture may deliver, and the stamps of events."""

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pose_bench import flight, watch

from tombo_collision.detector_core import DetectorCore
from tombo_collision.params import DetectorParams
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.messages import CollisionEvent, Pose

EPOCH = 1_763_700_000_123_456_789
LATENCY = 10_000_000
MS = 1_000_000
STRUCK = flight(velocity=(0.7, 0.0, 0.0)).pushed(4.0, (-1.0, -0.4, 0.0))
(EXPECTED,), STATISTIC = watch(STRUCK)


def stamps(poses=STRUCK, epoch=EPOCH):
    return [epoch + round(1e9 * t) for t in poses.t]


@dataclass
class Result:
    """The core's answer to a pose."""

    event: CollisionEvent | None
    statistic: float
    refused: str

    @property
    def contact_ns(self):
        return self.event.contact_stamp_ns


def refused(core):
    """Count the refused poses by their reasons."""
    counts = core.memory.refused
    return Counter({why.key: int(counts[why]) for why in PoseRefusal if counts[why]})


def hand_over(core, stamp_ns, now_ns, frame, position, attitude):
    """Hand a pose to the core."""
    before = refused(core)
    pose = Pose(stamp_ns, frame, np.array(position, float), np.array(attitude, float))
    core.on("/mocap/pose", pose, now_ns)
    published = dict(core.step(now_ns))
    (why,) = (refused(core) - before) or ("",)
    return Result(published.get("/collision_event"), published["/detector/status"].statistic, why)


def counts(core):
    status = core.memory.status
    return int(status["poses"]), int(status["rejected"])


def feed(core, poses=STRUCK, epoch=EPOCH, begin=0, end=None):
    """Feed poses begin:end; return the answers."""
    rows = list(zip(stamps(poses, epoch), poses.position, poses.attitude, strict=True))
    return [hand_over(core, ns, ns + LATENCY, "map", p, q) for ns, p, q in rows[begin:end]]


def with_a_bad_pose(stamp=0, now=0, frame="map", position=None, attitude=None, before=60):
    """The struck flight with one bad pose before sample `before`; (it, all others seen)."""
    core = DetectorCore(DetectorParams())
    results = feed(core, end=before)
    at = stamps()[before - 1] + 10 * MS
    bad = hand_over(
        core,
        at + stamp,
        at + 5 * MS + now,
        frame,
        STRUCK.position[before] if position is None else position,
        STRUCK.attitude[before] if attitude is None else attitude,
    )
    return core, bad, results + feed(core, begin=before)


def test_stamps_of_today_give_what_small_ones_give():
    core = DetectorCore(DetectorParams())
    results = feed(core)
    (detected,) = [(i, s) for i, s in enumerate(results) if s.event is not None]
    index, (event, contact) = detected[0], (detected[1].event, detected[1].contact_ns)
    assert STRUCK.t[index] == EXPECTED.stamp_s
    assert contact == pytest.approx(EPOCH + 1e9 * EXPECTED.contact_time_s, abs=2)
    assert event.stamp_ns == stamps()[index]
    assert event.contact_position == pytest.approx(EXPECTED.x_c, abs=1e-9)
    assert [s.statistic for s in results] == pytest.approx(STATISTIC, rel=1e-6)
    assert counts(core) == (len(STRUCK), 0)


@pytest.mark.parametrize(
    ("reason", "bad"),
    [
        ("wrong_frame", {"frame": "odom"}),
        ("not_finite", {"position": [math.nan, 0.0, 2.0]}),
        ("not_finite", {"attitude": [0.0, 0.0, math.nan, 1.0]}),
        ("not_unit", {"attitude": [0.0, 0.0, 0.0, 0.89]}),
        ("not_unit", {"attitude": [0.0, 0.0, 0.0, 1.11]}),
        ("future", {"now": -11 * MS}),
        ("future", {"stamp": 3600 * 1000 * MS}),
        ("late", {"now": 500 * MS}),
        ("late", {"stamp": -3600 * 1000 * MS}),
        ("out_of_order", {"stamp": -10 * MS}),
        ("out_of_order", {"stamp": -400 * MS}),
        ("jump", {"position": [5.0, 0.0, 2.0]}),
    ],
)
def test_a_bad_pose_is_refused_and_leaves_no_trace(reason, bad):
    core, result, rest_of_flight = with_a_bad_pose(**bad)
    assert (result.refused, result.event, result.statistic) == (reason, None, 0.0)
    assert refused(core) == {reason: 1}
    assert counts(core) == (len(STRUCK) + 1, 1)
    untouched = feed(DetectorCore(DetectorParams()))
    assert [s.statistic for s in rest_of_flight] == [s.statistic for s in untouched]
    assert sum(s.event is not None for s in rest_of_flight) == 1


@pytest.mark.parametrize(
    ("seen", "back"), [*(((0, 60), back) for back in (0.1, 0.3, 1e6)), ((1, 6), 3600.0)]
)
def test_a_clock_set_back_does_not_deafen_it(seen, back):
    """A simulation started again: the watch goes on with the new time at once."""
    core = DetectorCore(DetectorParams())
    feed(core, begin=seen[0], end=seen[1])
    flown = STRUCK.t[seen[1] - 1] - STRUCK.t[0]
    again = feed(core, epoch=EPOCH - round(1e9 * back) - round(1e9 * flown))
    assert not any(s.refused for s in again)
    assert sum(s.event is not None for s in again) == 1


def test_new_parameters_hold_from_the_next_pose_on():
    core = DetectorCore(DetectorParams())
    feed(core, end=100)
    core.set_params("detector", DetectorParams(trigger="none"))
    assert not any(s.event for s in feed(core, begin=100))
    core = DetectorCore(DetectorParams(trigger="none"))
    feed(core, end=80)
    core.set_params("detector", DetectorParams())
    assert sum(s.event is not None for s in feed(core, begin=80)) == 1


anything = st.floats(allow_nan=True, allow_infinity=True)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.integers(-(2**62), 2**62) | st.integers(-(10**9), 10**9),
            st.integers(0, 10**10),
            st.sampled_from(["map", "map", "map", "odom"]),
            st.lists(anything, min_size=3, max_size=3),
            st.lists(anything, min_size=4, max_size=4) | st.just([0.0, 0.0, 0.0, 1.0]),
        ),
        max_size=12,
    )
)
def test_whatever_comes_it_neither_fails_nor_loses_the_strike(rows):
    core = DetectorCore(DetectorParams())
    feed(core, end=40)
    now = stamps()[39]
    for offset, later, frame, position, attitude in rows:
        results = hand_over(
            core, now + offset, now + min(later, 20 * MS), frame, position, attitude
        )
        assert results.event is None
        assert np.isfinite(results.statistic)
    assert [s for s in feed(core, begin=40) if s.event is not None]

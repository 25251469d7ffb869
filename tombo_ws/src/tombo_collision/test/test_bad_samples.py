"""What mocap may deliver: nothing, the same twice, the past, no numbers, either sign."""

import numpy as np
import pytest
from pose_bench import flight, watch

STRUCK = flight(velocity=(0.7, 0.0, 0.0)).pushed(4.0, (-1.0, -0.4, 0.0))
EXPECTED = watch(STRUCK)


@pytest.mark.parametrize(("missing", "restarts"), [(0.2, False), (0.4, True)])
def test_a_long_gap_starts_the_filter_again(missing, restarts):
    """Motion within a gap is not a collision: after it the filter settles first."""
    quiet = flight(8.0, (0.7, 0.0, 0.0))
    moved = quiet.pushed(4.0, (3.0, 0.0, 0.0)).pushed(4.0 + missing, (-3.0, 0.0, 0.0))
    with_gap = moved.without((quiet.t <= 4.0) | (quiet.t > 4.0 + missing))
    events, statistic = watch(with_gap)
    after = with_gap.t > 4.0
    if restarts:
        assert not events
        assert (statistic[after][:8] == 0.0).all()
        assert statistic[after][15:].mean() > 0.2
    else:
        assert len(events) == 1
    # and a strike later on is found
    later = with_gap.pushed(7.0, (-1.5, 0.0, 0.0))
    assert watch(later)[0][-1].stamp_s == pytest.approx(7.0, abs=0.07)


def test_short_dropouts_raise_no_alarm():
    rng = np.random.default_rng(3)
    poses = flight(60.0, (0.4, 0.0, 0.0))
    assert not watch(poses.without(rng.random(len(poses)) > 0.4))[0]

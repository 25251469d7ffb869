"""The compiled normals against numpy's generator."""

from __future__ import annotations

import numpy as np

from tombo_sim.normals import draw_normals, stream_of


def test_normals_are_those_of_numpy_to_the_last_bit() -> None:
    ours, theirs = np.empty((60_000, 9)), np.random.default_rng(7)
    stream = stream_of(theirs)
    for _ in range(2):  # a stream goes on where it was left
        draw_normals(stream, ours)
        expected = theirs.standard_normal(ours.shape)
        assert np.abs(expected).max() > 3.66  # beyond the ziggurat's last layer, too
        assert ours.tobytes() == expected.tobytes()
    assert (stream == stream_of(theirs)).all()

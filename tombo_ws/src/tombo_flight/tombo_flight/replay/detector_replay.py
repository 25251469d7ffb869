"""The detector over a track of poses, as its node would have seen them."""

from __future__ import annotations

import numpy as np

from tombo_collision.detector_core import DetectorCore
from tombo_collision.params import DetectorParams
from tombo_flight.replay.outputs import Event, Outputs, Series
from tombo_flight.replay.poses import PoseTrack


def replay_detector(poses: PoseTrack, params: DetectorParams) -> tuple[Outputs, dict[str, int]]:
    """Feed poses in order of arrival; return what the detector says and what it refused."""
    watch = DetectorCore(params)
    events: list[Event] = []
    stamps: list[int] = []
    statistics: list[float] = []
    for stamp, now, frame, position, attitude in zip(
        poses.stamp_ns.tolist(),
        poses.arrival_ns.tolist(),
        poses.frame.tolist(),
        poses.position,
        poses.attitude,
        strict=True,
    ):
        seen = watch.pose(stamp, now, frame, position, attitude)
        if seen.refused:
            continue
        stamps.append(stamp)
        statistics.append(seen.statistic)
        event = seen.event
        if event is not None:
            events.append(
                Event(
                    stamp,
                    now,
                    event.trigger,
                    tuple(event.x_c.tolist()),
                    seen.contact_ns,
                    event.statistic,
                    tuple(event.flight_direction.tolist()),
                    event.confidence,
                )
            )
    series = Series(np.array(stamps, np.int64), np.array(statistics).reshape(-1, 1))
    return Outputs(events, {"statistic": series}), dict(watch.refused)

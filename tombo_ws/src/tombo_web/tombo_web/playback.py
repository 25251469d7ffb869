"""A flight that is known already, played back as if it happened now."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tombo_bag.flight import Flight, Topic
from tombo_bag.topics import COLLISION_EVENT, CONTACT_EVENT, TOPICS
from tombo_dynamics.errors import InputError
from tombo_web.live_view import TopicMessage

SPEEDS = (0.01, 100.0)
"""Bounds of the speed of playback, recorded time over real time."""
_EVENT_HZ = 5.0
"""Of a topic that is slower every message is passed on, of a faster one the newest."""
_MOST_AT_ONCE = 200


class Playback:
    """Passes the messages of a flight on, as its clock goes."""

    seekable = True

    def __init__(self, flight: Flight, speed: float = 1.0) -> None:
        """Begin where the flight begins.

        Raises:
            InputError: the speed is out of bounds, or the flight holds no message.
        """
        topics = {name: flight.topics[name] for name in flight.topics}
        self._orders = {name: _order(topic) for name, topic in topics.items() if topic}
        self._topics = {name: topics[name] for name, order in self._orders.items() if len(order)}
        if not self._topics:
            raise InputError(f"'{flight.source or flight.name}': no messages to play back")
        self._arrivals = {n: t.arrival[self._orders[n]] for n, t in self._topics.items()}
        self.first_s = min(float(t[0]) for t in self._arrivals.values())
        self.last_s = max(float(t[-1]) for t in self._arrivals.values())
        self._next = dict.fromkeys(self._topics, 0)
        self.now_s = self.first_s
        self.paused = False
        self.contact_s = _contact_s(flight)
        """When the vehicle touched the obstacle, or was first told to have [s]; None: never."""
        self.set_speed(speed)

    def begin(self) -> list[TopicMessage]:
        """Return the messages known at the beginning."""
        return self.seek(self.first_s)

    def set_speed(self, speed: float) -> None:
        """Set the speed, recorded time over real time.

        Raises:
            InputError: it is out of bounds.
        """
        if not SPEEDS[0] <= speed <= SPEEDS[1]:
            raise InputError(f"speed {speed:g}: accepted: {SPEEDS[0]:g} to {SPEEDS[1]:g}")
        self.speed = speed

    def advance(self, elapsed_s: float) -> list[TopicMessage]:
        """Advance by a span of real time [s]; return the messages that have come since."""
        return [] if self.paused else self._until(self.now_s + self.speed * elapsed_s)

    def step(self, flight_s: float) -> list[TopicMessage]:
        """Advance by a span of the flight's time [s], also where it is paused."""
        return self._until(self.now_s + flight_s)

    def seek(self, time_s: float) -> list[TopicMessage]:
        """Go to a time [s]; return the messages known then: the newest message of each topic."""
        self._next = dict.fromkeys(self._topics, 0)
        self.now_s = self.first_s
        return self._until(time_s)

    def _until(self, end_s: float) -> list[TopicMessage]:
        self.now_s = min(max(end_s, self.first_s), self.last_s)
        messages = [m for name in self._topics for m in self._messages(name)]
        return sorted(messages, key=lambda message: message.arrival_s)

    def _messages(self, name: str) -> Iterator[TopicMessage]:
        topic, arrivals = self._topics[name], self._arrivals[name]
        first = self._next[name]
        stop = int(np.searchsorted(arrivals, self.now_s, side="right"))
        self._next[name] = stop
        spec = TOPICS.get(name)
        lasts_s = max(float(arrivals[-1] - arrivals[0]), 1e-9)
        rate_hz = len(arrivals) / lasts_s if spec is None else spec.rate_hz
        first = max(first, stop - (_MOST_AT_ONCE if rate_hz < _EVENT_HZ else 1))
        for i in self._orders[name][first:stop].tolist():
            fields = _fields_at(topic, i)
            yield TopicMessage(name, fields, float(topic.t[i]), float(topic.arrival[i]))


def _contact_s(flight: Flight) -> float | None:
    events = (COLLISION_EVENT.name, CONTACT_EVENT.name)
    told = [float(flight.topics[name].t.min()) for name in events if flight.topics.get(name)]
    return flight.summary.get("collision_time_s") or min(told, default=None)


def _order(topic: Topic) -> NDArray[np.intp]:
    """Return the rows of messages as they came; those without a time are left out."""
    order = np.argsort(topic.arrival, kind="stable")
    return np.asarray(order[np.isfinite(topic.arrival[order])])


def _fields_at(topic: Topic, i: int) -> dict[str, object]:
    """Return the fields of a message; of fields with stamps of their own the last before it."""
    t = topic.t
    fields: dict[str, object] = {}
    for name, series in topic.items():
        k = i if series.t is t else int(np.searchsorted(series.t, t[i], side="right")) - 1
        if k >= 0:
            fields[name] = series.values[k]
    return fields

"""A source of messages and its view, frame by frame, with the requests of a page."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any, Final

from tombo_dynamics.errors import InputError, shown
from tombo_dynamics.params import check_number
from tombo_web.live_view import SCENE, LiveView, TopicMessage

FRAME_HZ: Final = 30.0
_HISTORY_S: Final = 20.0
_KILL_AGAIN_S: Final = 2.0
"""A second request within this time kills."""
_MOST_PICKED: Final = 16
_ANY: Final = (-1e9, 1e9)
"""Bounds of a number that its receiver bounds."""
OPERATOR: Final = ("hold", "land", "kill")


class LiveSession:
    """Makes frames of a source; obeys requests. `docs/live.md` lists their fields.

    A source is a `Playback`, which can be paused, stepped and sought in, or `LiveTopics`.
    """

    def __init__(self, source: Any, title: str, obstacle: Mapping[str, float] | None) -> None:
        self.source = source
        self.recent: deque[dict[str, Any]] = deque(maxlen=round(FRAME_HZ * _HISTORY_S))
        """The last frames, for a page that comes later."""
        self.messages: list[TopicMessage] = []
        """Messages of the last frame."""
        self._title, self._obstacle = title, obstacle
        self._view = LiveView()
        self._picked: dict[str, None] = {}
        self._signals = 0
        self._sought = False
        self._killed_s = -math.inf
        self._take(source.begin())

    def hello(self) -> dict[str, Any]:
        """Return the values that a page needs before the first frame."""
        source = self.source
        return {
            "kind": "hello",
            "title": self._title,
            "columns": [[name, width] for name, (width, _) in SCENE.items()],
            "seekable": source.seekable,
            "operable": hasattr(source, "request"),
            "first_s": source.first_s if source.seekable else None,
            "last_s": source.last_s if source.seekable else None,
            "contact_s": source.contact_s if source.seekable else None,
            "signals": self._view.units(),
            "picked": list(self._picked),
            "frames": list(self.recent),
        }

    def advance(self, elapsed_s: float) -> dict[str, Any]:
        """Advance by a span of real time [s] and return a frame."""
        self._take(self.source.advance(elapsed_s))
        return self._frame()

    def obey(self, request: Mapping[str, Any], now_s: float, *, trusted: bool) -> dict[str, Any]:
        """Do what a page asks for and return the answer.

        Args:
            request: `do` with its `value`.
            now_s: a steady clock [s], for the second press of kill.
            trusted: the page has the token and the right origin.

        Raises:
            InputError: it can't be done; says why.
        """
        name, value = request.get("do"), request.get("value")
        if name == "pick":
            self._pick(value)
            return {"kind": "picked", "picked": list(self._picked)}
        if name in OPERATOR:
            return self._operate(str(name), now_s, trusted)
        if name not in ("pause", "play", "speed", "step", "seek"):
            raise InputError(
                f"request '{name}': accepted: pick, pause, play, speed, step, seek, "
                + ", ".join(OPERATOR)
            )
        source = self.source
        if not source.seekable:
            raise InputError(f"'{name}': accepted for recordings and headless flights only")
        if name in ("pause", "play"):
            source.paused = name == "pause"
        elif name == "speed":
            source.set_speed(check_number("speed", value, "1", _ANY))
        elif name == "step":
            source.paused = True
            self._take(source.step(check_number("step", value, "s", _ANY)))
        else:
            self._seek(check_number("seek", value, "s", _ANY))
        return {"kind": "playing", "paused": source.paused, "speed": source.speed}

    def sought(self) -> bool:
        """Return whether pages begin again: the source was sought in, or flies another flight."""
        sought, self._sought = self._sought, False
        return sought

    def answers(self) -> list[dict[str, Any]]:
        """Return the answers of the nodes to requests of the operator."""
        answers = getattr(self.source, "answers", None)
        return [] if answers is None else answers()

    def _take(self, messages: Iterable[TopicMessage]) -> None:
        self.messages = list(messages)
        for message in self.messages:
            if self._view.begins_again(message):
                self._forget()
                self._sought = True
            self._view.take(message)

    def _frame(self) -> dict[str, Any]:
        source = self.source
        frame = self._view.frame(source.now_s, self._picked)
        frame["kind"] = "frame"
        frame["obstacle"] = getattr(source, "obstacle", None) or self._obstacle
        if vehicles := getattr(source, "vehicles", None):
            frame["vehicles"] = [dict(known) for known in vehicles.values()]
        if source.seekable:
            frame["playing"] = {"paused": source.paused, "speed": source.speed}
        if len(self._view.signals) != self._signals:
            self._signals = len(self._view.signals)
            frame["signals"] = self._view.units()
        self.recent.append(frame)
        return frame

    def _seek(self, time_s: float) -> None:
        """Go to a time; make the frames before it again, for curves and trail."""
        source = self.source
        time_s = min(max(time_s, source.first_s), source.last_s)
        self._forget()
        self._take(source.seek(max(source.first_s, time_s - _HISTORY_S)))
        while source.now_s < time_s:
            self._frame()
            self._take(source.step(min(1.0 / FRAME_HZ, time_s - source.now_s)))
        self._sought = True

    def _forget(self) -> None:
        self._view, self._signals = LiveView(), 0
        self.recent.clear()

    def _pick(self, names: Any) -> None:
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise InputError(f"pick {shown(names)}: accepted: a list of names of signals")
        if len(names) > _MOST_PICKED:
            raise InputError(f"pick: {len(names)} signals; accepted: at most {_MOST_PICKED}")
        unknown = [name for name in names if name not in self._view.signals]
        if unknown:
            raise InputError(f"pick '{unknown[0]}': no such signal has come")
        self._picked = dict.fromkeys(names)

    def _operate(self, name: str, now_s: float, trusted: bool) -> dict[str, Any]:
        if not trusted:
            raise InputError(f"'{name}': accepted from the page that `tombo live` has printed")
        if not hasattr(self.source, "request"):
            raise InputError(f"'{name}': accepted for a running suite only")
        if name == "kill" and now_s - self._killed_s > _KILL_AGAIN_S:
            self._killed_s = now_s
            return {"kind": "answer", "request": name, "success": False,
                    "message": f"press again within {_KILL_AGAIN_S:g} s: rotors off"}  # fmt: skip
        self._killed_s = -math.inf
        self.source.request(name)
        return {"kind": "answer", "request": name, "success": None, "message": "sent"}

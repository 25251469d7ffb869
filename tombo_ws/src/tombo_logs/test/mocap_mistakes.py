"""Mistakes of a motion capture, made in a flight: name of the finding → the flight with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Flight, Series

Change = Callable[[Series], Series]


def _changed(
    log: Flight, position: Change | None = None, attitude: Change | None = None
) -> Flight:
    series = dict(log.series)
    for name, change in (("position", position), ("attitude", attitude)):
        if change is not None:
            series[name] = change(series[name])
    return log.with_series(series)


def _with_turn(turn: Callable[[Rotation], Rotation]) -> Change:
    return lambda s: replace(s, values=turn(Rotation.from_quat(s.values)).as_quat())


def _y_up(log: Flight) -> Flight:
    turn = Rotation.from_euler("x", -90.0, degrees=True)
    return _changed(
        log,
        lambda s: replace(s, values=turn.apply(s.values)),
        _with_turn(lambda q: turn * q * turn.inv()),
    )


def _body_turned(degrees: float) -> Callable[[Flight], Flight]:
    turn = Rotation.from_euler("z", degrees, degrees=True)
    return lambda log: _changed(log, attitude=_with_turn(lambda q: q * turn))


def _another_body(log: Flight) -> Flight:
    rng = np.random.default_rng(1)

    def lies(s: Series) -> Series:
        return replace(s, values=[1.0, 2.0, 0.3] + 2e-4 * rng.standard_normal(s.values.shape))

    def level(s: Series) -> Series:
        noise = Rotation.from_rotvec(2e-3 * rng.standard_normal((len(s.t), 3)))
        return replace(s, values=noise.as_quat())

    return _changed(log, lies, level)


def _swapped(log: Flight) -> Flight:
    def swap(s: Series) -> Series:
        values = s.values.copy()
        rows = slice(int(0.4 * len(values)), int(0.42 * len(values)))
        turn = Rotation.from_euler("z", 90.0, degrees=True)
        values[rows] = (Rotation.from_quat(values[rows]) * turn).as_quat()
        return replace(s, values=values)

    return _changed(log, attitude=swap)


def _restamped(stamp: Callable[[np.ndarray], np.ndarray]) -> Callable[[Flight], Flight]:
    def change(s: Series) -> Series:
        return Series(stamp(s.t), s.values)

    return lambda log: _changed(log, change, change)


def _by_arrival(t: np.ndarray) -> np.ndarray:
    late = 0.012 + np.random.default_rng(2).exponential(0.006, t.shape)
    return np.maximum.accumulate(t + late) + 1e-7 * np.arange(t.size)


def _kept(keep: Callable[[np.ndarray], np.ndarray]) -> Callable[[Flight], Flight]:
    def change(s: Series) -> Series:
        return Series(s.t[keep(s.t)], s.values[keep(s.t)])

    return lambda log: _changed(log, change, change)


def _eight_a_second(t: np.ndarray) -> np.ndarray:
    return np.arange(t.size) % max(round(0.125 / float(np.median(np.diff(t)))), 1) == 0


def _with_gaps(t: np.ndarray) -> np.ndarray:
    share = (t - t[0]) / (t[-1] - t[0])
    begins = np.array([0.35, 0.5, 0.65])
    length = 0.5 / (t[-1] - t[0])
    return ~((share[:, None] > begins) & (share[:, None] < begins + length)).any(axis=1)


def _frozen(log: Flight) -> Flight:
    def freeze(s: Series) -> Series:
        values = s.values.copy()
        begin = s.t[0] + 0.45 * (s.t[-1] - s.t[0])
        rows = (s.t > begin) & (s.t < begin + 1.0)
        values[rows] = values[np.argmax(rows)]
        return replace(s, values=values)

    return _changed(log, freeze, freeze)


MISTAKES: dict[str, tuple[str, Callable[[Flight], Flight]]] = {
    "y up": ("up_axis", _y_up),
    "body turned by 90 deg": ("body_turned", _body_turned(90.0)),
    "body turned by 180 deg": ("body_turned", _body_turned(180.0)),
    "millimetres": (
        "millimetres",
        lambda log: _changed(log, lambda s: replace(s, values=1e3 * s.values)),
    ),
    "another body": ("does_not_move", _another_body),
    "markers swapped": ("markers_swapped", _swapped),
    "stamps of arrival": ("arrival_stamps", _restamped(_by_arrival)),
    "clock ahead": ("clock", _restamped(lambda t: t + 0.15)),
    "8 Hz": ("rate", _kept(_eight_a_second)),
    "gaps": ("gaps", _kept(_with_gaps)),
    "frozen": ("frozen", _frozen),
}

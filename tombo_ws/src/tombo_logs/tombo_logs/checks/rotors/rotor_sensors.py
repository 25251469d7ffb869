"""Each rotor's speed against its own command and the other rotors: faults of one sensor."""

from __future__ import annotations

import numpy as np

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ROTOR_NAMES
from tombo_logs.checks.spans import Mask, interpolated, runs, sample_interval

_NOTHING, _TURNS = 0.1, 0.5
"""Share of a rotor's usual speed below which it reads nothing, and above which it turns: a rotor
that reads nothing while most others turn has a sensor that fails; all four stand on the ground."""
_ZEROS = 0.003
"""Share of samples that read nothing from which on it is reported."""
_MAX_ZERO_SHARE, _MAX_ZERO_SHARE_REPLACED = 0.3, 0.03
"""Up to this share of zeros the samples are left out: without a command, and with a command that
could replace them."""
_STUCK_S = 0.25
"""s for which a rotor's reading may stay the same while the others change."""
_OFF_COMMAND = 0.07
"""Share by which the ratio of speed to command may differ between rotors: several times what
sound speed controllers leave."""
_OFF_PEERS = (0.75, 1.33)
"""Ratio of a rotor's speed to the other rotors' where no command is known: a centre of gravity
2 cm off, or a propeller that lost a third of its thrust, stays within."""


def sensor_faults(
    flight: str, speed: Series, command: Series | None, flying: Mask, replaced: bool
) -> tuple[Series | None, list[Finding]]:
    """Return the speeds that can be used, None for none, and the faults of single sensors.

    Args:
        flight: name.
        speed: measured.
        command: rotor speeds that were asked for.
        flying: (N,) rows of `speed` in flight.
        replaced: another channel shows the rotors.
    """
    if np.count_nonzero(flying) < 50:
        return speed, []
    values = speed.values[flying]
    zeros = lone_zeros(values, _usual(values))
    faults = [*_zeros(values, zeros), *_stuck(speed.t[flying], values, zeros)]
    faults += _scales(speed, command, flying, zeros)
    if not faults:
        return speed, []
    few = all(key == "zeros" for key, *_ in faults)
    few &= float(zeros.any(axis=1).mean()) < (
        _MAX_ZERO_SHARE_REPLACED if replaced else _MAX_ZERO_SHARE
    )
    kept = None
    if few:
        rows = ~(flying & lone_zeros(speed.values, _usual(values)).any(axis=1))
        kept = Series(speed.t[rows], speed.values[rows])
    remedy = "those samples are left out" if few else "rotor_speed is left out"
    severity = "warning" if few else "fault"
    return kept, [
        Finding(
            "rpm", severity, flight, f"rotor_speed: {name} {text}; {remedy}",
            channel="rotor_speed", key=key, subject=name, numbers=(number,),
        )
        for key, name, number, text in faults
    ]  # fmt: skip


def _usual(values: Array) -> float:
    """Return the speed at which the rotors usually turn [rad/s]."""
    return float(np.median(np.percentile(values, 80.0, axis=0)))


def lone_zeros(values: Array, usual: float) -> Mask:
    """Return where (N, 4) a rotor reads nothing while most of the others turn."""
    others = np.column_stack([np.median(np.delete(values, k, axis=1), axis=1) for k in range(4)])
    return np.asarray((values < _NOTHING * usual) & (others > _TURNS * usual))


Fault = tuple[str, str, float, str]
"""Key of the mistake, rotor, size, observation."""


def _zeros(values: Array, zeros: Mask) -> list[Fault]:
    return [
        (
            "zeros", name, float(share),
            f"reads 0 in {100 * share:.3g} % of the samples in flight; expected: about "
            f"{_usual(values):.0f} rad/s, as the others",
        )
        for name, share in zip(ROTOR_NAMES, zeros.mean(axis=0), strict=True)
        if share > _ZEROS
    ]  # fmt: skip


def _stuck(t: Array, values: Array, zeros: Mask) -> list[Fault]:
    """Report rotors whose readings stay the same while the others' change."""
    same, step = np.diff(values, axis=0) == 0.0, sample_interval(t)
    faults: list[Fault] = []
    for i, name in enumerate(ROTOR_NAMES):
        alone = same[:, i] & ~zeros[1:, i]
        moving = np.asarray(~np.delete(same, i, axis=1).all(axis=1))
        stuck = [
            (b, e)
            for b, e in runs(alone)
            if (e - b) * step > _STUCK_S and moving[b:e].mean() > 0.5
        ]
        if stuck:
            begin, end = max(stuck, key=lambda run: run[1] - run[0])
            text = (
                f"is stuck {len(stuck)} times while the others change, for "
                f"{(end - begin) * step:.2f} s from {t[begin]:.2f} s on"
            )
            faults.append(("stuck", name, (end - begin) * step, text))
    return faults


def _scales(speed: Series, command: Series | None, flying: Mask, zeros: Mask) -> list[Fault]:
    """Report rotors whose scale differs from that of the others."""
    if command is not None and command.t.size > 10:
        covered = (speed.t[flying] >= command.t[0]) & (speed.t[flying] <= command.t[-1])
        asked = interpolated(speed.t[flying], command.t, command.values)
        against, low, high = "its command", 1.0 - _OFF_COMMAND, 1.0 + _OFF_COMMAND
    else:
        covered = np.ones(np.count_nonzero(flying), np.bool_)
        asked = np.ones((covered.size, 4))
        against, (low, high) = "the speed expected", _OFF_PEERS
    ratio = np.full(4, np.nan)
    for i in range(4):
        rows = covered & ~zeros[:, i] & (asked[:, i] > 0.0)
        if np.count_nonzero(rows) >= 50:
            ratio[i] = np.median(speed.values[flying][rows, i] / asked[rows, i])
    if np.isfinite(ratio).sum() < 3:
        return []
    faults: list[Fault] = []
    for i, name in enumerate(ROTOR_NAMES):
        relative = ratio[i] / np.nanmedian(np.delete(ratio, i))
        if not low <= relative <= high and np.isfinite(relative):
            mean_speed = f"{speed.values[flying][:, i].mean():.0f} rad/s on average"
            text = (
                f"reads {relative:.3g} times {against}, measured by the other rotors "
                f"({mean_speed}): its sensor's scale"
            )
            faults.append(("scale", name, float(relative), text))
    return faults

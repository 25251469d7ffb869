"""Motor commands and rotor speeds: saturation, range, scale, and whose vehicle they carry.

Each rotor's speed is compared with its own command and with the other rotors: faults of single
sensors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_bag.flight import Finding, RefusedLog, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust
from tombo_dynamics.vehicle import GRAVITY, ROTOR_NAMES, VehicleParams
from tombo_logs.checks.ground import CUT_BEFORE_TAKE_OFF
from tombo_logs.checks.spans import Mask, interpolated, runs, sample_interval
from tombo_logs.readers.units import guess

_SCALES = (0.65, 1.5)
"""Measured over commanded speed, all rotors alike: a battery takes a fifth, a rough map of the
controllers as much; a factor of 2 is counted pulses."""
_SATURATED = 0.01
"""Share of the flight at a limit that is reported."""
_MASS_RATIO = (0.6, 1.65)
"""Mass that the rotors' speeds lift over the model's: no error of mass and thrust together that
the diagnosis knows goes beyond."""
_STANDING = 0.45
"""Rotor speed over that of the model's hover below which rotors carry no vehicle, whatever it
weighs: they idle or stand."""
_LEAST = 50
_ROTOR_SCALE = 1.18
"""Ratio of one rotor's command to the mean of the others: a centre of gravity off the middle, and
the scatter of small motors, stay within."""
_FEWEST = 100
"""Commands that are compared at least."""
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


def saturation(flight: str, channel: str, command: Series, flying: Mask) -> list[Finding]:
    """Report how long each motor was at its upper limit."""
    values = command.values[flying]
    if len(values) < _LEAST:
        return []
    top = 1.0 if channel == "motor_command" else float(values.max())
    at = values >= top - 1e-4 * max(abs(top), 1e-9)
    if channel != "motor_command" and np.count_nonzero(at) < 20:
        return []  # a largest value is a limit only if it repeats
    shares = at.mean(axis=0)
    if shares.max() < _SATURATED:
        return []
    motors = ", ".join(
        f"{name} {100 * s:.0f} %" for name, s in zip(ROTOR_NAMES, shares, strict=True) if s > 0.002
    )
    text = (
        f"{channel}: at its upper limit for a part of the flight ({motors}); thrust does not "
        "follow the controller there"
    )
    return [Finding("saturation", "warning", flight, text, channel=channel)]


def rotor_scales(flight: str, channel: str, command: Series, flying: Mask) -> list[Finding]:
    """Report a rotor that is asked for much more or less than the others."""
    values = command.values[flying]
    if len(values) < _FEWEST or channel == "rotor_speed":
        return []
    if channel == "rotor_command":
        values = values**2
    usual = np.maximum(np.median(values, axis=0), 1e-9)
    ratio = np.array([usual[k] / np.delete(usual, k).mean() for k in range(4)])
    k = int(np.argmax(np.abs(np.log(ratio))))
    if not (ratio[k] > _ROTOR_SCALE or ratio[k] < 1.0 / _ROTOR_SCALE):
        return []
    text = (
        f"{channel}: {ROTOR_NAMES[k]} is asked for {ratio[k]:.2f} times the others' thrust; "
        "expected: about 1; the scale of its column, another propeller or motor there, or weight "
        "beside the centre"
    )
    return [Finding("scale", "warning", flight, text, channel=channel)]


def range_of(flight: str, command: Series, flying: Mask) -> list[Finding]:
    """Report when a motor command is not between 0 and 1 in flight."""
    values = command.values[flying]
    if not len(values):
        return []
    low, high = float(np.min(values)), float(np.max(values))
    if low > -0.02 and high < 1.02:
        return []
    text = (
        f"motor_command: values from {low:.3g} to {high:.3g}; expected: 0 to 1 (in a mapping: "
        "range); left out"
    )
    return [Finding("unit", "fault", flight, text, channel="motor_command")]


def speed_against_command(
    flight: str, speed: Series, command: Series, flying: Mask
) -> list[Finding]:
    """Report when measured rotor speeds contradict the command; `flying`: rows (N,) of `speed`."""
    rows = flying & (speed.t >= command.t[0]) & (speed.t <= command.t[-1])
    if np.count_nonzero(rows) < _LEAST:
        return []
    asked = interpolated(speed.t[rows], command.t, command.values)
    got = speed.values[rows]
    usual = np.median(asked, axis=0)
    ratio = np.median(got, axis=0) / np.maximum(usual, 1e-9)
    findings = []
    middle = float(np.median(ratio))
    if not _SCALES[0] < middle < _SCALES[1]:
        why = guess(middle, "turning", "rotor")
        text = f"{middle:.3g} times what is asked for; expected: about 1{why}; left out"
        return [_rpm(flight, "fault", text)]
    if not 0.8 < middle < 1.25:
        text = f"{middle:.2f} times what is asked for; expected: about 1"
        findings.append(_rpm(flight, "warning", text))
    return findings


def _rpm(flight: str, severity: str, text: str) -> Finding:
    return Finding("rpm", severity, flight, f"rotor_speed: {text}", channel="rotor_speed")


@dataclass(frozen=True)
class Hover:
    """How the model's vehicle hovers."""

    label: str
    mass: float
    """[kg]"""
    rotor_speed: float
    """of each rotor [rad/s]."""


def hover_of(label: str, vehicle: VehicleParams, maps: RotorMaps) -> Hover:
    """Return how a vehicle with these rotors hovers."""
    speed = speed_for_thrust(maps, 0.25 * vehicle.mass * GRAVITY)
    return Hover(label, vehicle.mass, float(speed))


def check_vehicle(
    flight: str, drives: dict[str, tuple[Series, Mask]], hover: Hover, rises: bool
) -> list[Finding]:
    """Report drives that can't be those of the model's vehicle while another one can.

    Over a whole flight the mean specific force is that of gravity.

    Args:
        flight: its name.
        drives: channel -> rotor speeds [rad/s], and which rows count.
        hover: of the model's vehicle.
        rises: whether the track leaves the ground (`ground.rises`).

    Raises:
        RefusedLog: none of them can: it does not fly, or another vehicle, or another unit.
    """
    speeds = {
        name: float(np.sqrt(np.median(np.mean(series.values[flying] ** 2, axis=1))))
        for name, (series, flying) in drives.items()
        if np.count_nonzero(flying) >= _LEAST
    }
    low, high = _MASS_RATIO
    texts = {
        name: f"{name}: with the propellers of the model ({hover.label}) such speeds carry "
        f"{hover.mass * ratio**2:.2g} kg in flight, not {hover.mass:.2g} kg; it hovers at "
        f"{hover.rotor_speed:.0f} rad/s, here at {speed:.0f}{guess(ratio, 'turning')}"
        for name, speed in speeds.items()
        if not low <= (ratio := speed / hover.rotor_speed) ** 2 <= high
    }
    if texts and len(texts) == len(speeds):
        name, text = next(iter(texts.items()))
        why = (
            "is this another vehicle than the model's? Accepted: flights of the model's vehicle, "
            "or a log that says its airframe"
        )
        if not rises and max(speeds.values()) < _STANDING * hover.rotor_speed:
            why = f"it does not fly: z stays where it is; {CUT_BEFORE_TAKE_OFF}"
        raise RefusedLog(flight, name, f"{text}; {why}")
    return [
        Finding("vehicle", "fault", flight, f"{text}; left out", channel=name)
        for name, text in texts.items()
    ]


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
    if np.count_nonzero(flying) < _LEAST:
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
        if np.count_nonzero(rows) >= _LEAST:
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

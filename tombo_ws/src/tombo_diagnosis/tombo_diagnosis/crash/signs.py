"""Signs that something went wrong: each with its time, its kind, and a text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d, uniform_filter1d
from scipy.signal import butter, find_peaks, sosfiltfilt

from tombo_diagnosis.control.oscillation import BEYOND, SWING_HZ, SWING_RAD_S
from tombo_diagnosis.crash.motion import RATE, UPSET_TILT_RAD, CrashMotion
from tombo_diagnosis.rotor_demand import MODES
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY, ROTOR_NAMES
from tombo_logs.checks.clocks.stamps import gap_spans
from tombo_logs.checks.spans import Mask, interpolated, runs, sample_interval

IntArray = NDArray[np.int64]
OFF: Final = 0.15
"""Demand over hover's below which drives are off."""
_OFF_S: Final = 0.06
_STOPPED: Final = 0.8
"""Speed of a rotor over the least that was asked for lately."""
_LATELY_S: Final = 0.25
_LASTS_S: Final = 0.08
"""Time for which a force or a rotor must differ from its set point."""
_OPPOSED_COSINE: Final = 0.7
"""Cosine between turning and the moment asked for, reversed, from which on they disagree."""
_DIAGONAL: Final = 0.3
"""Least over largest of roll and pitch when it turns about a diagonal."""
_TURN_RATE_RAD_S: Final = 0.5
"""rad/s within _LASTS_S."""
_MOMENT: Final = 0.02
"""Part of hover's thrust that is asked for as roll and pitch."""
_FAR_MORE: Final = 1.8
"""Demand of a rotor over that of the others."""
_THRUST_MISSING: Final = -0.03
"""Thrust beyond what is asked for, over hover's, where a rotor gives none."""
_LAG_S: Final = 0.12
"""s by which thrust may follow the drives at most."""
_CONTACT_M_S2: Final = 4.0
"""m/s^2 by which a touch changes the force at least."""
_SPREAD: Final = 4
"""Rows by which a push is seen early and late in smoothed rates."""
_CONTACT_M_S: Final = 0.3
"""m/s that a touch changes the velocity at least, seen in poses alone."""
_LANDING_CUT_M: Final = 0.4
"""m above the floor below which motors are stopped to land."""
_HARD_TOUCH_M_S: Final = 1.2
"""m/s downwards at the floor: no landing."""
_SLIDES_S: Final = 1.2
_SLIDE_HEIGHT_STD_M: Final = 0.0004
_SLIDE_PLACE_STD_M: Final = 0.0012
"""m: standard deviations of height and of place over that time when it slides along something."""
_OFF_GROUND: Final = 0.01
"""m above where it stood."""
_CEILING_BAND_M: Final = 0.004
"""m below the highest place of the flight: it slides along a surface above it."""
_REST_S: Final = 0.5
_REST_BAND_M: Final = 0.002
"""m about the height at which it rests at the end: a lean of 3 degrees with arms of 46 mm."""
_RISE_M: Final = 0.004
"""m by which it comes down to that height, and leaves it again."""
_FREE_S: Final = 1.0
"""Time before without the ground, and the longest stay on it: longer is a landing."""
_SWING_ASKED: Final = 0.3
"""Standard deviation of commands that swing, over hover's thrust, at least."""
_GROWS: Final = 4.0
"""Times its usual size."""
_CYCLES: Final = 2
_UNEVEN: Final = 0.35
"""Standard deviation of half a period, over its mean."""
_GAP_S: Final = 0.3
"""Poses that are absent or repeated for longer are lost."""
_POSITION_JUMP_M: Final = 0.25
"""m between two poses beyond what the velocity gives."""
_SAG: Final = 0.04
"""Share of the voltage below the line that it followed."""
_THRUST_DROP: Final = 0.12
"""Share of thrust that all rotors lack."""
_COMMAND_STEP_RATIO: Final = 6.0
"""Times its usual size that a command changes."""


@dataclass(frozen=True)
class Sign:
    """One sign."""

    time: float
    """[s]"""
    kind: str
    """motor (its speed), rotor (its missing thrust), contact, oscillation, position, battery,
    command, kill, off (rotors stopped for an unknown reason), bump, turns; upset, fall and
    impact show that the flight went wrong."""
    text: str
    size: float = 0.0
    """Of lost poses s, of a supply the share that it lost."""


def signs(motion: CrashMotion) -> list[Sign]:
    """Return all signs of a flight, in order of time."""
    each = (
        _drives_off, _rotor_behind, _rotor_lost, _touches, _bumps, _slides, _grounds, _swings,
        _poses_lost, _poses_leap, _supply_falls, _thrust_lacks, _command_leaps, _upsets,
        _falls, _impacts,
    )  # fmt: skip
    return sorted((s for look in each for s in look(motion)), key=lambda s: s.time)


def _first(motion: CrashMotion, mask: Mask, least_s: float) -> int | None:
    """Return the first row of the first run in the air that lasts."""
    for begin, end in runs(mask & motion.flying):
        if end - begin >= least_s * RATE:
            return begin
    return None


def _drives_off(m: CrashMotion) -> Iterator[Sign]:
    """All drives at once, in the air."""
    if not np.isfinite(m.demand).any():
        return
    level = np.nan_to_num(m.demand, nan=9.9).max(axis=1)
    floor = float(np.nanmin(m.height))
    for begin, end in runs(level < OFF):
        before = slice(max(begin - 30, 0), max(begin - 5, 1))
        stops = end - begin >= _OFF_S * RATE and np.nanmean(level[before]) > 0.5
        returns = np.nanmax(level[end:], initial=0.0) > 2.0 * OFF  # as of a controller at a limit
        lands = m.height[begin] < floor + _LANDING_CUT_M
        if stops and not returns and not lands:
            kind, text = _why_off(m, float(m.t[begin]))
            yield Sign(float(m.t[_since(level < 0.6, begin, 15)]), kind, text)
            return


def _why_off(m: CrashMotion, begin: float) -> tuple[str, str]:
    """Return kind and text of rotors that stop at a time [s]: commands may go on."""
    asked = next((m.series[n] for n in ("rotor_command", "motor_command") if n in m.series), None)
    if asked is None:
        return "off", "all rotors stop in the air, at once"
    late = (asked.t > begin + 0.02) & (asked.t < begin + 0.2)
    usual = float(np.median(asked.values[asked.t <= begin - 0.1]))
    if late.any() and float(np.median(asked.values[late])) > 0.3 * usual:
        return "battery", "all rotors stop while they are asked to turn: no power"
    return "kill", "all motors are commanded off in the air, at once"


def _since(mask: Mask, row: int, most: int) -> int:
    """Return the first row of the run of a mask that ends before a row, `most` rows at most."""
    first = max(row - most, 0)
    off = np.flatnonzero(~mask[first:row])
    return first + (int(off[-1]) + 1 if off.size else 0)


def _rotor_behind(m: CrashMotion) -> Iterator[Sign]:
    """One measured rotor speed that stays behind its command."""
    speed, command = m.series.get("rotor_speed"), m.series.get("rotor_command")
    if speed is None or command is None:
        return
    got = interpolated(m.t, speed.t, speed.values)
    asked = interpolated(m.t, command.t, command.values)
    width = round(_LATELY_S * RATE)
    least, _ = _lately(asked, width)
    ratio = got / np.maximum(least, 1e-6)
    usual = np.nanpercentile(ratio[m.learnt], 5.0, axis=0)
    behind = (ratio < _STOPPED * np.minimum(usual, 1.0)) & (least > 0.2 * np.median(asked))
    for k in range(4):
        others = np.delete(behind, k, axis=1)
        row = _first(m, behind[:, k] & ~others.all(axis=1), _LASTS_S)
        if row is not None:
            # it began to fall when it left the others
            share = got[:, k] / np.maximum(np.delete(got, k, axis=1).mean(axis=1), 1e-6)
            start = _since(share < float(np.nanpercentile(share[m.learnt], 2.0)), row, 15)
            text = f"{ROTOR_NAMES[k]} turns slower than it is asked to, the others do not"
            yield Sign(float(m.t[start]), "motor", text)
            return


def _lately(values: Array, width: int) -> tuple[Array, Array]:
    """Return the least and the largest of each row (N, ...) and of the `width` rows before it."""
    size, origin = width + 1, width // 2  # the window ends with the row
    least, largest = (
        extreme(values, size, axis=0, mode="nearest", origin=origin)
        for extreme in (minimum_filter1d, maximum_filter1d)
    )
    return np.asarray(least), np.asarray(largest)


def _rotor_lost(m: CrashMotion) -> Iterator[Sign]:
    """The vehicle turns towards one rotor although the drives turn it away, and thrust lacks."""
    if not np.isfinite(m.demand).any() or not np.isfinite(m.rates).any():
        return
    width = round(_LASTS_S * RATE)
    moment = np.nan_to_num(m.demand) @ MODES[1:3].T
    moment -= np.median(moment[m.learnt], axis=0)
    asked = uniform_filter1d(moment, width, axis=0, origin=width // 2 - 1)
    turned = np.zeros_like(asked)
    rates = np.nan_to_num(m.rates[:, :2])
    turned[width:] = rates[width:] - rates[:-width]
    size, push = (np.linalg.norm(x, axis=1) for x in (turned, asked))
    usual, weak = (float(np.percentile(x[m.learnt], 99.5)) for x in (size, push))
    against = -np.einsum("ni,ni->n", turned, asked) > _OPPOSED_COSINE * size * push
    both = np.abs(turned).min(axis=1) > _DIAGONAL * np.abs(turned).max(axis=1)
    towards = np.argmin(turned @ MODES[1:3], axis=1)
    helps = np.nan_to_num(m.demand)[np.arange(m.t.size), towards] > 1.05
    lacks = (
        uniform_filter1d(np.nan_to_num(m.missing, nan=-1.0), width, origin=-(width // 2))
        < _THRUST_MISSING
    )
    lost = against & both & helps & lacks & (push > max(_MOMENT, 1.5 * weak))
    lost &= size > max(_TURN_RATE_RAD_S, 2.0 * usual)
    lost |= _compensated(m, towards) & lacks
    lost &= (np.nan_to_num(m.tilt) < UPSET_TILT_RAD) & ~_turned_by_push(m, width)
    for begin, end in runs(lost & m.flying):
        if end - begin < _OFF_S * RATE or np.ptp(towards[begin:end]) > 0:
            continue
        row = _since(size > min(usual, 0.5 * _TURN_RATE_RAD_S), begin, 3 * width)
        name = ROTOR_NAMES[int(towards[begin])]
        text = f"it turns down at {name} although that rotor is asked for more"
        yield Sign(float(m.t[row]), "rotor", text)
        return


def _compensated(m: CrashMotion, rotor: IntArray) -> Mask:
    """Return where one rotor is asked for far more against the others than it ever was."""
    rows = np.arange(m.t.size)
    demand = np.nan_to_num(m.demand)
    others = (demand.sum(axis=1) - demand[rows, rotor]) / 3.0
    share = demand[rows, rotor] / np.maximum(others, 0.2)
    return np.asarray(share > max(_FAR_MORE, 1.5 * float(np.percentile(share[m.learnt], 99.5))))


def _pushes(m: CrashMotion) -> tuple[Array, float]:
    """Return force on the accelerometer that neither drives nor vibration explain, and its limit.

    The force (N,) is a size [m/s^2]; 0: no accelerometer.
    """
    if "accel" not in m.series:
        return np.zeros(m.t.size), np.inf
    force = m.force.copy()
    if np.isfinite(m.missing).any():
        # a recent set point explains it, at any lag
        asked = np.nan_to_num(m.demand).mean(axis=1)
        width = round(_LAG_S * RATE)
        lift = float(np.nanmedian(m.force[m.learnt, 2]))
        given = force[:, 2] / lift
        force[:, 2] = lift * (given - np.clip(given, *_lately(asked, width)))
    force = np.nan_to_num(force)
    fast = force - np.column_stack([median_filter(f, 41, mode="nearest") for f in force.T])
    usual = np.nanpercentile(np.linalg.norm(fast[m.learnt], axis=1), 99.5)
    return np.linalg.norm(fast, axis=1), max(_CONTACT_M_S2, 2.5 * float(usual))


def _turned_by_push(m: CrashMotion, width: int) -> Mask:
    """Return where the turn of the last `width` rows may be that of a push: it ends with it."""
    size, limit = _pushes(m)
    turned: Mask = np.zeros(m.t.size, np.bool_)
    for begin, end in runs(size > limit):
        # the filter spreads it
        turned[max(begin - _SPREAD, 0) : min(end, begin + width) + width + _SPREAD] = True
    return turned


def _touches(m: CrashMotion) -> Iterator[Sign]:
    """A push on the accelerometer that neither the drives nor the usual vibration explain."""
    size, limit = _pushes(m)
    for begin, end in runs((size > limit) & m.flying)[:3]:
        peak = begin + int(np.argmax(size[begin:end]))
        row = _since(size > 0.3 * limit, begin, 6)
        text = f"a push of {size[peak]:.0f} m/s² that the drives do not explain"
        yield Sign(float(m.t[row]), _where(m, begin), text)


def _where(m: CrashMotion, row: int) -> str:
    """Return impact for the floor, else contact."""
    low = m.height[row] < float(np.nanmin(m.height)) + 0.15
    fell = float(np.min(m.speed[max(row - 20, 0) : row + 1, 2]))
    return "impact" if low and fell < -_HARD_TOUCH_M_S else "contact"


def _impacts(m: CrashMotion) -> Iterator[Sign]:
    """The lowest place is reached faster than one lands."""
    low = m.height < float(np.nanmin(m.height)) + 0.15
    fell = minimum_filter1d(m.speed[:, 2], 20, origin=9)  # within the last 0.2 s
    stops = low & (fell < -_HARD_TOUCH_M_S) & (m.speed[:, 2] > -0.3 * _HARD_TOUCH_M_S) & m.valid
    for begin, _ in runs(stops)[:1]:
        before = slice(max(begin - 50, 0), begin)
        if (m.height[before] < float(np.nanmin(m.height)) + _LANDING_CUT_M).all():
            continue
        yield Sign(float(m.t[begin]), "impact", f"it hits the floor at {-fell[begin]:.1f} m/s")


def _bumps(m: CrashMotion) -> Iterator[Sign]:
    """Velocity that turns within a few poses, where no accelerometer is."""
    if "accel" in m.series or "acceleration" in m.series:
        return
    if sample_interval(m.series["position"].t) > 0.03 or not m.even:
        return
    half = round(0.06 * RATE)
    change = np.zeros(m.t.size)
    ahead, behind = m.speed[2 * half :], m.speed[: -2 * half]
    change[half:-half] = np.linalg.norm(ahead - behind, axis=1)
    usual = np.nanpercentile(change[m.learnt], 99.5)
    large = (change > max(2.0 * _CONTACT_M_S, 3.0 * float(usual))) & m.valid & m.flying
    for begin, end in runs(large)[:3]:
        row = begin + int(np.argmax(change[begin:end]))
        text = f"the velocity changes by {change[row]:.1f} m/s within 0.12 s"
        # without drives it may as well be a controller that has lost hold
        kind = _where(m, row) if np.isfinite(m.demand).any() else "bump"
        yield Sign(float(m.t[row]), kind, text)


def _slides(m: CrashMotion) -> Iterator[Sign]:
    """Height that stays, as no hover's does, where nothing higher was reached: a ceiling."""
    position = m.series["position"]
    place = position.values - position.values[0]
    count = round(_SLIDES_S / max(sample_interval(position.t), 1e-3))
    if count < 20 or m.noise > 0.5 * _SLIDE_HEIGHT_STD_M:
        return
    mean, square = (uniform_filter1d(x, count, axis=0) for x in (place, place**2))
    spread = np.sqrt(np.maximum(square - mean**2, 0.0))
    still = np.linalg.norm(spread, axis=1) < _SLIDE_HEIGHT_STD_M
    low = float(mean[still, 2].min()) if still.any() else float(mean[:, 2].min())
    flat = (spread[:, 2] < _SLIDE_HEIGHT_STD_M) & (
        np.hypot(spread[:, 0], spread[:, 1]) > _SLIDE_PLACE_STD_M
    )
    flat &= mean[:, 2] > max(
        low + _OFF_GROUND, float(np.percentile(place[:, 2], 99.0)) - _CEILING_BAND_M
    )
    if still[-1]:
        flat &= np.abs(mean[:, 2] - mean[-1, 2]) > _SLIDE_HEIGHT_STD_M  # the height at the end
    for begin, _ in runs(flat)[:1]:
        within_mm = 1e3 * _SLIDE_HEIGHT_STD_M
        text = f"the height stays within {within_mm:.1f} mm while it moves sideways: it slides"
        yield Sign(float(position.t[max(begin - count // 2, 0)]), "contact", text)


def _grounds(m: CrashMotion) -> Iterator[Sign]:
    """It comes down to where it rests at the end, and flies on."""
    position = m.series["position"]
    t, height = position.t, position.values[:, 2]
    last = height[t > t[-1] - _REST_S]
    count = round(0.1 / max(sample_interval(t), 1e-3))
    if last.size < 10 or np.std(last) > _SLIDE_HEIGHT_STD_M or count < 3:
        return
    above = median_filter(height, count | 1, mode="nearest") - np.median(last)
    if above.max() < 10.0 * _REST_BAND_M:
        return  # a hover, and no flight
    down = np.abs(above) < _REST_BAND_M
    lands = t[np.flatnonzero(~down)[-1]] if not down.all() else t[0]
    for row in find_peaks(-above, prominence=_RISE_M)[0]:
        begin, end = next(((b, e - 1) for b, e in runs(down) if b <= row < e), (row, row))
        off = t[begin] - max([t[0], *t[:begin][down[:begin]][-1:]])
        short = t[end] - t[begin] < _FREE_S < off and t[row] < lands - _REST_S
        if short and -2.0 * _REST_BAND_M < above[row] < _REST_BAND_M and m.flying[m.index(t[row])]:
            text = "it comes down to the height at which it rests at the end, and flies on"
            yield Sign(float(t[row]), "contact", text)
            return


def _swings(m: CrashMotion) -> Iterator[Sign]:
    """Body rates or commands that swing with one frequency, more than they did and need to."""
    demand = np.nan_to_num(m.demand) @ MODES[1:].T
    rates = np.nan_to_num(m.rates)
    if m.t.size <= RATE:
        return
    swing, needed = _fast(rates), _fast(np.nan_to_num(m.course))
    turned, asked = (_size(x) for x in (swing, needed))
    tilting, tilted = (np.linalg.norm(x[:, :2], axis=1) for x in (turned, asked))
    beyond = np.column_stack(
        [tilting > BEYOND * tilted] * 2 + [turned[:, 2] > BEYOND * asked[:, 2]]
    )
    # a heading that is not in the log may be asked for; it does not tilt the vehicle
    beyond[:, 2] &= np.isfinite(m.course[:, 2]) | (tilting > SWING_RAD_S)
    swing *= beyond
    if rates.any():
        yield from _swinging(m, "the body's rate", swing, SWING_RAD_S)
        # a moment that the course needs turns the vehicle as the course does
        demand *= beyond
    if demand.any():
        yield from _swinging(m, "the command", _fast(demand), _SWING_ASKED)


def _fast(values: Array) -> Array:
    """Return what swings of values (N, k); before a blow, where the filter rings, nothing does."""
    sos = butter(2, SWING_HZ, "band", fs=RATE, output="sos")
    most = np.abs(values - np.median(values, axis=0))
    return np.asarray(np.clip(sosfiltfilt(sos, values, axis=0), -most, most))


def _size(fast: Array) -> Array:
    """Return the standard deviation lately."""
    power = uniform_filter1d(fast**2, round(0.4 * RATE), axis=0)
    return np.asarray(np.sqrt(np.maximum(power, 0.0)))


def _swinging(m: CrashMotion, name: str, fast: Array, least: float) -> Iterator[Sign]:
    """Return the first swing of a channel (N, 3) of a size beyond `least` and its usual one."""
    size = _size(fast)
    for axis in range(3):
        usual = float(np.nanmedian(size[m.learnt, axis]))
        limit = max(least, min(_GROWS * usual, 1.25 * least))
        free = m.flying & (np.nan_to_num(m.tilt) < UPSET_TILT_RAD)
        spans = [(b, e, _CYCLES) for b, e in runs((size[:, axis] > limit) & free)]
        # from the start, and so usual: then longer
        spans += [(b, e, 2 * _CYCLES) for b, e in runs((size[:, axis] > least) & free)]
        for begin, end, cycles in spans:
            zeros = np.flatnonzero(np.diff(np.signbit(fast[begin:end, axis])))
            steps = np.diff(zeros)
            if zeros.size < 2 * cycles or np.std(steps) > _UNEVEN * np.mean(steps):
                continue
            if size[end - 1, axis] < size[(begin + end) // 2, axis] and end - begin < RATE:
                continue  # it dies away: struck, not driven
            hertz = 0.5 * RATE / float(np.mean(steps))
            quiet = max(4.0 * usual, 0.2 * limit) if usual < 0.2 * limit else limit
            row, cycle = begin, round(0.6 * RATE / hertz)
            while row > 0 and np.abs(fast[max(row - cycle, 0) : row, axis]).max() > quiet:
                row -= 1
            text = f"{name} about {'xyz'[axis]} swings at {hertz:.1f} Hz"
            yield Sign(float(m.t[row]), "oscillation", text)
            break


def _poses_lost(m: CrashMotion) -> Iterator[Sign]:
    """Poses that are absent or repeat themselves, in the air."""
    position = m.series["position"]
    spans = [(float(b), float(e), "absent") for b, e in gap_spans(position.t) if e - b > _GAP_S]
    if m.t[-1] - position.t[-1] > _GAP_S:
        spans.append((float(position.t[-1]), float(m.t[-1]), "absent"))
    raw, turns = m.log.series["position"], m.log.series.get("attitude")
    values = raw.values
    if turns is not None and turns.values.shape[0] == len(values):
        values = np.hstack([values, turns.values])  # rounded positions alone repeat in a hover
    same = np.concatenate([[False], (np.diff(values, axis=0) == 0.0).all(axis=1)])
    for first, last in runs(same):
        if raw.t[last - 1] - raw.t[first - 1] > 0.1 and last - first > 4:
            spans.append((float(raw.t[first - 1]), float(raw.t[last - 1]), "the same"))
    for begin, end, how in sorted(spans):
        row = m.index(begin)
        if row >= int(np.argmax(m.learnt)) and m.flying[row] and m.flying[max(row - 10, 0)]:
            yield Sign(begin, "position", f"poses are {how} for {end - begin:.2f} s", end - begin)
            return


def _poses_leap(m: CrashMotion) -> Iterator[Sign]:
    """Poses that are elsewhere from one to the next."""
    position = m.series["position"]
    step = np.diff(position.values, axis=0)
    held = np.diff(position.t)
    usual = np.percentile(np.linalg.norm(step, axis=1) / held, 95.0)
    far = np.linalg.norm(step, axis=1)
    leaps = far > _POSITION_JUMP_M + 3.0 * usual * held
    for k in np.flatnonzero(leaps):
        if m.flying[m.index(position.t[k])] and held[k] < 0.2:
            text = f"the position jumps by {far[k]:.2f} m from one pose to the next"
            yield Sign(float(position.t[k + 1]), "position", text, np.inf)
            return


def _supply_falls(m: CrashMotion) -> Iterator[Sign]:
    """Voltage that leaves the line that it followed, downwards."""
    raw = m.series.get("voltage")
    if raw is None:
        return
    t, v = raw.t, raw.values[:, 0]
    learnt = (t >= m.t[m.learnt][0]) & (t <= m.t[m.learnt][-1])
    if np.count_nonzero(learnt) < 10 or not np.median(v[learnt]) > 0.0:
        return
    usual = float(np.median(v[learnt]))
    spread = float(np.percentile(np.abs(v[learnt] - usual), 99.0)) / usual
    fit = np.polyfit(t[learnt], v[learnt], 1)
    off = 1.0 - v / np.maximum(np.polyval(fit, t), 0.5 * usual)
    off = uniform_filter1d(off, max(round(0.05 / max(sample_interval(t), 1e-3)), 1))
    low = off > max(_SAG, 2.0 * spread)
    for begin, end in runs(low):
        if t[end - 1] - t[begin] < 0.2 or not m.flying[m.index(t[begin])]:
            continue
        # back along the fall to where it left the line
        later = min(begin + max((end - begin) // 2, 1), t.size - 1)
        steep = (off[later] - off[begin]) / max(t[later] - t[begin], 1e-3)
        back = min(off[begin] / steep, 0.3) if steep > 0.05 else 0.0
        share = float(off[begin:end].max())
        text = f"the voltage falls {100 * share:.0f} % below the line it followed"
        yield Sign(float(t[begin] - back), "battery", text, share)
        return


def _thrust_lacks(m: CrashMotion) -> Iterator[Sign]:
    """Thrust of all rotors that is less than was usual for such commands."""
    if not np.isfinite(m.missing).any() or "voltage" in m.series:
        return
    share = np.nan_to_num(-m.missing / np.maximum(np.nan_to_num(m.demand).mean(axis=1), 0.3))
    lacks = uniform_filter1d(share, 20)
    usual = float(np.percentile(np.abs(lacks[m.learnt]), 99.0))
    row = _first(m, lacks > max(_THRUST_DROP, 2.0 * usual), 0.2)
    if row is not None:
        yield Sign(float(m.t[row]), "battery", "all rotors give less thrust than they did")


def _command_leaps(m: CrashMotion) -> Iterator[Sign]:
    """Commands that change at once by far more than they did, and the vehicle follows."""
    if not np.isfinite(m.demand).any():
        return
    half = round(0.03 * RATE)
    asked = np.nan_to_num(m.demand) @ MODES[:3].T
    change = np.zeros(m.t.size)
    change[half:-half] = np.linalg.norm(asked[2 * half :] - asked[: -2 * half], axis=1)
    usual = float(np.nanpercentile(change[m.learnt], 99.0))
    change[: int(np.argmax(m.learnt))] = 0.0  # take-off
    row = _first(m, change > min(max(_COMMAND_STEP_RATIO * usual, 0.15), 0.6), 0.0)
    if row is not None:
        text = "the commands leap to what they never were, and the vehicle follows"
        yield Sign(float(m.t[row]), "command", text)


def _upsets(m: CrashMotion) -> Iterator[Sign]:
    row = _first(m, np.nan_to_num(m.tilt) > UPSET_TILT_RAD, 0.02)
    if row is not None:
        fast = np.linalg.norm(np.nan_to_num(m.rates), axis=1)
        usual = 3.0 * float(np.percentile(fast[m.learnt], 99.0))
        turns = row
        while turns > 0 and fast[max(turns - 10, 0) : turns].max() > usual:
            turns -= 1
        if turns < row:
            yield Sign(float(m.t[turns]), "turns", "it begins to turn faster than it did")
        yield Sign(
            float(m.t[row]), "upset", f"it leans by more than {np.degrees(UPSET_TILT_RAD):.0f}°"
        )


def _falls(m: CrashMotion) -> Iterator[Sign]:
    """It drops without thrust."""
    down = uniform_filter1d(m.acceleration[:, 2], 5) < -0.6 * GRAVITY
    row = _first(m, down & m.valid & (m.speed[:, 2] < -0.5), 0.08)
    if row is not None:
        yield Sign(float(m.t[row]), "fall", "it falls")

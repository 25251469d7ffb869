"""The controller of several flights: gains, oscillations, unexpected responses."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import combine_pvalues
from scipy.stats import t as student

from tombo_bag.flight import Flight
from tombo_diagnosis.control.actuators import ACTUATORS, AS_ASKED, thrust_gain
from tombo_diagnosis.control.gains import FREEDOM, T975, LoopFit, LoopGain, loop_fits
from tombo_diagnosis.control.oscillation import Oscillation, oscillation
from tombo_diagnosis.control.signals import DrivePlant, control_signals

_OTHER, _OTHER_ALONE = 0.15, 0.4
"""Relative difference of a gain from which on the controller is another; the second where one
flight is compared with one, whose spread is not known."""
_CHANCE = 0.05
"""Of a difference in a sound controller's gains, below which they are others."""


@dataclass(frozen=True)
class GainChange:
    """A gain that is another than expected."""

    gain: LoopGain
    expected: LoopGain

    @property
    def text(self) -> str:
        """What changed, in a phrase."""
        return (
            f"{self.gain.label} {self.gain.value:.3g} ({self.gain.low:.3g} to "
            f"{self.gain.high:.3g}) {self.gain.unit}, not {self.expected.value:.3g}"
        )

    @property
    def actuator_text(self) -> str:
        """A sentence, where it is thrust given over thrust asked for."""
        value, low, high = (
            v / self.expected.value for v in (self.gain.value, self.gain.low, self.gain.high)
        )
        what = "stronger" if value > 1.0 else "weaker"
        weight = "less" if value > 1.0 else "more"
        return (
            f"The rotors give {value:.2f} ({low:.2f} to {high:.2f}) times the thrust that is "
            f"asked for: the actuators are {what} than believed, or the vehicle weighs {weight}, "
            f"{1.0 / value:.2f} times what is believed."
        )


@dataclass(frozen=True)
class ControllerReport:
    """Findings of flights about their controller."""

    gains: tuple[LoopGain, ...]
    """The known gains."""
    unknown: tuple[str, ...]
    """Unknown quantities of the loops, with reasons."""
    oscillations: tuple[tuple[str, Oscillation], ...]
    """Name of the flight, and its oscillation."""
    changed: tuple[GainChange, ...]
    compared_with: str
    """Empty: with nothing."""

    @property
    def summary(self) -> str:
        """In a sentence or two; empty if nothing is wrong."""
        said = [f"In {flight} {swing.text}." for flight, swing in self.oscillations]
        said += [c.actuator_text for c in self.changed if c.gain.loop == ACTUATORS]
        loops = [c for c in self.changed if c.gain.loop != ACTUATORS]
        if loops:
            differing = "; ".join(c.text for c in loops[:3])
            more = len(loops) - 3
            rest = f"; and {more} more" if more > 0 else ""
            said.append(f"The controller is another than {self.compared_with}: {differing}{rest}.")
        return " ".join(said)


def with_controller(summary: str, report: ControllerReport | None) -> str:
    """Return a summary, and after it what is wrong with the controller."""
    return " ".join(filter(None, (summary, "" if report is None else report.summary)))


def controller_report(
    flights: Sequence[Flight],
    plant: DrivePlant | None,
    expected: Sequence[LoopGain] = (),
    compared_with: str = "",
) -> ControllerReport | None:
    """Return what flights of one controller say of it; None: nothing.

    Args:
        flights: with the controller's estimates and set points.
        plant: turns rotor speeds into moments; None: a flight's own airframe does.
        expected: gains that the controller should have.
        compared_with: the channels that have them.
    """
    seen = [(f, s) for f in flights if f.control and (s := control_signals(f, plant)) is not None]
    if not seen:
        return None
    fits = [loop_fits(s) for _, s in seen]
    given = [fit for f, s in seen if (fit := thrust_gain(f, s)) is not None]
    gains, unknown = pooled_gains([fit for each in (*fits, given) for fit in each])
    if not any(fits):
        unknown = ["no set points of attitude or rates: loops are not known"]
    swings = [(f.name, o) for f, s in seen if (o := oscillation(s)) is not None]
    known = {g.label: g for g in (AS_ASKED, *expected)}
    pairs = [(g, known[g.label]) for g in gains if g.label in known]
    pairs = [(g, k) for g, k in pairs if k.unit == g.unit]
    changed = _changed(pairs)
    compared = {g.label for g in expected} & {g.label for g in gains}
    stated = compared_with if compared else ""
    return ControllerReport(tuple(gains), tuple(unknown), tuple(swings), changed, stated)


def pooled_gains(fits: Sequence[LoopFit]) -> tuple[list[LoopGain], list[str]]:
    """Return each gain over all flights, with the spread between them, and why others are not."""
    groups: dict[str, list[LoopGain]] = {}
    unknown: dict[str, str] = {}
    for fit in fits:
        for gain in fit.gains:
            if fit.remark or not gain.known:
                unknown[gain.label] = fit.remark or "the flights excite it too little"
            else:
                groups.setdefault(gain.label, []).append(gain)
        if not fit.gains:
            unknown[f"{fit.loop} {fit.axis}"] = fit.remark
    pooled = [_pooled(group) for group in groups.values()]
    left = [f"{k}: {why}" for k, why in unknown.items() if k not in groups]
    return pooled, left


def _pooled(group: Sequence[LoopGain]) -> LoopGain:
    values = np.array([g.value for g in group])
    errors = np.array([(g.high - g.low) / 4.0 for g in group])
    weights = 1.0 / errors**2
    mean = float(weights @ values / weights.sum())
    spread = float(np.std(values, ddof=1)) if len(group) > 1 else 0.0
    half = 2.0 * max(float(weights.sum() ** -0.5), spread / np.sqrt(len(group)), errors.min())
    return replace(
        group[0], value=mean, low=mean - half, high=mean + half, spread=spread, flights=len(group)
    )


def _changed(pairs: Sequence[tuple[LoopGain, LoopGain]]) -> tuple[GainChange, ...]:
    """Return the gains that are others than expected.

    The axes of a loop are tuned alike and fitted apart, so the chances of one term are combined
    over them (Fisher, 1932). In 95 % of sound controllers no term is called another (Bonferroni).
    """
    terms: dict[tuple[str, str], list[tuple[GainChange, float]]] = {}
    for gain, expected in pairs:
        tried = GainChange(gain, expected), _chance(gain, expected)
        terms.setdefault((gain.loop, gain.term), []).append(tried)
    return tuple(
        change
        for tried in terms.values()
        if combine_pvalues([chance for _, chance in tried]).pvalue < _CHANCE / len(terms)
        for change, chance in tried
        if chance < _CHANCE and _is_large(change)
    )


def _chance(gain: LoopGain, expected: LoopGain) -> float:
    """Return the chance of such a difference, by the intervals and the spread between flights."""
    apart = abs(gain.value - expected.value)
    error = float(np.hypot(gain.high - gain.low, expected.high - expected.low)) / (2.0 * T975)
    chance = 2.0 * float(student.sf(apart / error, FREEDOM))
    free = gain.flights + expected.flights - 2
    if expected.flights and free > 0:
        sums = [(g.flights - 1) * g.spread**2 for g in (gain, expected)]
        mean = np.sqrt(sum(sums) / free * (1.0 / gain.flights + 1.0 / expected.flights))
        if apart < mean * student.isf(chance / 2.0, free):
            chance = 2.0 * float(student.sf(apart / mean, free))
    return max(chance, sys.float_info.min)


def _is_large(change: GainChange) -> bool:
    """Return whether a difference is more than what a sound controller's gains may have."""
    expected = change.expected
    alone = expected.flights and change.gain.flights + expected.flights < 3
    least = _OTHER_ALONE if alone else _OTHER
    return abs(change.gain.value - expected.value) > least * abs(expected.value)


def controller_mapping(report: ControllerReport | None) -> Mapping[str, Any] | None:
    """Return the report as plain values."""
    if report is None:
        return None
    return {
        "gains": [_plain(gain) for gain in report.gains],
        "unknown": list(report.unknown),
        "oscillations": [{"flight": flight, **asdict(o)} for flight, o in report.oscillations],
        "changed": [{**_plain(c.gain), "expected": c.expected.value} for c in report.changed],
        "compared_with": report.compared_with,
    }


def _plain(gain: LoopGain) -> dict[str, Any]:
    return {k: v for k, v in asdict(gain).items() if k not in ("spread", "flights")}

"""How names, numbers and units are written in summaries, reports and tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from tombo_flight.extended_model import FittedParameter

DASH: Final = "–"
"""Stands for a number that is not known."""


def display_name(name: str) -> str:
    """Return an effect's or channel's name as words."""
    return name.replace("_", " ")


def listed(names: Sequence[str], last: str = "and") -> str:
    """Return names as words, in an enumeration that ends with `last`."""
    texts = [display_name(name) for name in names]
    if len(texts) < 2:
        return "".join(texts)
    return f"{', '.join(texts[:-1])} {last} {texts[-1]}"


def counted(count: int, name: str) -> str:
    """Return a number of things, in the plural if there are several."""
    return f"{count} {name}{'s' * (count > 1)}"


def capital(text: str) -> str:
    """Return the text with its first letter large, the others as they are."""
    return text[:1].upper() + text[1:]


def unit(text: str) -> str:
    """Return a unit as it is written after a number: nothing for the unit of pure numbers."""
    return "" if text in ("", "1") else text.replace("^2", "²").replace("^3", "³")


def percent(share: float, digits: int = 0) -> str:
    """Return a share as a percentage with a typographic minus; a dash for NaN."""
    if not math.isfinite(share):
        return DASH
    return f"{100.0 * share:.{digits}f} %".replace("-", "−").replace("−0 %", "0 %")


def certainty(probability: float) -> str:
    """Return a probability in per cent that never claims to be certain."""
    if probability > 0.995:
        return "> 99 %"
    return "< 1 %" if probability < 0.005 else percent(probability)


def figure(value: float, digits: int = 3) -> str:
    """Return a number with `digits` significant digits, typographic minus; a dash for NaN."""
    if not math.isfinite(value):
        return DASH
    if value == 0.0:
        return "0"
    power = math.floor(math.log10(abs(value)))
    if not -4 <= power < 6:
        return f"{value:.{digits - 1}e}".replace("-", "−")
    return f"{value:.{max(digits - 1 - power, 0)}f}".replace("-", "−")


def sized(value: float, parameter_unit: str) -> str:
    """Return a size with two digits and its unit: shares in per cent, short lengths in mm."""
    if parameter_unit in ("", "1"):
        return f"{_short(100.0 * value)} %"
    if parameter_unit == "m" and abs(value) < 0.1:
        return f"{_short(1000.0 * value)} mm"
    if parameter_unit == "s" and abs(value) < 0.1:
        return f"{_short(1000.0 * value)} ms"
    return f"{_short(value)} {unit(parameter_unit)}"


def _short(value: float) -> str:
    return f"{value:.2g}" if math.isfinite(value) else DASH


def interval(fitted: FittedParameter) -> tuple[str, str, str]:
    """Return value, low and high with the decimals that the width of the interval allows."""
    ends = fitted.value, fitted.low, fitted.high
    width = fitted.high - fitted.low
    decimals = 9
    if math.isfinite(width) and width > 0.0:
        decimals = max(-math.floor(math.log10(width / 4.0)), 0)
    value, low, high = (
        f"{x:.{decimals}f}".replace("-", "−") if decimals < 6 else figure(x) for x in ends
    )
    return value, low, high

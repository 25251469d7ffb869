"""Scaling of numbers into MAVLink's integer fields."""

from __future__ import annotations

import math

INT16 = (-32767, 32767)
INT32 = (-(2**31) + 1, 2**31 - 1)


def fitted(value: float, bounds: tuple[int, int], unknown: int = 0) -> int:
    """Return the nearest whole number within bounds; `unknown` for NaN."""
    if math.isnan(value):
        return unknown
    low, high = bounds
    return round(min(max(value, low), high))


def globe_fields(place: tuple[float, float, float]) -> tuple[int, int, int]:
    """Return latitude, longitude [1e-7 deg] and altitude [mm] of degrees and metres."""
    latitude, longitude, altitude = place
    return fitted(1e7 * latitude, INT32), fitted(1e7 * longitude, INT32), millimetres(altitude)


def millimetres(value: float) -> int:
    """Return metres in millimetres."""
    return fitted(1e3 * value, INT32)


def centi(value: float) -> int:
    """Return a value in hundredths, in 16 bits: cm/s of m/s, cA of A."""
    return fitted(1e2 * value, INT16)


def heading(degrees: float) -> int:
    """Return an angle in hundredths of a degree, 0 to 35999."""
    return fitted(100.0 * degrees, (0, 36000)) % 36000

"""Which flights are of one session: one day, one set-up."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from tombo_bag.flight import Flight
from tombo_diagnosis.change.features import Features
from tombo_dynamics.errors import InputError

ALIKE = 0.04
"""Distance of demand (root of the sum of squares over rotors) up to which flights are of one
session where nothing says of which: twice that of two flights of one."""
_DATE = re.compile(r"(?<!\d)(20\d\d)[-_]?([01]\d)[-_]?([0-3]\d)(?!\d{3})")
_FIRST_NS, _LAST_NS = 10**18, 4 * 10**18
"""Stamps outside this range are not dates: 2001 to 2096."""


def known_sessions(flights: Sequence[Flight], given: Mapping[str, str]) -> list[str]:
    """Return each flight's session: as given, else its date, of its stamps or its name; else "".

    Args:
        flights: of both sides.
        given: pattern of names, as `normal_[123]*` -> session.

    Raises:
        InputError: a pattern fits no flight.
    """
    names = [_date(f) for f in flights]
    for pattern, session in given.items():
        rows = [k for k, f in enumerate(flights) if fnmatch(f.name, pattern)]
        if not rows:
            raise InputError(
                f"--session {session}={pattern}: fits no flight; accepted: a pattern of their "
                f"names, which are {', '.join(f.name for f in flights)}"
            )
        for k in rows:
            names[k] = session
    return names


def healthy_sessions(
    before: Sequence[Flight],
    after: Sequence[Flight],
    healthy: Sequence[Features],
    given: Mapping[str, str],
) -> tuple[list[str], str]:
    """Return each healthy flight's session, and the session of all new flights, or "".

    A day on which the vehicle changes is not a session: its parts are.

    Args:
        before: the healthy flights.
        after: the new ones.
        healthy: features of the healthy flights.
        given: as `known_sessions`.
    """
    known = known_sessions([*before, *after], given)
    named, new = known[: len(before)], set(known[len(before) :])
    alike = sessions_by_demand(healthy)
    if not all(named):
        return alike, ""
    same = new.pop() if len(new) == 1 and new <= set(named) else ""
    parts = [f"{day}, {part}" for day, part in zip(named, alike, strict=True)]
    that_day = {part for day, part in zip(named, parts, strict=True) if day == same}
    if given or len(that_day) < 2:
        return named, same
    return parts, ""


def _date(flight: Flight) -> str:
    if _FIRST_NS < flight.epoch_ns < _LAST_NS:
        return str(np.datetime64(flight.epoch_ns, "ns").astype("datetime64[D]"))
    match = _DATE.search(Path(flight.name).name)
    return "-".join(match.groups()) if match else ""


def sessions_by_demand(flights: Sequence[Features]) -> list[str]:
    """Return a session for each flight: flights of similar demand (single linkage)."""
    if len(flights) < 2:
        return ["session 1"] * len(flights)
    apart = linkage(np.array([f.demand for f in flights]), "single")
    return [f"session {k}" for k in fcluster(apart, ALIKE, "distance")]

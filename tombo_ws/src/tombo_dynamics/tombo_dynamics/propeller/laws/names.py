"""The laws' names, and the numbers that compiled code knows them and its verdicts by."""

from __future__ import annotations

from tombo_dynamics.errors import unknown_name

LAWS = {"published": 0, "repaired": 1, "consistent": 2}
"""Law by name, with its number in compiled code."""
DEFAULT_LAW = "repaired"

OK = 0
TWIST_OUT_OF_RANGE = 1
NO_EQUILIBRIUM = 2
"""Verdicts on a point: physical root found; some section beyond the coefficients' range; no root
that continues the one at rest."""


def law_number(law: str) -> int:
    """Return the number of a law.

    Raises:
        InputError: there is no such law.
    """
    if not isinstance(law, str) or law not in LAWS:
        raise unknown_name("law", law, LAWS)
    return LAWS[law]

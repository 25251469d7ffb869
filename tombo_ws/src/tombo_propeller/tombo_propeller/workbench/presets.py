"""Blades to begin with: the paper's, two of its sizes, and one of a published table."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from tombo_dynamics.propeller import Blade, read_library
from tombo_propeller.workbench.blade_table import blade_from_table, parse_blade_table, scaled_blade

PAPER: Final = "nine_inch"
INCH_MM: Final = 25.4
APC_10X7: Final = """r/R c/R beta
0.15 0.138 37.86
0.20 0.154 45.82
0.25 0.175 44.19
0.30 0.190 38.35
0.35 0.198 33.64
0.40 0.202 29.90
0.45 0.200 27.02
0.50 0.195 24.67
0.55 0.186 22.62
0.60 0.174 20.88
0.65 0.161 19.36
0.70 0.145 17.98
0.75 0.129 16.74
0.80 0.112 15.79
0.85 0.096 14.64
0.90 0.081 13.86
0.95 0.061 12.72
"""
"""APC 10x7 Thin Electric, from the UIUC Propeller Data Site (Brandt and Selig)."""

PRESETS: Final = {
    "five_inch": "5 in: the paper's blade, scaled",
    PAPER: "9 in: the paper's blade",
    "apc_10x7": "10 in: APC 10x7 Thin Electric (UIUC table)",
    "twenty_inch": "20 in: the paper's blade, scaled",
}
"""Name of a blade → what it is."""
_SCALED_INCHES: Final = {"five_inch": 5.0, "twenty_inch": 20.0}


@lru_cache(maxsize=8)
def preset(name: str) -> Blade:
    """Return a blade of PRESETS."""
    paper = read_library().blades[PAPER]
    if name in _SCALED_INCHES:
        return scaled_blade(name, paper, _SCALED_INCHES[name] * INCH_MM)
    if name == "apc_10x7":
        table = parse_blade_table(APC_10X7, 10.0 * INCH_MM)
        return blade_from_table(name, table, paper)
    return paper

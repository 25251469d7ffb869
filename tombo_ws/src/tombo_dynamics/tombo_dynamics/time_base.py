"""The time base of all packages: the tick, and the stamp at which a simulated flight begins."""

from __future__ import annotations

from typing import Final

SECOND_NS: Final = 1_000_000_000
TICK_NS: Final = 1_000_000
"""Step of the simulation and of the rate loop, 1 ms."""
TICK_S: Final = 1e-3
"""The same [s]."""
TICK_HZ: Final = SECOND_NS // TICK_NS
"""Ticks in a second."""
EPOCH_NS: Final = SECOND_NS
"""Stamp of flight time 0: one second, since many readers take a stamp of 0 for "no time"."""
LATENESS_MAX_US: Final = 20_000.0
"""Percentiles of how late loops ran are told up to here; a larger one is told as this."""

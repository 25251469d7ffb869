"""One measured flight: named, unit-checked series with their capture times.

Readers (bags, ULog, CSV) make it, pre-checks look at it, the diagnosis fits it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tombo_bag.flight import Finding as Finding
from tombo_bag.flight import Series as Series


@dataclass(frozen=True)
class Channel:
    """What a channel of a log holds."""

    width: int
    unit: str
    doc: str


CHANNELS: Mapping[str, Channel] = {
    "position": Channel(3, "m", "motion capture, map (ENU)"),
    "attitude": Channel(4, "1", "motion capture, quaternion xyzw, map from base_link (FLU)"),
    "gyro": Channel(3, "rad/s", "body rates, base_link (FLU)"),
    "accel": Channel(3, "m/s^2", "specific force, base_link (FLU); at rest +9.81 on z"),
    "acceleration": Channel(3, "m/s^2", "of an estimator, map (ENU), without gravity: at rest 0"),
    "rotor_speed": Channel(4, "rad/s", "measured, positive, in the order of ROTOR_NAMES"),
    "rotor_command": Channel(4, "rad/s", "rotor speeds asked for, in the order of ROTOR_NAMES"),
    "motor_command": Channel(4, "1", "0 to 1, where no speed is asked for; order of ROTOR_NAMES"),
    "voltage": Channel(1, "V", "supply"),
    "current": Channel(1, "A", "supply"),
}
"""Names, widths and units of everything that the diagnosis can use."""
ROTOR_SPEEDS = ("rotor_speed", "rotor_command")
"""Channels in rad/s, measured ones first."""
DRIVES = (*ROTOR_SPEEDS, "motor_command")
"""Channels that tell what the rotors do, best first."""


@dataclass(frozen=True)
class Airframe:
    """What is known of the vehicle that flew. None: the suite's own nominal vehicle."""

    name: str
    mass: float
    """[kg]"""
    arm_length: float
    """centre to rotor axis [m]"""
    rotor_radius: float
    """[m]"""
    inertia: tuple[float, float, float] | None = None
    """about body x, y, z [kg m^2]; None: not known, moments are then not diagnosed."""
    motor_time_constant: float = 0.05
    """[s]"""


def why_left_out(findings: Iterable[Finding], channels: Iterable[str]) -> str:
    """Return in brackets what checks had against channels that are not there; else nothing."""
    names = set(channels)
    faults = [f for f in findings if f.channel in names and f.severity == "fault"]
    why = "; ".join(f.message for f in faults)
    return f" ({why})" if why else ""


def damage_findings(flight: str, path: Path, damage: Iterable[str]) -> list[Finding]:
    """Report what of a file could not be read."""
    return [Finding("damage", "warning", flight, f"{path.name}: {text}") for text in damage]


@dataclass(frozen=True)
class Flight:
    """One flight as measured. Missing channels are simply not there."""

    name: str
    """Short and unique among the flights of one diagnosis."""
    source: str
    """File that it was read from, and its kind."""
    series: Mapping[str, Series]
    airframe: Airframe | None = None
    findings: tuple[Finding, ...] = ()
    """What the reader noticed."""
    exclude: tuple[tuple[float, float], ...] = ()
    """Spans [s] that are not diagnosed: crash, contact, on the ground."""
    metadata: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_rotor_speeds(self) -> bool:
        """Whether speeds of the rotors are known, measured or asked for."""
        return any(name in self.series for name in ROTOR_SPEEDS)

    @property
    def duration_s(self) -> float:
        """From the first to the last stamp of any channel [s]."""
        ends = [(s.t[0], s.t[-1]) for s in self.series.values() if s.t.size]
        return max(e for _, e in ends) - min(b for b, _ in ends) if ends else 0.0

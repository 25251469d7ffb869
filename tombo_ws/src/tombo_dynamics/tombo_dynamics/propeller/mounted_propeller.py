"""Which propeller is mounted: the parameters of whoever needs its thrust map."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from tombo_dynamics.errors import InputError
from tombo_dynamics.params import param
from tombo_dynamics.propeller.library import Library, read_library
from tombo_dynamics.propeller.records import Configuration


@dataclass(frozen=True)
class PropellerChoice:
    """Which propeller is mounted, the law of its nodus, and how alike the four are."""

    conf: int = param(
        13, "1", (0, 9999), "configuration of the paper's Table I, 0 is rigid, or of `library`"
    )
    law: str = field(default="repaired", metadata={"doc": "published, repaired or consistent"})
    library: str = field(
        default="", metadata={"doc": "folder with own configurations, blades, materials, or empty"}
    )
    matched: float = param(
        0.01,
        "1",
        (0.0, 0.5),
        "standard deviation of thrust between the propellers of one vehicle, share of it",
        "estimated, because: a lab balances a set and pairs it on a stand; Table III's deviation "
        "(17 % for the rigid propeller, too) is of readings of one propeller",
    )


def library_of(choice: PropellerChoice) -> Library:
    """Return the built-in library, with the one of the choice's folder over it.

    Raises:
        InputError: there is no such folder, or what is in it does not fit.
    """
    if not isinstance(choice.library, str):
        raise InputError(f"propeller.library: {choice.library!r}; accepted: a folder, or empty")
    if not choice.library:
        return read_library()
    folder = Path(choice.library)
    if not folder.is_dir():
        raise InputError(
            f"propeller.library: no folder '{choice.library}'; accepted: a folder with "
            "configurations.yaml, or empty"
        )
    return read_library(folder)


def mounted_configuration(choice: PropellerChoice) -> Configuration:
    """Return the configuration that is mounted.

    Raises:
        InputError: it is in neither Table I nor the library, or the library can't be read.
    """
    known = library_of(choice).configurations
    if choice.conf not in known:
        raise InputError(
            f"propeller.conf: there is no configuration {choice.conf}; accepted: {_ranges(known)}"
        )
    return known[choice.conf]


def _ranges(numbers: Iterable[int]) -> str:
    """Return rising whole numbers as text, neighbours as ranges: 0 to 13, 20."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(f"{a} to {b}" if a < b else f"{a}" for a, b in runs)

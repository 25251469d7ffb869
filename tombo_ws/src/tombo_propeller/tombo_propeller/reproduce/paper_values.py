"""The paper's printed values, digit for digit, read from data files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from tombo_dynamics.propeller.library import DATA
from tombo_dynamics.yaml_text import parse_yaml, read_text


@dataclass(frozen=True)
class PrintedNumber:
    """A number as it is printed: its digits say how exactly it is known."""

    text: str

    @property
    def value(self) -> float:
        """The number."""
        return float(self.text)

    @property
    def digits(self) -> int:
        """How many digits are printed after the point."""
        return len(self.text.partition(".")[2])

    @property
    def half(self) -> float:
        """Half of the last printed digit: how far rounding may have moved the number."""
        return 0.5 * 10.0**-self.digits

    def agrees(self, value: float) -> bool:
        """Return whether `value`, rounded as this number is printed, is this number."""
        return f"{value:.{self.digits}f}" == f"{self.value:.{self.digits}f}"


@dataclass(frozen=True)
class Row3:
    """A row of Table III; `ratio` is the authors' simulation of lift over drag."""

    thrust_N: PrintedNumber
    thrust_dev_N: PrintedNumber
    force_N: PrintedNumber
    recovery_s: PrintedNumber | None
    ratio: PrintedNumber
    noise_dB: PrintedNumber


@dataclass(frozen=True)
class Row2:
    """A row of Table II: the largest force of a strike `r_mm` from the hub's centre."""

    r_mm: PrintedNumber
    force_N: PrintedNumber
    thickness_mm: PrintedNumber


@dataclass(frozen=True)
class Paper:
    """The printed tables by configuration, and single numbers by name."""

    table_1: Mapping[int, tuple[PrintedNumber, PrintedNumber]]
    """E_N and G_N [MPa]."""
    table_2: tuple[Row2, ...]
    table_3: Mapping[int, Row3]
    texts: Mapping[str, Mapping[str, Any]]
    """`paper.yaml`: sections of numbers, as text; `campaign` is this suite's, `campaign.yaml`."""

    @property
    def soft(self) -> tuple[int, ...]:
        """Numbers of the soft propellers of Table III."""
        return tuple(conf for conf in self.table_3 if conf)

    def number(self, section: str, name: str) -> PrintedNumber:
        """Return a single number of `paper.yaml`."""
        return PrintedNumber(self.text(section, name))

    def text(self, section: str, name: str) -> str:
        """Return a single number of `paper.yaml` as it is printed."""
        entry = self.texts[section][name]
        return str(entry if isinstance(entry, str) else entry["printed"])

    def point(self, section: str, name: str) -> tuple[PrintedNumber, ...]:
        """Return a point of `paper.yaml` [m]."""
        entry = self.texts[section][name]
        texts = entry["printed"] if isinstance(entry, dict) else entry
        return tuple(PrintedNumber(text) for text in texts)

    def source(self, section: str, name: str) -> str:
        """Return where in the paper a number of `paper.yaml` is printed."""
        return str(self.texts[section][name]["source"])


@lru_cache(maxsize=1)
def read_paper() -> Paper:
    """Read what the paper prints from the data files of the package."""
    measured = _texts(DATA / "measurements.yaml")
    return Paper(
        table_1={
            int(row["conf"]): (
                PrintedNumber(row["printed_E_N_MPa"]),
                PrintedNumber(row["printed_G_N_MPa"]),
            )
            for row in _texts(DATA / "configurations.yaml")
            if "printed_E_N_MPa" in row
        },
        table_2=tuple(
            Row2(**{key: PrintedNumber(text) for key, text in row.items()})
            for row in measured["collision_positions"]
        ),
        table_3={int(row["conf"]): _row_3(row) for row in measured["at_2000_rpm"]},
        texts={
            **_texts(Path(__file__).parent / "paper.yaml"),
            "campaign": _texts(Path(__file__).parent / "campaign.yaml"),
        },
    )


def _row_3(row: Mapping[str, str]) -> Row3:
    names = {"collision_force_N": "force_N", "printed_lift_over_drag": "ratio"}
    numbers: dict[str, Any] = {
        names.get(key, key): None if text == "null" else PrintedNumber(text)
        for key, text in row.items()
        if key != "conf"
    }
    return Row3(**numbers)


def _texts(path: Path) -> Any:
    """Read YAML without turning numbers into floats, which would lose printed zeros."""
    return parse_yaml(read_text(path, path.name), path.name, as_text=True)

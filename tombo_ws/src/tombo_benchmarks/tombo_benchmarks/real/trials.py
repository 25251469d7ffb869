"""Real flights, the causes that their authors state, and the right answers."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tombo_dynamics.errors import InputError

ROOT: Final = Path(__file__).resolve().parents[5]
EXAMPLES: Final = ROOT / "examples"
NOTHING: Final = "nothing"
"""Truth of healthy flights."""


@dataclass(frozen=True)
class Trial:
    """Flights, the question about them, and the right answers."""

    data_set: str
    way: str
    """healthy: changes since healthy flights; why: cause of one crash; plain: one diagnosis."""
    logs: tuple[str, ...]
    """Paths below the folder of all data sets."""
    mapping: str
    """Name or file."""
    done: str
    truth: str
    """Kind of the change, or NOTHING."""
    right: frozenset[str] = frozenset()
    """Answers that are right; "none" is right, too, if the truth is NOTHING."""
    healthy: tuple[str, ...] = ()
    accepted: frozenset[str] = frozenset()
    """Answers that are also right in flights where nothing was done: effects of every vehicle of
    the kind, or a verdict that is due."""


@dataclass(frozen=True)
class DataSet:
    """Where trials are from."""

    source: str
    mapping: str


DATA_SETS: Final[Mapping[str, DataSet]] = {
    "crazypad": DataSet(
        "CrazyPAD, vehicle E9 (Masalimov et al., Data 2024, 9, 79; MIT)",
        str(EXAMPLES / "crazypad.yaml"),
    ),
    "crazyswarm2": DataSet(
        "IMRCLab/crazyswarm2-tools (MIT), gains and motors as in its info files",
        str(EXAMPLES / "crazyswarm2.yaml"),
    ),
    "air_garage": DataSet(
        "XinLong-Li/air_garage_cflib (MIT), labels.csv from the author's notes",
        str(EXAMPLES / "air_garage.yaml"),
    ),
    "flights": DataSet("NanoBench (syediu/nanobench-iros2026, BSD-3)", "nanobench"),
    "nanobench_controllers": DataSet(
        "NanoBench (syediu/nanobench-iros2026, BSD-3), two controllers", "nanobench"
    ),
}
_WEAK, _WEIGHT, _HANGING = "weak_propeller", "added_weight", "hanging_load"
_CONDITIONS: Final = (
    ("weight_w1_near_m3", "weight W1 taped near rotor 3", _WEIGHT, "rear_left"),
    ("weight_w3_near_m3", "weight W3 taped near rotor 3", _WEIGHT, "rear_left"),
    ("cut_m3_both_tips_1mm", "propeller 3 cut by 1 mm at both tips", _WEAK, "rear_left"),
    ("cut_m3_both_tips_2mm", "propeller 3 cut by 2 mm at both tips", _WEAK, "rear_left"),
    ("cut_m3_one_tip_1mm", "propeller 3 cut by 1 mm at one tip", _WEAK, "rear_left"),
    ("cut_m3_3mm", "propeller 3 cut by 3 mm", _WEAK, "rear_left"),
    ("string_w2_m3", "weight W2 on a thread near rotor 3", _HANGING, "rear_left"),
    ("string_w3_m3", "weight W3 on a thread near rotor 3", _HANGING, "rear_left"),
    ("tape_m3", "tape on propeller 3", _WEAK, "rear_left"),
    ("tape_m1_m3", "tape on propellers 1 and 3", _WEAK, "front_right+rear_left"),
)
"""Files, change, kind, rotor: rotor 3 is rear left, 1 front right."""
_ALSO: Final = {"cut_m3_one_tip_1mm": {"propeller_unbalance.rear_left"}}
_FIRST_DAY, _SECOND_DAY = (1, 2, 3), (4, 5)
_OSCILLATING: Final = (22, 30, 45, 76, 113, 119, 146, 149, 179)
_FLIP: Final = 28
_UPGRADED, _STANDARD, _LOADED = (103, 111, 126, 137), (148, 156, 160, 178), 184
"""Flights with motors stronger than the firmware believes, with standard ones, with a load of 5 g
on a thread."""
_ALL_ROTORS: Final = frozenset({"mass_error", "thrust_coefficient_error"})
_GARAGE: Final[Mapping[str, tuple[str, frozenset[str], frozenset[str]]]] = {
    "ok": (NOTHING, frozenset(), frozenset()),
    "no_takeoff": (NOTHING, frozenset(), frozenset({"unknown"})),
    "ceiling": ("contact", frozenset({"contact"}), frozenset()),
    "floor": ("contact", frozenset({"contact"}), frozenset()),
    "low_battery?": ("battery", frozenset({"battery"}), frozenset()),
    "fly_away_mocap_lost": (
        "loss_of_position", frozenset({"loss_of_position"}), frozenset(),
    ),
}  # fmt: skip
"""Class of the flight → truth, right, accepted. A vehicle that stays on the floor may be called
wrong without a cause."""
_THERE: Final = frozenset({"linear_rotor_drag", "quadratic_body_drag", "ground_effect"})
"""Effects of a Crazyflie, known by its airframe alone, that the suite's own vehicle lacks."""
_POSES_EARLY_MS: Final = {
    "B10_lissajous_fast_rep1": 17, "B2_circle_medium_rep3": 18, "mell_B9_trefoil_medium_rep3": 17,
    "mell_B9_trefoil_slow_rep3": 24, "mell_aligned": 16, "pid_B9_trefoil_medium_rep3": 21,
    "pid_aligned": -67,
}  # fmt: skip
"""NanoBench's logs whose poses are stamped earlier than the gyro's samples; others: within 5 ms.

By correlation of the gyro with the rates of the attitude, without a model (± 2 ms)."""


def trials(folder: Path, few: int | None = None) -> list[Trial]:
    """Return the trials of the data sets in a folder.

    Args:
        folder: has a folder for each data set.
        few: most trials of each data set, spread over it; None: all.

    Raises:
        InputError: there is none of them.
    """
    listed = [
        *_crazypad(folder), *_crazyswarm2(folder), *_air_garage(folder), *_nanobench(folder),
    ]  # fmt: skip
    if not listed:
        raise InputError(
            f"--data '{folder}': no flights there; accepted: a folder with some of "
            f"{', '.join(DATA_SETS)}"
        )
    if few is None:
        return listed
    chosen = []
    for name in DATA_SETS:
        members = [t for t in listed if t.data_set == name]
        step = max(1, -(-len(members) // few))
        chosen += members[::step]
    return chosen


def _paths(folder: Path, patterns: Iterable[str]) -> tuple[str, ...]:
    return tuple(
        str(path.relative_to(folder))
        for pattern in patterns
        for path in sorted(folder.glob(pattern))
    )


def _crazypad(folder: Path) -> list[Trial]:
    def flights(numbers: Iterable[int]) -> tuple[str, ...]:
        return _paths(folder, [f"crazypad/normal_{k}.csv.gz" for k in numbers])

    def trial(
        new: tuple[str, ...], healthy: tuple[str, ...], done: str, truth: str, right: set[str]
    ) -> Trial:
        mapping = DATA_SETS["crazypad"].mapping
        return Trial(
            "crazypad", "healthy", new, mapping, done, truth, frozenset(right), healthy
        )  # fmt: skip

    every = (*_FIRST_DAY, *_SECOND_DAY)
    rows = [
        trial(
            _paths(folder, [f"crazypad/{name}_[0-9].csv.gz"]), flights(every), done, kind,
            {f"{kind}.{rotor}", *_ALSO.get(name, ())},
        )
        for name, done, kind, rotor in _CONDITIONS
    ]  # fmt: skip
    splits: list[tuple[tuple[int, ...], tuple[int, ...]]] = [
        *(((k,), tuple(n for n in every if n != k)) for k in every),
        *((new, _FIRST_DAY) for new in (_SECOND_DAY, (4,), (5,))),
    ]
    for new, others in splits:
        names = [" and ".join(map(str, new)), " ".join(map(str, others))]
        done = f"nothing: flight {names[0]} against {names[1]}"
        rows.append(trial(flights(new), flights(others), done, NOTHING, set()))
    return [t for t in rows if t.logs and t.healthy]


def _crazyswarm2(folder: Path) -> list[Trial]:
    rows = []
    mapping = DATA_SETS["crazyswarm2"].mapping
    for path in _paths(folder, ["crazyswarm2/log*.csv.gz"]):
        digits = "".join(c for c in Path(path).name.split(".")[0] if c.isdigit())
        number = int(digits)
        done, truth = f"flight {number}: flies as it should", NOTHING
        right: frozenset[str] = frozenset()
        if number in _OSCILLATING:
            done, truth = f"flight {number}: gains unfit, it oscillates", "oscillation"
            right = frozenset({truth})
        elif number == _FLIP:
            done, truth = f"flight {number}: integral gain 0, flips from 6.6 s on", "flip"
            right = frozenset({"oscillation"})
        rows.append(Trial("crazyswarm2", "why", (path,), mapping, done, truth, right))
    rows.sort(key=lambda t: int(t.done.split(":")[0].split()[1]))

    def logs(*numbers: int) -> tuple[str, ...]:
        return _paths(folder, [f"crazyswarm2/log{number}.csv.gz" for number in numbers])

    rows.append(
        Trial(
            "crazyswarm2", "plain", logs(_LOADED), mapping,
            f"flight {_LOADED}: a load of 5 g on a thread", _HANGING, frozenset({_HANGING}),
        )
    )  # fmt: skip
    for new, old, motors in (
        (_STANDARD[:2], _UPGRADED, "weaker"), (_UPGRADED, _STANDARD[:2], "stronger"),
        (_STANDARD[2:], _STANDARD[:2], ""), (_UPGRADED[2:], _UPGRADED[:2], ""),
    ):  # fmt: skip
        names = [" ".join(map(str, numbers)) for numbers in (new, old)]
        done = f"{motors} motors" if motors else "nothing"
        rows.append(
            Trial(
                "crazyswarm2", "healthy", logs(*new), mapping,
                f"{done}: flights {names[0]} against {names[1]}",
                "thrust of all rotors" if motors else NOTHING,
                _ALL_ROTORS if motors else frozenset(), logs(*old),
            )
        )  # fmt: skip
    return [t for t in rows if t.logs and (t.healthy or t.way != "healthy")]


def _air_garage(folder: Path) -> list[Trial]:
    table = folder / "air_garage" / "labels.csv"
    if not table.is_file():
        return []
    rows = []
    with table.open(encoding="utf-8", newline="") as file:
        for label in csv.DictReader(file):
            path = f"air_garage/flights/{label['file']}"
            truth, right, accepted = _GARAGE[label["class"]]
            done = f"{label['file'].split('.')[0]}: {label['class']}"
            mapping = DATA_SETS["air_garage"].mapping
            rows.append(
                Trial("air_garage", "why", (path,), mapping, done, truth, right, (), accepted)
            )
    return [t for t in rows if (folder / t.logs[0]).is_file()]


def _nanobench(folder: Path) -> list[Trial]:
    def plain(name: str, path: str) -> Trial:
        flight = Path(path).name.split(".")[0]
        stamps = {"mocap_stamp_error"} if flight in _POSES_EARLY_MS else set()
        return Trial(
            name, "plain", (path,), DATA_SETS[name].mapping, f"nothing: {flight}", NOTHING,
            accepted=_THERE | stamps,
        )  # fmt: skip

    rows = [
        plain(name, path)
        for name in ("flights", "nanobench_controllers")
        for path in _paths(folder, [f"{name}/*.csv.gz"])
    ]
    of = {
        kind: _paths(folder, [f"nanobench_controllers/{kind}_*.csv.gz"])
        for kind in ("pid", "mell")
    }
    for new, old in (("mell", "pid"), ("pid", "mell")):
        if of[new] and of[old]:
            rows.append(
                Trial(
                    "nanobench_controllers", "healthy", of[new], "nanobench",
                    f"nothing of the vehicle: controller {new} against {old}", NOTHING,
                    healthy=of[old],
                )
            )  # fmt: skip
    return rows

"""What `tombo diagnose --healthy` says of the real flights of CrazyPAD, as a table in Markdown.

    python crazypad.py FOLDER

FOLDER has the flights as `condition_number.csv.gz`, columns as in `examples/crazypad.yaml`. A row
is right if it is named, or a set of at most three, and the true kind with its rotor is among it.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from tombo_bag.flight import Flight
from tombo_diagnosis.change.diagnose import NEEDED, diagnose_change
from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.flight.diagnose import check_flights
from tombo_diagnosis.flight.nominal import nominal_model
from tombo_dynamics.errors import InputError
from tombo_logs.readers.log_reader import read_logs

MAPPING = Path(__file__).resolve().parents[4] / "examples" / "crazypad.yaml"
LARGEST_SET = 3
CONDITIONS = {
    "weight_w1_near_m3": ("weight W1 taped near rotor 3", {"added_weight.rear_left"}),
    "weight_w3_near_m3": ("weight W3 taped near rotor 3", {"added_weight.rear_left"}),
    "cut_m3_both_tips_1mm": (
        "propeller 3 cut by 1 mm at both tips", {"weak_propeller.rear_left"},
    ),
    "cut_m3_both_tips_2mm": (
        "propeller 3 cut by 2 mm at both tips", {"weak_propeller.rear_left"},
    ),
    "cut_m3_one_tip_1mm": (
        "propeller 3 cut by 1 mm at one tip",
        {"weak_propeller.rear_left", "propeller_unbalance.rear_left"},
    ),
    "cut_m3_3mm": ("propeller 3 cut by 3 mm", {"weak_propeller.rear_left"}),
    "string_w2_m3": ("weight W2 on a thread near rotor 3", {"hanging_load.rear_left"}),
    "string_w3_m3": ("weight W3 on a thread near rotor 3", {"hanging_load.rear_left"}),
    "tape_m3": ("tape on propeller 3", {"weak_propeller.rear_left"}),
    "tape_m1_m3": (
        "tape on propellers 1 and 3",
        {"weak_propeller.front_right+rear_left"},
    ),
}  # fmt: skip
"""Condition -> what was done, and the answers that are right. Rotor 3 is rear left, 1 front
right."""
HELD_OUT = ((3, 4), (3,), (4,))
"""Healthy flights of the second day, counted from 0, asked against those of the first day."""
SECOND_DAY = frozenset({3, 4})


def labels(diagnosis: Diagnosis) -> set[str]:
    """Return what is said to have changed, as effect.rotor; a named pair as one."""
    found = {f"{c.effect}.{c.rotor}" if c.rotor else c.effect for c in diagnosis.changed}
    if diagnosis.verdict == "named" and len(diagnosis.changed) > 1:
        rotors = "+".join(c.rotor for c in diagnosis.changed)
        found = {f"{diagnosis.changed[0].effect}.{rotors}"}
    return found


def said(diagnosis: Diagnosis) -> str:
    """Return the verdict in a line."""
    sure = f"{100.0 * diagnosis.confidence:.0f} %"
    if diagnosis.verdict == "none":
        return f"none, {sure}"
    if diagnosis.verdict == "unknown":
        first = [f"{s.effect} {100.0 * s.probability:.0f} %" for s in diagnosis.candidates[:3]]
        return f"unknown, {sure}; most probable: {', '.join(first)}"
    return f"{diagnosis.verdict}: {', '.join(sorted(labels(diagnosis)))}; {sure}"


def verdict_on(diagnosis: Diagnosis, right: set[str]) -> str:
    """Return whether an answer is right, wrong, or says nothing."""
    if diagnosis.verdict in ("none", "unknown"):
        return "missed" if diagnosis.verdict == "none" else "not said"
    members = labels(diagnosis)
    return "yes" if members & right and len(members) <= LARGEST_SET else "no"


def calibration(answers: Sequence[tuple[float, str]]) -> list[str]:
    """Return lines: stated confidence against what was right, of named and set, in three bins."""
    lines = []
    for low, high in pairwise((0.0, 0.8, 0.9, 1.01)):
        inside = [(c, text) for c, text in answers if low <= c < high and text in ("yes", "no")]
        if inside:
            stated = 100.0 * sum(c for c, _ in inside) / len(inside)
            right = sum(text == "yes" for _, text in inside)
            lines.append(f"stated {stated:.0f} %: {right} of {len(inside)} right")
    return lines


def main(folder: Path, mapping: Path = MAPPING) -> None:
    """Print the table.

    Raises:
        InputError: the folder has no such flights.
    """
    nominal = nominal_model()

    def flights(condition: str) -> list[Flight]:
        paths = sorted(folder.glob(f"{condition}_[0-9].csv.gz"))
        if not paths:
            raise InputError(
                f"{folder}: no {condition}_[0-9].csv.gz; accepted: a folder with them"
            )
        return check_flights(read_logs(paths, mapping), needed=NEEDED)[0]

    def ask(new: Sequence[Flight], healthy: Sequence[Flight]) -> Diagnosis:
        return diagnose_change(new, healthy, nominal)[0]

    healthy = flights("normal")
    print("| what was done | what is said | right? |\n|---|---|---|")
    answers = []
    for condition, (done, right) in CONDITIONS.items():
        found = ask(flights(condition), healthy)
        answers.append((found.confidence, verdict_on(found, right)))
        print(f"| {done} | {said(found)} | {verdict_on(found, right)} |", flush=True)
    trials = [
        (f"flight {k + 1} against the four others", (k,), set(range(len(healthy))) - {k})
        for k in range(len(healthy))
    ]
    first_day = set(range(len(healthy))) - SECOND_DAY
    for held in HELD_OUT:
        names = " and ".join(str(k + 1) for k in held)
        trials.append((f"flight {names} of the second day against the first day", held, first_day))
    for name, held, others in trials:
        found = ask([healthy[k] for k in held], [healthy[k] for k in sorted(others)])
        right = "yes" if found.verdict == "none" else "no"
        print(f"| nothing: {name} | {said(found)} | {right} |", flush=True)
    counts = Counter(text for _, text in answers)
    print("\nConditions: " + ", ".join(f"{text} {n}" for text, n in counts.items()))
    print("\n".join(calibration(answers)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mapping", type=Path, default=MAPPING, help="default: %(default)s")
    given = parser.parse_args()
    try:
        main(given.folder, given.mapping)
    except InputError as error:
        raise SystemExit(f"crazypad: {error}") from None

"""The score of many blind stand cases: as for flights, and by what the stand measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tombo_diagnosis.benchmark.flight_score import score
from tombo_diagnosis.benchmark.stand_cases import STANDS

Row = Mapping[str, Any]
_MOST_MEMBERS = 6
_SAYS = ("named", "set", "partly_explained")


def aggregate(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of all cases together, and of each kind of stand.

    `top1_*` is as for flights: the truth stands first, also in a set. `answer_*` counts a set of
    at most six that holds the truth as well: where nothing measured separates causes, such as a
    coefficient, the cell's gain and the air's density in thrust alone, a set is the right answer
    and its order is chance. Of `full` stands nothing is confounded by construction.
    """
    result = _score(rows)
    for stand, _ in STANDS:
        result[stand] = _score([r for r in rows if r["formulation"] == stand])
    return result


def _score(rows: Sequence[Row]) -> dict[str, Any]:
    result = score(rows)
    for size in ("large", "medium", "small"):
        own = [r for r in rows if r["kind"] == "single" and r["size"] == size]
        result[f"answer_{size}"] = sum(map(_answers, own)) / len(own) if own else None
    return result


def _answers(row: Row) -> bool:
    if row["verdict"] not in _SAYS:
        return False
    if row["causes"][:1] == row["hidden"]:
        return True
    members = set(row["set"])
    return row["hidden"][0] in members and len(members) <= _MOST_MEMBERS

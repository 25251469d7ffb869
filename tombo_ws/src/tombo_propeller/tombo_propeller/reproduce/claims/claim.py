"""A claim of the paper, the value by the laws, and the rule of its verdict.

`claims.yaml` is the table of all claims. For each row a function of the same name, marked with
`judges`, draws value and verdict from printed and computed values alone.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal

from tombo_dynamics.yaml_text import read_yaml
from tombo_propeller.reproduce.computed_values import Numbers
from tombo_propeller.reproduce.paper_values import Paper

Verdict = Literal["holds", "fails", "can't be checked"]

HOLDS: Final = "holds"
FAILS: Final = "fails"
OPEN: Final = "can't be checked"

DATA: Final = "data"
"""Stands in place of a law where a claim is about measurements alone."""


@dataclass(frozen=True)
class ClaimResult:
    """Result of a claim, under one law or from measurements alone."""

    value: float | None
    """None where the law has no such number."""
    verdict: Verdict
    texts: Mapping[str, object] = field(default_factory=dict)
    """Values for the braces in the claim's texts; those of the judging law count."""
    each: Mapping[str, object] = field(default_factory=dict)
    """The same, told law by law."""


ClaimFunction = Callable[..., ClaimResult]
"""Takes the paper and, where a claim is about the laws, a law's numbers and those of all laws."""
JUDGES: Final[dict[str, ClaimFunction]] = {}
"""Name of a claim -> the function that judges it."""


def judges(function: ClaimFunction) -> ClaimFunction:
    """Mark a function as the judge of the claim of its name."""
    JUDGES[function.__name__] = function
    return function


def holds_if(condition: bool) -> Verdict:
    """Return "holds" or "fails"."""
    return HOLDS if condition else FAILS


class PerLaw(dict[str, Any]):
    """A number or text of each law, told by a format such as `{gain:.1f %}` or `{gain.joined}`."""

    def __format__(self, form: str) -> str:
        """Return the numbers in words, once if they are all the same; text about them is kept."""
        found = re.fullmatch(r"(.*?)([+.\d]+[a-z])(.*)", form)
        before, number, after = found.groups() if found else ("", ".3g", "")
        texts = ["none" if v is None else f"{before}{v:{number}}{after}" for v in self.values()]
        if len(set(texts)) == 1:
            return texts[0] + (" in every law" if len(texts) > 1 else "")
        return ", ".join(f"{law} {text}" for law, text in zip(self, texts, strict=True))

    @property
    def listed(self) -> str:
        """The texts of all laws, with commas."""
        return ", ".join(f"{law} {text}" for law, text in self.items())

    @property
    def joined(self) -> str:
        """The texts of all laws, with semicolons."""
        return "; ".join(f"{law} {text}" for law, text in self.items())


@dataclass(frozen=True)
class Claim:
    """One claim with its verdict."""

    name: str
    group: str
    kind: str
    """printed, stated or check, see `claims.yaml`."""
    claim: str
    source: str
    paper: str
    """The paper's statement, as printed."""
    quantity: str
    """What `computed` is."""
    unit: str
    computed: Mapping[str, float | None]
    """By law, or under "data"; None where a law has no such number."""
    tolerance: str
    verdicts: Mapping[str, Verdict]
    deciding_law: str
    """The law, or "data", whose verdict is the claim's."""
    evidence: str

    @property
    def verdict(self) -> Verdict:
        """The verdict under the law that the claim is about."""
        return self.verdicts[self.deciding_law]

    @property
    def law(self) -> str | None:
        """The laws under which this verdict stands, or None where no law is concerned."""
        if self.deciding_law == DATA:
            return None
        return ", ".join(law for law, v in self.verdicts.items() if v == self.verdict)

    @property
    def disputed(self) -> bool:
        """Whether another law says otherwise."""
        return len(set(self.verdicts.values())) > 1

    def mapping(self) -> dict[str, object]:
        """Return the claim as plain values, for JSON."""
        values = dataclasses.asdict(self) | {"law": self.law, "verdict": self.verdict}
        del values["deciding_law"]
        return values


@lru_cache(maxsize=1)
def claim_texts() -> Mapping[str, Mapping[str, Mapping[str, Any]]]:
    """Return what `claims.yaml` says: group -> name -> texts."""
    path = Path(__file__).with_name("claims.yaml")
    content: Mapping[str, Mapping[str, Mapping[str, Any]]] = read_yaml(path, path.name)
    return content


def all_claims(paper: Paper, numbers: Numbers) -> tuple[Claim, ...]:
    """Return every claim with its verdict, in the order of `claims.yaml`."""
    return tuple(
        _claim(name, group, row, paper, numbers)
        for group, rows in claim_texts().items()
        for name, row in rows.items()
    )


def _claim(name: str, group: str, row: Mapping[str, Any], paper: Paper, numbers: Numbers) -> Claim:
    """Judge a row of the table; a law that is not computed gives way to the first that is."""
    evaluate, wanted = JUDGES[name], row.get("judge", "published")
    if wanted == DATA:
        found = {DATA: evaluate(paper)}
    else:
        found = {law: evaluate(paper, values, numbers) for law, values in numbers.laws.items()}
    wanted = wanted if wanted in found else next(iter(found))
    computed = PerLaw({law: one.value for law, one in found.items()})
    texts: dict[str, Any] = {"law": wanted, "computed": computed, **found[wanted].texts}
    for key in found[wanted].each:
        texts[key] = PerLaw({law: one.each[key] for law, one in found.items()})
    source = row.get("source", "")
    if "printed" in row:
        source = source or paper.source(*row["printed"])
        texts["printed"] = paper.text(*row["printed"])
    filled = ("claim", "paper", "quantity", "tolerance", "evidence")
    return Claim(
        name=name,
        group=group,
        kind=row["kind"],
        source=source.format(**texts),
        unit=row.get("unit", "1"),
        computed=dict(computed),
        verdicts={law: one.verdict for law, one in found.items()},
        deciding_law=wanted,
        **{key: row[key].format(**texts) for key in filled},
    )

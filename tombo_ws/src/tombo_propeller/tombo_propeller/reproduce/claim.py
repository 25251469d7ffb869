"""A claim of the paper, what the laws make of it, and how its verdict follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper

Verdict = Literal["holds", "fails", "can't be checked"]

HOLDS: Final = "holds"
FAILS: Final = "fails"
OPEN: Final = "can't be checked"

Kind = Literal["printed", "stated", "check"]
"""A number that the paper prints; a sentence of it; or a test of ours that its figures allow."""

DATA: Final = "data"
"""Stands in place of a law where a claim is about measurements alone."""


@dataclass(frozen=True)
class Claim:
    """One claim with its verdict."""

    name: str
    group: str
    kind: Kind
    claim: str
    source: str
    paper: str
    """What the paper says, as printed."""
    quantity: str
    """What `computed` is."""
    unit: str
    computed: Mapping[str, float | None]
    """By law, or under "data"; None where a law has no such number."""
    tolerance: str
    verdicts: Mapping[str, Verdict]
    """By law, or under "data"."""
    judge: str
    """The law, or "data", whose verdict is the claim's."""
    evidence: str

    @property
    def verdict(self) -> Verdict:
        """The verdict under the law that the claim is about."""
        return self.verdicts[self.judge]

    @property
    def law(self) -> str | None:
        """The laws under which this verdict stands, or None where no law is concerned."""
        if self.judge == DATA:
            return None
        return ", ".join(law for law, v in self.verdicts.items() if v == self.verdict)

    @property
    def disputed(self) -> bool:
        """Whether another law says otherwise."""
        return len(set(self.verdicts.values())) > 1

    def mapping(self) -> dict[str, object]:
        """Return the claim as plain values, for JSON."""
        return {
            "name": self.name,
            "group": self.group,
            "kind": self.kind,
            "claim": self.claim,
            "source": self.source,
            "paper": self.paper,
            "computed": dict(self.computed),
            "quantity": self.quantity,
            "unit": self.unit,
            "tolerance": self.tolerance,
            "law": self.law,
            "verdict": self.verdict,
            "verdicts": dict(self.verdicts),
            "evidence": self.evidence,
        }


Maker = Callable[[Paper, Numbers], Claim]
"""Draws a claim from what is printed and what is computed, and from nothing else."""


def holds_if(condition: bool) -> Verdict:
    """Return "holds" or "fails"."""
    return HOLDS if condition else FAILS


def by_law(
    numbers: Numbers, value: Callable[[LawNumbers], float | None]
) -> dict[str, float | None]:
    """Return a number of each law."""
    return {name: value(law) for name, law in numbers.laws.items()}


def verdicts(
    computed: Mapping[str, float | None], accept: Callable[[float], bool]
) -> dict[str, Verdict]:
    """Return a verdict for each law: a law that has no such number does not fulfil the claim."""
    return {law: holds_if(v is not None and accept(v)) for law, v in computed.items()}


def judge_of(numbers: Numbers, preferred: str = "published") -> str:
    """Return the law that a claim is about, or the first computed where that is left out.

    The paper's numbers come from its program, which is the law `published`.
    """
    return preferred if preferred in numbers.laws else next(iter(numbers.laws))


def each(computed: Mapping[str, float | None], form: str = "{:.3g}") -> str:
    """Return the numbers of the laws in words, once if they are all the same."""
    texts = ["none" if v is None else form.format(v) for v in computed.values()]
    if len(set(texts)) == 1:
        return texts[0] + (" in every law" if len(texts) > 1 else "")
    return ", ".join(f"{law} {text}" for law, text in zip(computed, texts, strict=True))


def joined(texts: Mapping[str, str]) -> str:
    """Return a text of each law as one."""
    return "; ".join(f"{law} {text}" for law, text in texts.items())

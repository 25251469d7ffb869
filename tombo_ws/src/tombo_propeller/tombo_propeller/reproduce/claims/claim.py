"""A claim of the paper, what the laws make of it, and how its verdict follows.

The texts of all claims are in `claims.yaml`. For each of them a function of the same name, marked
with `judges`, draws the outcome from what is printed and what is computed, and from nothing else.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal

from tombo_dynamics.yaml_text import read_yaml
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper

Verdict = Literal["holds", "fails", "can't be checked"]

HOLDS: Final = "holds"
FAILS: Final = "fails"
OPEN: Final = "can't be checked"

DATA: Final = "data"
"""Stands in place of a law where a claim is about measurements alone."""


@dataclass(frozen=True)
class ClaimOutcome:
    """What a claim comes to."""

    computed: Mapping[str, float | None]
    """By law, or under "data"; None where a law has no such number."""
    verdicts: Mapping[str, Verdict]
    """By law, or under "data"."""
    judge: str
    """The law, or "data", whose verdict is the claim's."""
    evidence: str
    texts: Mapping[str, object]
    """What the claim's texts have in braces."""


Judge = Callable[[Paper, Numbers], ClaimOutcome]
JUDGES: Final[dict[str, Judge]] = {}
"""Name of a claim -> the function that judges it."""


def judges(function: Judge) -> Judge:
    """Mark a function as the judge of the claim of its name."""
    JUDGES[function.__name__] = function
    return function


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
    """What the paper says, as printed."""
    quantity: str
    """What `computed` is."""
    unit: str
    computed: Mapping[str, float | None]
    tolerance: str
    verdicts: Mapping[str, Verdict]
    judge: str
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
        values = dataclasses.asdict(self) | {"law": self.law, "verdict": self.verdict}
        del values["judge"]
        return values


@lru_cache(maxsize=1)
def claim_texts() -> Mapping[str, Mapping[str, Mapping[str, Any]]]:
    """Return what `claims.yaml` says: group -> name -> texts."""
    path = Path(__file__).with_name("claims.yaml")
    content: Mapping[str, Mapping[str, Mapping[str, Any]]] = read_yaml(path, path.name)
    return content


def judged_claims(paper: Paper, numbers: Numbers) -> tuple[Claim, ...]:
    """Return every claim with its verdict, in the order of `claims.yaml`."""
    return tuple(
        _judged(name, group, texts, paper, numbers)
        for group, claims in claim_texts().items()
        for name, texts in claims.items()
    )


def _judged(
    name: str, group: str, texts: Mapping[str, Any], paper: Paper, numbers: Numbers
) -> Claim:
    outcome = JUDGES[name](paper, numbers)
    values = dict(outcome.texts)
    source = texts.get("source", "")
    if "printed" in texts:
        section, key = texts["printed"]
        source = source or paper.source(section, key)
        printed = paper.texts[section][key]["printed"]
        values["printed"] = printed
    filled = {
        key: texts[key].format(**values) for key in ("claim", "paper", "quantity", "tolerance")
    }
    return Claim(
        name=name,
        group=group,
        kind=texts["kind"],
        source=source.format(**values),
        unit=texts.get("unit", "1"),
        computed=outcome.computed,
        verdicts=outcome.verdicts,
        judge=outcome.judge,
        evidence=outcome.evidence,
        **filled,
    )


def of_data(value: float, verdict: Verdict, evidence: str, **texts: object) -> ClaimOutcome:
    """Return the outcome of a claim about measurements alone."""
    return ClaimOutcome({DATA: value}, {DATA: verdict}, DATA, evidence, texts)


def of_laws(
    numbers: Numbers,
    computed: Mapping[str, float | None],
    accept: Callable[[float], bool] | Mapping[str, Verdict],
    evidence: str,
    *,
    law: str = "published",
    **texts: object,
) -> ClaimOutcome:
    """Return the outcome of a claim about the laws.

    Args:
        numbers: all that is computed.
        computed: by law; one that has no such number does not fulfil the claim.
        accept: says of a number whether the claim holds; or the verdict of each law.
        evidence: in words.
        law: whose verdict is the claim's, where it is computed.
        texts: what the claim's texts have in braces.
    """
    if isinstance(accept, Mapping):
        verdicts = accept
    else:
        verdicts = {name: holds_if(v is not None and accept(v)) for name, v in computed.items()}
    return ClaimOutcome(computed, verdicts, judge_of(numbers, law), evidence, texts)


def holds_if(condition: bool) -> Verdict:
    """Return "holds" or "fails"."""
    return HOLDS if condition else FAILS


def by_law(
    numbers: Numbers, value: Callable[[LawNumbers], float | None]
) -> dict[str, float | None]:
    """Return a number of each law."""
    return {name: value(law) for name, law in numbers.laws.items()}


def judge_of(numbers: Numbers, preferred: str = "published") -> str:
    """Return the law that a claim is about, or the first computed where that is left out.

    The paper's numbers come from its program, which is the law `published`.
    """
    return preferred if preferred in numbers.laws else next(iter(numbers.laws))


def per_law(computed: Mapping[str, float | None], form: str = "{:.3g}") -> str:
    """Return the numbers of the laws in words, once if they are all the same."""
    texts = ["none" if v is None else form.format(v) for v in computed.values()]
    if len(set(texts)) == 1:
        return texts[0] + (" in every law" if len(texts) > 1 else "")
    return ", ".join(f"{law} {text}" for law, text in zip(computed, texts, strict=True))


def joined(texts: Mapping[str, str]) -> str:
    """Return a text of each law as one."""
    return "; ".join(f"{law} {text}" for law, text in texts.items())

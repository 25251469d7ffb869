"""The whole reproduction: printed values, computed values, and all claims."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

from tombo_dynamics.propeller import LAWS
from tombo_propeller.reproduce.claims import experiment_claims, model_claims  # noqa: F401  each registers the judges of its claims
from tombo_propeller.reproduce.claims.claim import (
    FAILS,
    HOLDS,
    OPEN,
    Claim,
    all_claims,
    claim_texts,
)
from tombo_propeller.reproduce.computed_values import Numbers, compute
from tombo_propeller.reproduce.paper_values import Paper, read_paper

GROUPS: Final = tuple(claim_texts())
"""Order in which claims are shown."""


@dataclass(frozen=True)
class Reproduction:
    """The paper, the laws' numbers, and the claims in the order of `GROUPS`."""

    paper: Paper
    numbers: Numbers

    @cached_property
    def claims(self) -> tuple[Claim, ...]:
        """Every claim, judged from printed and computed values."""
        return all_claims(self.paper, self.numbers)

    def claim(self, name: str) -> Claim:
        """Return a claim by its name."""
        return next(claim for claim in self.claims if claim.name == name)

    def laws(self, name: str) -> list[str]:
        """Return the laws under which a claim holds."""
        return [law for law, v in self.claim(name).verdicts.items() if v == HOLDS]

    def counts(self, *, checks: bool = False) -> dict[str, int]:
        """Return how many of the paper's claims, or of our checks, have which verdict."""
        verdicts = [c.verdict for c in self.claims if (c.kind == "check") == checks]
        return {verdict: verdicts.count(verdict) for verdict in (HOLDS, FAILS, OPEN)}

    def mapping(self) -> dict[str, Any]:
        """Return the content of `reproduction.json`: the claims and the numbers behind them."""
        return {
            "claims": [claim.mapping() for claim in self.claims],
            "verdicts": {"paper": self.counts(), "checks": self.counts(checks=True)},
            "computed": dataclasses.asdict(self.numbers),
        }


@lru_cache(maxsize=8)
def reproduce(laws: tuple[str, ...] = tuple(LAWS)) -> Reproduction:
    """Recompute the paper under some laws, all by default; a second or two.

    Raises:
        InputError: unknown law.
    """
    paper = read_paper()
    low, high = (float(s) for s in paper.texts["model"]["thrust_speeds_rpm"])
    return Reproduction(paper, compute(laws, (low, high)))


def headline(r: Reproduction) -> str:
    """Return the outcome in one sentence."""
    counts = r.counts()
    some = sum(c.verdict == HOLDS and c.disputed for c in r.claims if c.kind != "check")
    where = f" ({some} of them not in every law)" if some else ""
    return (
        f"Of the paper’s {sum(counts.values())} claims {_plural(counts[HOLDS], 'hold')}{where}, "
        f"{_plural(counts[FAILS], 'fail')}, {counts[OPEN]} can’t be checked"
    )


def _plural(count: int, verb: str) -> str:
    return f"{count} {verb}{'s' if count == 1 else ''}"


def checks_summary(r: Reproduction) -> str:
    """Return how our own checks came out, in one sentence."""
    counts = r.counts(checks=True)
    return (
        f"Of our own {sum(counts.values())} checks of its printed figures "
        f"{_plural(counts[HOLDS], 'hold')}, {_plural(counts[FAILS], 'fail')}, "
        f"{counts[OPEN]} can’t be decided."
    )

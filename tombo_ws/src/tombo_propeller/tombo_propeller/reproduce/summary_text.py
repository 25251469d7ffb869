"""Claims in words and figures, for terminal, page and documentation alike."""

from __future__ import annotations

from typing import Final

from tombo_propeller.reproduce.claims.claim import DATA, FAILS, HOLDS, OPEN, Claim
from tombo_propeller.reproduce.reproduction import Reproduction

LABELS: Final = {HOLDS: "holds", FAILS: "fails", OPEN: "can’t be checked"}
MARKS: Final = {HOLDS: "✓", FAILS: "✗", OPEN: "?"}
KINDS: Final = {"printed": "printed number", "stated": "statement", "check": "our check"}


def shown(value: float | None) -> str:
    """Return a computed number with the digits that matter."""
    if value is None:
        return "none"
    if abs(value) < 1e-12:
        return "0"  # rounding, another on each machine
    if value == round(value) and abs(value) < 1e6:
        return f"{value:.0f}"
    if abs(value) < 1e-3:
        return f"{value:.0e}"
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


def with_unit(value: float | None, unit: str) -> str:
    """Return a computed number with its unit, that of a pure number left out."""
    if value is None:
        return "none"
    sign = {"deg": "°", "1": ""}.get(unit, f" {unit}")
    return f"{'−' if value < 0.0 else ''}{shown(abs(value))}{sign}"


def verdict_text(claim: Claim) -> str:
    """Return the verdict, and under which laws it stands if another law says otherwise."""
    text = LABELS[claim.verdict]
    return f"{text} ({claim.law})" if claim.disputed and claim.law else text


def computed_text(claim: Claim) -> str:
    """Return the computed numbers by law, or the one number where no law is concerned."""
    if claim.judge == DATA:
        return with_unit(claim.computed[DATA], claim.unit)
    values = {with_unit(v, claim.unit) for v in claim.computed.values()}
    if len(values) == 1:
        return f"{values.pop()} in every law" if len(claim.computed) > 1 else values.pop()
    return ", ".join(f"{law} {with_unit(v, claim.unit)}" for law, v in claim.computed.items())


def headline(r: Reproduction) -> str:
    """Return the outcome in one sentence."""
    counts = r.counts()
    some = sum(c.verdict == HOLDS and c.disputed for c in r.claims if c.kind != "check")
    where = f" ({some} of them not in every law)" if some else ""
    return (
        f"Of the paper’s {sum(counts.values())} claims {_plural(counts[HOLDS], 'hold')}{where}, "
        f"{_plural(counts[FAILS], 'fail')}, {counts[OPEN]} can’t be checked"
    )


def checks_line(r: Reproduction) -> str:
    """Return how our own checks came out."""
    counts = r.counts(checks=True)
    return (
        f"Of {sum(counts.values())} checks that its figures allow "
        f"{_plural(counts[HOLDS], 'hold')}, {_plural(counts[FAILS], 'fail')}, "
        f"{counts[OPEN]} can’t be decided"
    )


def _plural(count: int, verb: str) -> str:
    return f"{count} {verb}{'s' if count == 1 else ''}"


def summary(r: Reproduction) -> str:
    """Return what a reader should take away, drawn from the claims."""
    parts = []
    moduli, ratio = r.claim("table_1"), r.claim("table_3_lift_over_drag")
    if moduli.verdict == HOLDS and ratio.verdict == HOLDS:
        parts.append("The paper’s computed tables are reproduced to the last printed digit")
        if ratio.disputed:
            parts[-1] += f", lift over drag by law {ratio.law} only, with its program’s defects"
    same = [r.claim(name) for name in ("gamma_mtf", "gamma_mld", "eps_mld_same")]
    if all(claim.verdict == HOLDS for claim in same):
        parts.append("What is “the same for every configuration” is so by theorem")
    verdict = r.claim("thrust_follows_stiffness").verdict
    if verdict != HOLDS:
        parts.append("Measured thrust shows no order by stiffness, which every law says it should")
        parts[-1] += "" if verdict == FAILS else "; its printed scatter could hide it"
    force = r.claim("collision_force")
    if force.verdict == FAILS:
        parts.append(
            f"Collision force reaches {with_unit(force.computed[DATA], force.unit)} of the rigid "
            f"propeller’s, where the abstract has {force.paper}"
        )
    missing = "Twist, torque and thrust above 3200 rpm were not measured: there the laws differ"
    return ". ".join([checks_line(r), *parts, missing]) + "."

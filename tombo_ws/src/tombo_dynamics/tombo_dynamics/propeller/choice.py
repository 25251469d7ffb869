"""Which propeller is mounted: the parameters of whoever needs its thrust map."""

from __future__ import annotations

from dataclasses import dataclass, field

from tombo_dynamics.params import param


@dataclass(frozen=True)
class PropellerChoice:
    """Which propeller is mounted, and the law of its nodus."""

    conf: int = param(13, "1", (0, 13), "configuration of the paper's Table I; 0 is rigid")
    law: str = field(default="repaired", metadata={"doc": "published, repaired or consistent"})

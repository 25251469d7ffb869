"""What can be wrong with the nodus: its stiffness, its load, the disputed in-plane term."""

from __future__ import annotations

from tombo_dynamics.propeller.effects.registry import Param, Stage, stand_effect
from tombo_dynamics.propeller.effects.run_state import DRAG, LIFT, Run
from tombo_dynamics.propeller.laws.parameters import SCALARS

_TOMBO = ("tombo",)


@stand_effect(
    "centrifugal_stiffening",
    Stage.PROPELLER,
    [
        Param(
            "moment",
            "kg m^2",
            0.0,
            (0.0, 2e-5),
            "twist stiffness per omega^2: the wing's propeller moment and the fibres' tension",
            4e-7,
        )
    ],
    signature="soft propellers keep their thrust at speed: the loss by twist stops growing",
    separates_from={
        "torsion_constant": "two speeds far apart: a constant acts at all of them alike",
        "in_plane_term": "a soft and a stiff nodus at high speed, with the flap angle",
    },
    models=_TOMBO,
    saturates=True,
)
def centrifugal_stiffening(m: Run, moment: float) -> None:
    """Stiffen the twist with omega^2: 1 / C = 1 / C_0 + moment omega^2."""
    compliance = m.rows[:, SCALARS["twist_compliance"]]
    m.scale("twist_compliance", 1.0 / (1.0 + compliance * moment * m.speed**2))


@stand_effect(
    "torsion_constant",
    Stage.PROPELLER,
    [Param("factor", "1", 1.0, (0.02, 10.0), "true J over that of the model", 0.6)],
    signature="thrust falls short (or not) by twist, at every speed, most with soft nodi",
    separates_from={"load_sharing": "the flap angle: the load bends, the torsion constant not"},
    models=_TOMBO,
)
def torsion_constant(m: Run, factor: float) -> None:
    """Multiply the section's torsion constant J; the drawn camber line may be 13 times off."""
    m.scale("twist_compliance", 1.0 / factor)


@stand_effect(
    "load_sharing",
    Stage.PROPELLER,
    [Param("share", "1", 1.0, (0.1, 2.0), "of both wings' load that a nodus carries", 0.5)],
    signature="flap, lag and twist are all smaller than the model's, thrust of soft ones higher",
    separates_from={"torsion_constant": "the flap angle"},
    models=_TOMBO,
)
def load_sharing(m: Run, share: float) -> None:
    """Let a nodus carry a share of the propeller's load: one of two wings carries half."""
    m.rows[:, LIFT] *= share
    m.rows[:, DRAG] *= share
    m.share *= share


@stand_effect(
    "in_plane_term",
    Stage.PROPELLER,
    [Param("blend", "1", 0.0, (0.0, 1.0), "0: the law's own term, 1: the other law's", 1.0)],
    signature="no maximum of thrust: at high speed soft propellers gain against the law",
    separates_from={"centrifugal_stiffening": "thrust of a soft nodus towards its maximum"},
    models=_TOMBO,
)
def in_plane_term(m: Run, blend: float) -> None:
    """Move from one law's in-plane force in the twist to the other's (repaired, consistent)."""
    m.other_law += blend

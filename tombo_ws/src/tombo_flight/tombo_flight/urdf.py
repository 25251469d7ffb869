"""A vehicle as URDF, for robot_state_publisher and viewers: arms, rotors, folding blades."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

from tombo_dynamics.frames import FRAME_BODY
from tombo_dynamics.vehicle import ROTOR_NAMES, SPIN
from tombo_flight.vehicle_file import VehicleFile

_CHORD_M, _THICKNESS_M = 0.02, 0.002
"""Chord and thickness of a drawn blade; no model reads them."""
_BLADE_YAWS_RAD = (0.0, math.pi)


def vehicle_urdf(vehicle: VehicleFile) -> str:
    """Return the text of a URDF, in base_link (FLU, m, kg).

    The rotors are continuous joints, `front_left_rotor`. On each are two blades behind a joint at
    the nodus, `front_left_fold_0`, from 0 (straight) to a right angle back, against the rotation.
    Propellers that do not fold have fixed blades.
    """
    params = vehicle.vehicle
    nodus, length = params.nodus_radius, params.rotor_radius - params.nodus_radius
    moments = " ".join(f'i{a}{a}="{getattr(params, f"inertia_{a}{a}"):g}"' for a in "xyz")
    width = 2.0 * params.arm_radius
    arm = (2.0 * params.arm_length, width, width)
    lines = [
        f"<robot name={quoteattr(vehicle.name)}>",
        f'  <link name="{FRAME_BODY}">',
        f'    <inertial><mass value="{params.mass:g}"/>',
        f'      <inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial>',
        *(_box(arm, (0.0, 0.0, 0.0), sign * math.pi / 4.0) for sign in (1.0, -1.0)),
        "  </link>",
    ]
    blade = _box((length, _CHORD_M, _THICKNESS_M), (0.5 * length, 0.0, 0.0))
    for rotor, hub, spin in zip(ROTOR_NAMES, params.rotor_positions(), SPIN, strict=True):
        turns = f'<axis xyz="0 0 {spin:g}"/>'
        folds = f'<axis xyz="0 0 {-spin:g}"/>'
        folds += f'<limit lower="0" upper="{math.pi / 2.0:.6f}" effort="0" velocity="0"/>'
        kind = "revolute" if vehicle.propeller.folds else "fixed"
        root = f"{rotor}_rotor"
        lines += [
            f'  <link name="{root}"/>',
            _joint(root, "continuous", FRAME_BODY, hub, 0, turns),
        ]
        for k, yaw in enumerate(_BLADE_YAWS_RAD):
            name = f"{rotor}_fold_{k}"
            place = (nodus * math.cos(yaw), nodus * math.sin(yaw), 0.0)
            lines += [f'  <link name="{name}">', blade, "  </link>"]
            lines += [_joint(name, kind, root, place, yaw, folds if kind == "revolute" else "")]
    return "\n".join([*lines, "</robot>", ""])


def _joint(
    name: str, kind: str, parent: str, place: Sequence[float], yaw: float, more: str
) -> str:
    return (
        f'  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/>'
        f"{_origin(place, yaw)}{more}</joint>"
    )


def _box(size: Sequence[float], place: Sequence[float], yaw: float = 0.0) -> str:
    shape = f'<geometry><box size="{_text(size)}"/></geometry>'
    return f"    <visual>{_origin(place, yaw)}{shape}</visual>"


def _origin(place: Sequence[float], yaw: float) -> str:
    return f'<origin xyz="{_text(place)}" rpy="0 0 {yaw:.6f}"/>'


def _text(values: Sequence[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)

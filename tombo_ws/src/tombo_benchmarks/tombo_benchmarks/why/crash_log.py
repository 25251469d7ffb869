"""A crash as a laboratory would record it: a table and its mapping."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from tombo_benchmarks.why.mishap import Array, Mishap

COLUMNS: Final = (
    "t,x,y,z,qx,qy,qz,qw,wx,wy,wz,ax,ay,az,n1,n2,n3,n4,c1,c2,c3,c4,v,sx,sy,sz"  # as simulated
)
_POSE_NOISE, _TURN_NOISE, _GYRO_NOISE, _ACCEL_NOISE = 0.0006, 0.002, 0.01, 0.15
"""m, 1, rad/s, m/s^2"""


def write_crash(
    folder: Path, rows: Array, mishap: Mishap, order: tuple[int, ...], rng: np.random.Generator
) -> tuple[Path, Path]:
    """Write log and mapping; its poses are the controller's.

    Args:
        folder: where.
        rows: (N, 26), in the columns of COLUMNS.
        mishap: the hidden one.
        order: columns (from 0) of the rotors in the order of ROTOR_NAMES.
        rng: of the noise and the choice of channels.
    """
    values = rows.copy()
    values[:, 1:4] = rows[:, 23:26]
    lost = mishap.kind == "poses_frozen" and not mishap.gap
    after = rows[:, 0] >= mishap.time
    for columns, size in (
        (slice(1, 4), _POSE_NOISE), (slice(4, 8), _TURN_NOISE), (slice(8, 11), _GYRO_NOISE),
        (slice(11, 14), _ACCEL_NOISE), (slice(14, 18), 2.0), (slice(22, 23), 0.01),
    ):  # fmt: skip
        noisy = values[:, columns] + size * rng.standard_normal(values[:, columns].shape)
        values[:, columns] = noisy
    values[:, 4:8] /= np.linalg.norm(values[:, 4:8], axis=1, keepdims=True)
    if lost and after.any():
        values[after, 1:8] = values[int(np.argmax(after)), 1:8]
    absent = after & (mishap.kind == "poses_frozen") & mishap.gap
    every = int(rng.integers(1, 4))
    has_imu, has_speed = rng.uniform() < 0.85, rng.uniform() < 0.5
    has_voltage = mishap.kind == "battery_empty" or rng.uniform() < 0.7
    lines = [",".join(COLUMNS.split(",")[:23])]
    for k, row in enumerate(values[:, :23]):
        cells = [f"{x:.7g}" for x in row]
        if k % every or absent[k]:
            cells[1:8] = [""] * 7
        lines.append(",".join(cells))
    log, mapping = folder / "crash.csv", folder / "mapping.yaml"
    log.write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = [
        "about: simulated crash", "time: {column: t, unit: s}", "channels:",
        "  position: {columns: [x, y, z], unit: m}",
        "  attitude: {columns: [qx, qy, qz, qw], order: xyzw}",
        f"  rotor_command: {{columns: [{_rotors('c', order)}], unit: rad/s}}",
    ]  # fmt: skip
    if has_imu:
        text.append("  gyro: {columns: [wx, wy, wz], unit: rad/s}")
        text.append("  accel: {columns: [ax, ay, az], unit: m/s^2}")
    if has_speed:
        text.append(f"  rotor_speed: {{columns: [{_rotors('n', order)}], unit: rad/s}}")
    if has_voltage:
        text.append("  voltage: {columns: [v], unit: V}")
    mapping.write_text("\n".join(text) + "\n", encoding="utf-8")
    return log, mapping


def _rotors(letter: str, order: tuple[int, ...]) -> str:
    return ", ".join(f"{letter}{k + 1}" for k in order)

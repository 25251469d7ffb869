"""The propeller's equations solved a second way: quadrature and scipy's root finders.

It shares no code, no data file and no method with tombo_dynamics, and is a thousand times slower.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq, root

AIR = 1.2041
L, R_N, X_C, M_W = 0.012, 0.035, 66.64e-3, 5.715e-3
I_F, I_L, DY, DZ, J = 505.97e-12, 978.74e-12, 3.15e-3, 0.76e-3, 4.704e-9
FLAP, LAG = 0.1221, 0.1418
WEIGHT = M_W * 9.8
JOIN, TIP = 0.030, 0.110
STRAIN = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 16, 18, 20)
SECANT = {
    "DragonSkin10": ".113333333 .113333333 .111111111 .11 .109333333 .108888889 .106666667 "
    ".105833333 .105185185 .104 .103333333 .102857143 .100416667 .099259259 .098333333",
    "DragonSkin20": ".426666667 .426666667 .426666667 .425 .424 .421111111 .417142857 "
    ".415833333 .411111111 .407333333 .401111111 .395238095 .39 .386296296 .381333333",
    "DragonSkin30": ".58 .58 .573333333 .568333333 .562666667 .556666667 .551428571 "
    ".545833333 .540740741 .54 .531666667 .523333333 .514583333 .506666667 .499",
}
TABLE_1 = {
    1: ("DragonSkin10", 6, 0.94),
    2: ("DragonSkin20", 6, 0.94),
    3: ("DragonSkin30", 6, 0.94),
    4: ("DragonSkin30", 6, 0.38),
    5: ("DragonSkin10", 5, 0.50),
    6: ("DragonSkin10", 5, 0.75),
    7: ("DragonSkin10", 5, 0.90),
    8: ("DragonSkin20", 5, 0.50),
    9: ("DragonSkin20", 5, 0.75),
    10: ("DragonSkin20", 5, 0.90),
    11: ("DragonSkin30", 5, 0.50),
    12: ("DragonSkin30", 5, 0.75),
    13: ("DragonSkin30", 5, 0.90),
}


def depth_and_pitch(x: float) -> tuple[float, float]:
    if x < JOIN:
        depth = 12.2 * x**2 - 0.2966 * x + 0.012666
        return depth, -29900 * x**2 + 1356.9 * x + 22.7385
    depth = (
        -63.413950234699534 * x**3
        + 3.1072180076641702 * x**2
        + 0.5006410825077106 * x
        - 0.0014058398488334472
    )
    pitch = (
        -27306.834004968892 * x**3
        + 6959.763620350375 * x**2
        - 741.0050364001363 * x
        + 53.295456490008505
    )
    return depth, pitch


def sind(degrees: float) -> float:
    return math.sin(math.radians(degrees))


def cosd(degrees: float) -> float:
    return math.cos(math.radians(degrees))


def span_load(
    kind: str, power: int, start: float, end: float, gamma: float = 0.0, sign: float = -1.0
) -> float:
    """Integral of depth x^power C(theta - gamma) cos(theta + sign gamma) / cos(theta)."""
    g = math.degrees(gamma)

    def integrand(x: float) -> float:
        depth, theta = depth_and_pitch(x)
        if kind == "lift":
            c = 0.225 + 1.58 * sind(2.13 * (theta - g) - 7.2)
        else:
            c = 1.92 - 1.55 * cosd(2.04 * (theta - g) - 9.82)
        return depth * x**power * c * cosd(theta + sign * g) / cosd(theta)

    total = 0.0
    for a, b in ((start, min(end, JOIN)), (max(start, JOIN), end)):
        if a < b:
            total += quad(integrand, a, b, epsabs=1e-16, epsrel=1e-10)[0]
    return total


def moduli(conf: int, fibres: int | None = None, fibre_shear: float = 75.0) -> tuple[float, float]:
    """E_N and G_N in MPa."""
    matrix, count, diameter = TABLE_1[conf]
    secant = [float(s) for s in SECANT[matrix].split()]
    young = float(np.polyfit(STRAIN, secant, 3)[-1])
    share = (fibres or count) * math.pi * diameter**2 / 4.0 / 65.537
    mixed = [
        m / (1.0 - math.sqrt(share) * (1.0 - m / f))
        for m, f in ((young, 2950.0), (young / 2.8, fibre_shear))
    ]
    return mixed[0], mixed[1]


def residual(conf: int, speed: float, law: str, angles: tuple[float, ...]) -> np.ndarray:
    """Residuals of the equations of the laws `repaired` and `consistent` at alpha, beta, gamma."""
    alpha, beta, gamma = angles
    e, g = (1e6 * m for m in moduli(conf))
    q, pull = AIR * speed**2, M_W * speed**2 * X_C / 4.0
    c = math.cos(alpha) * math.cos(beta)
    thrust = q * c * span_load("lift", 2, R_N, TIP, gamma)
    drag = q * c * span_load("drag", 2, R_N, TIP, gamma)
    up = thrust - WEIGHT - pull * math.tan(beta - FLAP)
    back = drag + pull * math.tan(LAG - alpha)
    twisting = drag + pull * math.tan(alpha) if law == "repaired" else back
    return np.array(
        [
            alpha - X_C / R_N * L**2 / (2.0 * e * I_L) * back,
            beta - R_N / X_C * L**2 / (2.0 * e * I_F) * up,
            gamma - L / (g * J) * (up * DY + twisting * DZ),
        ]
    )


def solve(conf: int, speed: float, law: str) -> dict[str, float]:
    """Thrust [N], drag [N], torque [N m] and the three angles [rad]; published: no torque."""
    q = AIR * speed**2
    if conf == 0:
        return {
            "thrust_N": q * span_load("lift", 2, 0.015, TIP),
            "drag_N": q * span_load("drag", 2, 0.015, TIP),
            "torque_Nm": q * span_load("drag", 3, 0.015, TIP),
            "alpha_rad": 0.0,
            "beta_rad": 0.0,
            "gamma_rad": 0.0,
        }
    if law == "published":
        return _published(conf, speed)
    found = root(lambda x: residual(conf, speed, law, tuple(x)), (0.05, 0.05, 0.05), tol=1e-12)
    assert np.abs(found.fun).max() < 1e-8, found.message
    alpha, beta, gamma = found.x
    c = math.cos(alpha) * math.cos(beta)
    return {
        "thrust_N": q
        * (span_load("lift", 2, 0.015, R_N) + c * span_load("lift", 2, R_N, TIP, gamma)),
        "drag_N": q
        * (span_load("drag", 2, 0.015, R_N) + c * span_load("drag", 2, R_N, TIP, gamma)),
        "torque_Nm": q
        * (span_load("drag", 3, 0.015, R_N) + c * span_load("drag", 3, R_N, TIP, gamma)),
        "alpha_rad": alpha,
        "beta_rad": beta,
        "gamma_rad": gamma,
    }


def _published(conf: int, speed: float) -> dict[str, float]:
    e, g = (1e6 * m for m in moduli(conf, fibres=6, fibre_shear=2950.0 / 2.7))
    f, area, u = 1.705635e-8, 65.57e-6, 36.58e-3
    k_g = 3.0 * (1.0 + 4.0 * f / (3.0 * area * u**2)) * L / (g * f)
    pivot = np.array([29.0, 3.94, 6.99]) * 1e-3
    q, pull = AIR * speed**2, M_W * speed**2 * X_C / 4.0
    thrust, drag = (q * span_load(kind, 2, JOIN, TIP) for kind in ("lift", "drag"))
    inner_thrust = q * span_load("lift", 2, 0.015, R_N)
    inner_drag = q * span_load("drag", 2, 0.015, JOIN)
    end, edge = R_N, math.pi / 2.0 - 1e-9
    alpha = beta = gamma = 0.0
    for _ in range(4):
        k_b = end / X_C * L**2 / (2.0 * e * I_F)
        k_a = X_C / end * L**2 / (2.0 * e * I_L)
        beta = brentq(
            lambda b, k=k_b, t=thrust: b - k * (t - WEIGHT - pull * math.tan(b - FLAP)),
            FLAP - edge,
            FLAP + edge,
            xtol=1e-14,
        )
        alpha = brentq(
            lambda a, k=k_a, d=drag: a - k * (d + pull * math.tan(LAG - a)),
            LAG - edge,
            1.57,
            xtol=1e-14,
        )
        up = thrust - WEIGHT - pull * math.tan(beta - FLAP)
        gamma = k_g * (up * DY + (drag + pull * math.tan(alpha)) * DZ)
        turn = _rz(alpha) @ _ry(beta) @ _rx(gamma)
        end = float((turn @ (np.array([end, 0.0, 0.0]) - pivot) + pivot)[0])
        c = math.cos(alpha) * math.cos(beta)
        thrust = q * c * span_load("lift", 2, end, TIP, gamma)
        drag = q * c * span_load("drag", 2, end, TIP, gamma, sign=1.0)
    return {
        "thrust_N": inner_thrust + thrust,
        "drag_N": inner_drag + drag,
        "alpha_rad": alpha,
        "beta_rad": beta,
        "gamma_rad": gamma,
    }


def _rx(a: float) -> np.ndarray:
    s, c = math.sin(a), math.cos(a)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _ry(a: float) -> np.ndarray:
    s, c = math.sin(a), math.cos(a)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _rz(a: float) -> np.ndarray:
    s, c = math.sin(a), math.cos(a)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])

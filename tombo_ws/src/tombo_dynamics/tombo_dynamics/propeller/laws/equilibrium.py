"""The equilibrium of the laws `repaired` and `consistent`, followed up from rest by Newton steps.

Law `repaired`: the published load model with its program's defects mended.

    beta  = K_b [T_w - W - F_c tan(beta - 0.1221)],   K_b = (r_N / x_c) L^2 / (2 E_N I_f)
    alpha = K_a [D_w + F_c tan(0.1418 - alpha)],      K_a = (x_c / r_N) L^2 / (2 E_N I_l)
    gamma = L / (G_N J) {[T_w - W - F_c tan(beta - 0.1221)] dy + [D_w + F_c tan(alpha)] dz}

In the twist, F_c pulls in plane with tan(alpha), as in the paper, where the equation of alpha has
tan(0.1418 - alpha). The thrust's maximum comes from this one term.

Law `consistent`: both equations have the same in-plane force, F_c tan(0.1418 - alpha). The pull
then fades as the wing lags, and the twist saturates. Thrust has its maximum above 18 000 rpm.

The physical root is the one that continues the equilibrium at rest. Newton's method alone finds
some root; for very soft or far offset wings that can be one beyond a turning point, which no
propeller that spins up reaches. So every root is reached from rest along its path: the equations
are linear in omega^2, which gives the path's tangent for nothing, and a few long steps suffice.
"""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.propeller.laws.parameters import (
    LAWS,
    NO_EQUILIBRIUM,
    OK,
    TWIST_OUT_OF_RANGE,
    Parameters,
)

_EDGE = 0.5 * math.pi
_CLOSE = 1e-14


@compiled
def spring_angle(m: float, r: float) -> float:
    """Return y in (-pi/2, pi/2) with y + m tan(y) = r, for m >= 0.

    The left side rises steadily, so there is one root; Newton's method, kept inside of a bracket
    that every step narrows. Without pull (m = 0) it is r itself.
    """
    if m <= 0.0:
        return r
    low, high = -_EDGE, _EDGE
    y = math.atan(r / (1.0 + m))
    for _ in range(200):
        tangent = math.tan(y)
        excess = y + m * tangent - r
        if excess > 0.0:
            high = y
        else:
            low = y
        step = excess / (1.0 + m * (1.0 + tangent * tangent))
        if abs(step) < _CLOSE:
            return y - step
        y -= step
        if not low < y < high:
            y = 0.5 * (low + high)
    return y


@compiled
def twisted(
    weights: Array, rate: float, gamma: float, sine: float, cosine: float
) -> tuple[float, float]:
    """Return f(gamma) and f'(gamma) of the closed form in `wing`.

    Args:
        weights: the six weights, in the unit of f.
        rate: n, 1.
        gamma: twist [rad].
        sine: of gamma.
        cosine: of gamma.
    """
    s, c = math.sin(rate * gamma), math.cos(rate * gamma)
    even = weights[0] + weights[1] * c + weights[2] * s
    odd = weights[3] + weights[4] * c + weights[5] * s
    even_slope = rate * (weights[2] * c - weights[1] * s)
    odd_slope = rate * (weights[5] * c - weights[4] * s)
    value = cosine * even + sine * odd
    slope = cosine * (odd + even_slope) + sine * (odd_slope - even)
    return value, slope


@compiled
def _repaired_pull(alpha: float) -> tuple[float, float]:
    """Return the in-plane pull over F_c that twists the nodus, and its slope over alpha."""
    tangent = math.tan(alpha)
    return tangent, 1.0 + tangent * tangent


@compiled
def _consistent_pull(alpha: float, lag_offset: float) -> tuple[float, float]:
    """Return the in-plane pull over F_c that twists the nodus, and its slope over alpha."""
    tangent = math.tan(lag_offset - alpha)
    return tangent, -1.0 - tangent * tangent


_STEPS = 15
_STEP_LIMIT = 0.3
_ROOT_CLOSE = 1e-9
"""Newton's steps shrink quadratically: one below this leaves an error below rounding."""
_PATH_CLOSE = 1e-3
"""Accuracy of the points on the way [rad]; only the last one counts."""
_ANGLE_LIMIT = 1.5
_FIRST_STEP = 0.125
_LONGEST_MISS = 0.3
"""Longest distance of a root from where the tangent has pointed [rad]."""
_WIDEST_GAP = 0.005
"""Largest error of a step's trapezoid [rad]."""
_SHORTEST_STEP = 1e-8
_MOST_FOLLOWED = 200
_CONSISTENT = LAWS["consistent"]


@compiled
def newton(
    law: int, p: Parameters, square: float, alpha: float, beta: float, gamma: float, close: float
) -> tuple[float, float, float, float, bool, float, float, float]:
    """Solve the three equations at omega^2 = `square` [rad^2/s^2] from a starting point [rad].

    Returns:
        alpha, beta, gamma [rad], the determinant of the Jacobian there, whether the last step was
        below `close` [rad], and the path's tangent: the three angles' slopes over ln omega^2.
    """
    q = p.air_density * square
    pull = p.centrifugal * square
    kb = p.flap_compliance * p.joint_radius / p.wing_centroid
    ka = p.lag_compliance * p.wing_centroid / p.joint_radius
    kg = p.twist_compliance
    dy, dz = p.lift_arm, p.drag_arm
    determinant = 0.0
    for _ in range(_STEPS):
        sin_a, cos_a = math.sin(alpha), math.cos(alpha)
        sin_b, cos_b = math.sin(beta), math.cos(beta)
        sin_g, cos_g = math.sin(gamma), math.cos(gamma)
        lift, lift_g = twisted(p.lift, p.lift_rate, gamma, sin_g, cos_g)
        drag, drag_g = twisted(p.drag, p.drag_rate, gamma, sin_g, cos_g)
        c = q * cos_a * cos_b
        c_a, c_b = -q * sin_a * cos_b, -q * cos_a * sin_b
        tan_b = math.tan(beta - p.flap_offset)
        tan_a = math.tan(p.lag_offset - alpha)
        if law == _CONSISTENT:
            tan_t, slope_t = _consistent_pull(alpha, p.lag_offset)
        else:
            tan_t, slope_t = _repaired_pull(alpha)
        up = c * lift - p.wing_weight - pull * tan_b
        back = c * drag + pull * tan_a
        twist_back = c * drag + pull * tan_t
        pull_b = pull * (1.0 + tan_b * tan_b)
        pull_a = pull * (1.0 + tan_a * tan_a)

        r_b = beta - kb * up
        r_a = alpha - ka * back
        r_g = gamma - kg * (up * dy + twist_back * dz)
        b_a, b_b, b_g = -kb * c_a * lift, 1.0 - kb * (c_b * lift - pull_b), -kb * c * lift_g
        a_a, a_b, a_g = 1.0 - ka * (c_a * drag - pull_a), -ka * c_b * drag, -ka * c * drag_g
        g_a = -kg * (c_a * (lift * dy + drag * dz) + pull * slope_t * dz)
        g_b = -kg * (c_b * (lift * dy + drag * dz) - pull_b * dy)
        g_g = 1.0 - kg * c * (lift_g * dy + drag_g * dz)

        m_a = b_b * g_g - b_g * g_b
        m_b = b_a * g_g - b_g * g_a
        m_g = b_a * g_b - b_b * g_a
        determinant = a_a * m_a - a_b * m_b + a_g * m_g
        # Cramer's rule, with the minors that two of the three steps share.
        r_bg = r_b * g_g - b_g * r_g
        r_gb = r_b * g_b - b_b * r_g
        r_ga = r_b * g_a - b_a * r_g
        d_a = (r_a * m_a - a_b * r_bg + a_g * r_gb) / determinant
        d_b = (a_a * r_bg - r_a * m_b - a_g * r_ga) / determinant
        d_g = (a_b * r_ga - a_a * r_gb + r_a * m_g) / determinant
        size = max(abs(d_a), abs(d_b), abs(d_g))
        if not size < 1e6:
            return alpha, beta, gamma, determinant, False, 0.0, 0.0, 0.0
        shrink = min(1.0, _STEP_LIMIT / max(size, 1e-300))
        alpha -= shrink * d_a
        beta -= shrink * d_b
        gamma -= shrink * d_g
        if size < close:
            inside = (
                abs(p.lag_offset - alpha) < _ANGLE_LIMIT
                and abs(beta - p.flap_offset) < _ANGLE_LIMIT
                and abs(gamma) < _ANGLE_LIMIT
            )
            # At a root the loads balance the springs, so springs and weight are the loads' slope.
            l_a, l_b = alpha, beta + kb * p.wing_weight
            l_g = gamma + kg * p.wing_weight * dy
            l_bg, l_gb, l_ga = l_b * g_g - b_g * l_g, l_b * g_b - b_b * l_g, l_g * b_a - g_a * l_b
            t_a = (l_a * m_a - a_b * l_bg + a_g * l_gb) / determinant
            t_b = (a_a * l_bg - l_a * m_b + a_g * l_ga) / determinant
            t_g = (-a_b * l_ga - a_a * l_gb + l_a * m_g) / determinant
            return alpha, beta, gamma, determinant, inside, t_a, t_b, t_g
    return alpha, beta, gamma, determinant, False, 0.0, 0.0, 0.0


@compiled
def equilibrium(law: int, p: Parameters, square: float) -> tuple[float, float, float, int]:
    """Follow the root from rest up to omega^2 = `square`.

    A step that ends far from where the tangent has pointed, or on the far side of a turning point,
    is halved.

    Returns:
        alpha, beta, gamma [rad] and OK or TWIST_OUT_OF_RANGE; or NaNs and NO_EQUILIBRIUM, where
        the path turns back or an angle approaches 90 degrees.
    """
    kb = p.flap_compliance * p.joint_radius / p.wing_centroid
    alpha, beta = 0.0, -kb * p.wing_weight
    gamma = -p.twist_compliance * p.wing_weight * p.lift_arm
    t_a, t_b, t_g = 0.0, 0.0, 0.0
    reached, step = 0.0, _FIRST_STEP * square
    for _ in range(_MOST_FOLLOWED):
        target = min(square, reached + step)
        last = target >= square
        # Angles grow with omega^2 at first and level off later: linear in omega is in between.
        ahead = 2.0 * (math.sqrt(target / reached) - 1.0) if reached > 0.0 else 0.0
        p_a, p_b, p_g = alpha + ahead * t_a, beta + ahead * t_b, gamma + ahead * t_g
        close = _ROOT_CLOSE if last else _PATH_CLOSE
        a, b, g, determinant, converged, n_a, n_b, n_g = newton(
            law, p, target, p_a, p_b, p_g, close
        )
        miss = max(abs(a - p_a), abs(b - p_b), abs(g - p_g))
        # The trapezoid of both ends' slopes: it closes on a smooth path, not across a fold of it.
        back = 1.0 - math.sqrt(reached / target) if target > 0.0 else 0.0
        gap = max(
            abs(a - alpha - 0.5 * ahead * t_a - back * n_a),
            abs(b - beta - 0.5 * ahead * t_b - back * n_b),
            abs(g - gamma - 0.5 * ahead * t_g - back * n_g),
        )
        if converged and determinant > 0.0 and miss < _LONGEST_MISS and gap < _WIDEST_GAP:
            if last:
                return a, b, g, (OK if g <= p.twist_limit else TWIST_OUT_OF_RANGE)
            alpha, beta, gamma, reached = a, b, g, target
            t_a, t_b, t_g = n_a, n_b, n_g
            step *= 4.0
        else:
            step *= 0.5
            if step < _SHORTEST_STEP * square:
                break
    return (
        math.nan,
        math.nan,
        math.nan,
        (TWIST_OUT_OF_RANGE if gamma > p.twist_limit else NO_EQUILIBRIUM),
    )

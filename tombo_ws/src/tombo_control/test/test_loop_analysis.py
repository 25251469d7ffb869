"""The linear analysis: margins of the gains, and that the code has them."""

import itertools
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from control_bench import VEHICLE, bench, rotor_table
from loop_analysis import Margins, cascade_margins, margins, yaw_drive

from tombo_control.params import ControlParams
from tombo_control.recovery.params import RecoveryParams

DOCS = Path(__file__).parents[4] / "docs"
HORIZONTAL = ("rate", "attitude", "velocity", "position")
GAINS = {
    "rate": ("rate_p", "rate_i", "rate_d"),
    "attitude": ("attitude_p",),
    "velocity": ("velocity_p", "velocity_i", "velocity_d"),
    "position": ("position_p",),
}
ANGULAR = slice(10, 12)
"""Body rates of roll and pitch in the state: where instability of any loop shows."""


@pytest.fixture(scope="module")
def loop_margins() -> dict[str, Margins]:
    return cascade_margins(ControlParams(), VEHICLE, rotor_table())


def test_margins_of_every_loop(loop_margins):
    for name, m in loop_margins.items():
        assert m.phase_margin_deg >= 45.0, name
        assert m.gain_margin_db >= 6.0, name
        assert m.peak_sensitivity <= 2.0, name


@pytest.mark.parametrize("order", [HORIZONTAL, ("yaw_rate", "yaw"), ("rate", "climb", "height")])
def test_each_loop_is_at_least_twice_as_fast_as_the_next(loop_margins, order):
    crossovers = [loop_margins[name].crossover for name in order]
    for inner, outer in itertools.pairwise(crossovers):
        assert inner >= 2.0 * outer


@pytest.mark.parametrize(
    ("page", "gains"), [("control.md", ControlParams()), ("reactions.md", RecoveryParams())]
)
def test_the_table_in_the_docs_holds_these_numbers(page, gains):
    loop_margins = cascade_margins(gains, VEHICLE, rotor_table())
    text = (DOCS / page).read_text()
    rows = dict(re.findall(r"^\| (\w+) \|((?: [\d.]+ \|){5})", text, re.MULTILINE))
    assert set(rows) == set(loop_margins)
    for name, cells in rows.items():
        m = loop_margins[name]
        crossover, phase, gain, delay, peak = (float(v) for v in cells.strip(" |").split("|"))
        assert crossover == pytest.approx(m.crossover, abs=0.051), name
        assert phase == pytest.approx(m.phase_margin_deg, abs=0.51), name
        assert gain == pytest.approx(m.gain_margin_db, abs=0.051), name
        assert delay == pytest.approx(m.delay_margin * 1e3, abs=0.51), name
        assert peak == pytest.approx(m.peak_sensitivity, abs=0.0051), name


def growth(control: ControlParams, seconds: float, **effects: dict[str, float]) -> float:
    """Log of the size of body rates at the end over that in the middle, after a tiny kick."""
    b = bench(control, **effects)
    b.plant.state.rates[0] = 1e-7
    rates = np.linalg.norm(b.fly(seconds, every=1)[:, ANGULAR], axis=1)
    half = rates.size // 2
    return math.log(rates[half + half // 2 :].max() / rates[half : half + half // 2].max())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("loop", "seconds"), [("rate", 2.0), ("attitude", 4.0), ("velocity", 6.0), ("position", 16.0)]
)
def test_the_real_cascade_oscillates_beyond_the_gain_margin_and_not_below(
    loop_margins, loop, seconds
):
    def scaled(factor: float) -> ControlParams:
        c = ControlParams()
        changed = {name: factor * getattr(c, name) for name in GAINS[loop]}
        for outer in HORIZONTAL[HORIZONTAL.index(loop) + 1 :]:  # a cut loop has none around it
            changed |= dict.fromkeys(GAINS[outer], 0.0)
        return replace(c, **changed)

    room = loop_margins[loop].gain_margin
    assert growth(scaled(0.92 * room), seconds) < 0.0
    assert growth(scaled(1.08 * room), seconds) > 0.0


def test_the_rate_loop_oscillates_only_beyond_the_delay_margin():
    c = ControlParams()
    # outer loops off; twice the gain, so that the margin is within the effect's reach of 60 ms
    fast = replace(c, attitude_p=0.0, yaw_p=0.0, rate_p=2.0 * c.rate_p, rate_i=2.0 * c.rate_i)
    room = cascade_margins(replace(fast, attitude_p=1.0, yaw_p=1.0), VEHICLE, rotor_table())[
        "rate"
    ].delay_margin
    assert room < 0.05
    assert growth(fast, 3.0, command_delay={"delay": 0.9 * room}) < 0.0
    assert growth(fast, 3.0, command_delay={"delay": 1.1 * room}) > 0.0


def test_a_yaw_torque_step_of_the_plant_follows_the_yaw_drive():
    """The reaction to speeding the rotors up comes long before the drag does."""
    b = bench()
    drive = yaw_drive(VEHICLE, rotor_table())
    small = 1e-3 * b.plant.rotor_speed[0]
    b.plant.rotor_command[:] += small * np.array([-1.0, -1.0, 1.0, 1.0])
    yaw_rates = []

    def hold(a, tick):
        b.a.setpoint.rotor_speed = b.plant.rotor_command
        yaw_rates.append(b.plant.state.rates[2])

    rate = b.fly_ticks(1.0, hold)[:, 12]
    t = np.arange(rate.size) * 1e-3
    tau = VEHICLE.motor_time_constant
    # integral of the step response of (1 + lead s) / (1 + tau s)
    shape = t + (drive.lead - tau) * (1.0 - np.exp(-t / tau))
    scale = rate[-1] / shape[-1]
    assert np.abs(rate - scale * shape).max() < 0.01 * rate[-1]
    assert drive.lead > 3.0 * tau


def test_margins_of_a_loop_known_by_hand():
    """L = w_c / s behind a delay of d: margin pi/2 - w_c d, oscillation at pi / 2d."""
    d, w_c = 0.020, 10.0

    def loop(z):
        s = np.log(z) / 1e-3
        return w_c / s * np.exp(-s * d)

    m = margins(loop)
    assert m.crossover == pytest.approx(w_c, rel=1e-4)
    assert m.phase_margin == pytest.approx(0.5 * math.pi - w_c * d, rel=1e-4)
    assert m.delay_margin == pytest.approx((0.5 * math.pi - w_c * d) / w_c, rel=1e-4)
    assert m.oscillation == pytest.approx(0.5 * math.pi / d, rel=1e-3)
    assert m.gain_margin == pytest.approx(0.5 * math.pi / (d * w_c), rel=1e-3)

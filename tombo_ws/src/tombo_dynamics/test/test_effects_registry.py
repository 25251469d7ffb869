"""Every effect in the registry: declared, harmless at null, working, fittable."""

import math

import numpy as np
import pytest
from effect_scenes import busy_memory, nulls, observe, typical
from one_vehicle import NOISE
from scipy.optimize import least_squares

from tombo_dynamics.effects import REGISTRY, check_theta
from tombo_dynamics.errors import InputError

every_effect = pytest.mark.parametrize("name", REGISTRY)

STEPWISE = {("mocap_dropouts", "probability"), ("accel_range", "limit")}
"""Between two values of it nothing moves, but which samples are missing, or clipped: counted
elsewhere."""


def flat(record):
    """Return all numbers of a record, nested ones too."""
    parts = [record[name] for name in record.dtype.names]
    deep = (flat(part) if part.dtype.names and part.shape == () else part for part in parts)
    listed = (
        [n for one in part for n in flat(one)] if part.dtype.names else part for part in deep
    )
    return np.concatenate([np.ravel(part).astype(float) for part in listed])


# --- declarations ---------------------------------------------------------------------------


@every_effect
def test_declaration_is_complete(name):
    entry = REGISTRY[name]
    assert entry.doc.strip() and entry.signature.strip()
    assert set(entry.separates_from) <= set(REGISTRY) - {name}
    for p in entry.theta:
        low, high = p.bounds
        assert p.unit.strip() and p.doc.strip()
        assert math.isfinite(low) and math.isfinite(high) and low < high
        assert low <= p.typical <= high
        assert low <= p.null <= high
    assert any(p.typical != p.null for p in entry.theta)


# --- at null, nothing -----------------------------------------------------------------------


@every_effect
def test_effect_function_at_null_adds_nothing(name):
    """The effect itself, without the comparison that the chain makes before it calls."""
    v = busy_memory()
    v.plant.supply.charge = v.plant.supply.current = 0.0
    before = flat(v.plant)
    memory = [v.plant.memories[name]] if REGISTRY[name].state else []
    normals = np.linspace(-1.0, 1.0, NOISE)
    REGISTRY[name].function(v.plant, normals, *memory, *nulls(name).values())
    v.plant.supply.charge = v.plant.supply.current = 0.0  # kept while the battery's effect runs
    assert flat(v.plant) == pytest.approx(before, rel=1e-15, abs=1e-16)


# --- at its typical size, something ---------------------------------------------------------


@every_effect
def test_typical_values_show_and_stay_finite(name):
    seen = observe(name, typical(name))
    assert np.isfinite(seen).all()
    assert np.abs(seen - observe(name, nulls(name))).max() > 1e-4


# --- fitting --------------------------------------------------------------------------------


@pytest.mark.slow
@every_effect
def test_fit_recovers_the_parameters_of_simulated_data(name):
    """Least squares over the very function that simulated, from a start well off."""
    truth, null = typical(name), nulls(name)
    free = [key for key in truth if (name, key) not in STEPWISE]
    if not free:
        return
    data = observe(name, truth)
    trace = np.abs(data - observe(name, null | {k: truth[k] for k in truth if k not in free}))
    scale = trace.max(axis=0)
    seen = scale > 1e-12
    size = np.array([truth[key] - null[key] for key in free])

    def residuals(share):
        given = truth | {
            key: null[key] + s * d for key, s, d in zip(free, share, size, strict=True)
        }
        return ((observe(name, given) - data)[:, seen] / scale[seen]).ravel()

    start = np.linspace(0.7, 0.85, len(free))
    coarse = least_squares(residuals, start, diff_step=0.02)  # steps over what ends on a tick
    fit = least_squares(residuals, coarse.x, diff_step=1e-5, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert fit.x == pytest.approx(np.ones(len(free)), abs=2e-3)


# --- bad input ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"gusts": {"deviation": "much"}}, r"effects\.gusts\.deviation: 'much'"),
        ({"gusts": 1.0}, r"effects\.gusts: 1\.0; accepted: a mapping"),
        ({"gusts": {"strength": 1.0}}, r"effect 'gusts' in effects 'strength'.*deviation, time"),
        ({"gust": {"deviation": 1.0}}, r"'gust' \(did you mean 'gusts'\?\)"),
    ],
)
def test_invalid_parameters_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        check_theta(values, "effects")


@every_effect
def test_values_out_of_bounds_are_refused_and_bounds_accepted(name):
    for p in REGISTRY[name].theta:
        low, high = p.bounds
        assert check_theta({name: {p.name: low}}, "x") == {name: {p.name: low}}
        assert check_theta({name: {p.name: high}}, "x") == {name: {p.name: high}}
        for value in (low - 1e-6 * (high - low), high + 1e-6 * (high - low)):
            with pytest.raises(InputError) as caught:
                check_theta({name: {p.name: value}}, "effects")
            message = str(caught.value)
            assert f"effects.{name}.{p.name}" in message
            assert f"from {low:g} to {high:g}" in message and p.unit in message


# --- registering ----------------------------------------------------------------------------

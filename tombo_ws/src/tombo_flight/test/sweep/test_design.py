"""The points of a sweep."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tombo_dynamics.errors import InputError
from tombo_flight.sweep.design import SweepDesign, parse_axis


def levels(text):
    return parse_axis(text).levels


def test_a_range_has_both_ends_and_no_rounding_noise():
    assert levels("vehicle.mass=1.1:1.7:0.1") == ("1.1", "1.2", "1.3", "1.4", "1.5", "1.6", "1.7")
    assert levels("a=0:1:0.3") == ("0", "0.3", "0.6", "0.9")
    assert levels("a=-1e-3:1e-3:1e-3") == ("-0.001", "0", "0.001")
    assert levels("propeller.law=published, repaired") == ("published", "repaired")


@pytest.mark.parametrize(
    "text", ["a", "a=", "=1", "a=1,,2", "a=2:1:0.1", "a=0:1:0", "a=0:1:-1", "a=0:1:1e-9"]
)
def test_what_is_no_axis_is_refused(text):
    with pytest.raises(InputError, match="accepted"):
        parse_axis(text)


def test_a_full_design_has_each_combination_once_the_last_axis_fastest():
    design = SweepDesign((parse_axis("a=1,2,3"), parse_axis("b=x,y")))
    points = [design.settings(n) for n in range(design.points)]
    assert points[:3] == [{"a": "1", "b": "x"}, {"a": "1", "b": "y"}, {"a": "2", "b": "x"}]
    assert len({tuple(point.items()) for point in points}) == design.points == 6


@pytest.mark.parametrize("kind", ["lhs", "sobol"])
def test_a_drawn_design_fills_its_ranges_evenly(kind):
    design = SweepDesign((parse_axis("a=10:20"), parse_axis("b=x,y")), kind, 64)
    points = [design.settings(n) for n in range(64)]
    a = np.array([float(point["a"]) for point in points])
    # one in each of 64 cells: properties of both that random numbers lack
    assert sorted(np.floor((a - 10.0) * 6.4)) == list(range(64))
    assert sum(point["b"] == "x" for point in points) == 32
    assert points == [design.settings(n) for n in range(64)]


@pytest.mark.parametrize("kind", ["lhs", "sobol"])
def test_values_with_a_distribution_are_distributed_so(kind):
    design = SweepDesign((parse_axis("a=norm(1.3, 0.02)"), parse_axis("b=0:1")), kind, 256)
    a, b = np.array([list(map(float, design.settings(n).values())) for n in range(256)]).T
    # far below the 0.085 that 256 independent draws exceed in 5 % of all cases
    assert stats.kstest(a, stats.norm(1.3, 0.02).cdf).statistic < 0.01
    assert stats.kstest(b, "uniform").statistic < 0.01
    assert abs(stats.spearmanr(a, b).statistic) < 0.1
    low, high = (float(value) for value in design.values_to_check(design.axes[0]))
    assert (low, high) == (a.min(), a.max())


@pytest.mark.parametrize(
    "text", ["a=normal(1,2)", "a=norm(1,2,3)", "a=norm(1,-2)", "a=poisson(3)"]
)
def test_what_is_no_distribution_is_refused(text):
    with pytest.raises(InputError, match="no continuous distribution"):
        SweepDesign((parse_axis(text),), "lhs", 8)


@pytest.mark.parametrize(
    ("kind", "samples", "axes"),
    [("full", 0, ["a=0:1"]), ("lhs", 0, ["a=0:1"]), ("lhs", 5, []),
     ("grid", 0, []), ("full", 0, ["a=0,1", "a=2,3"]),
     ("full", 0, ["a=norm(1,2)"])],
)  # fmt: skip
def test_a_design_that_does_not_fit_is_refused(kind, samples, axes):
    with pytest.raises(InputError, match="accepted"):
        SweepDesign(tuple(parse_axis(text) for text in axes), kind, samples)

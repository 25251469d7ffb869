"""Where propellers work on a vehicle, against the library's own thrust map."""

import dataclasses

import numpy as np
import pytest

from tombo_dynamics.propeller import configuration, configurations, thrust_map
from tombo_dynamics.vehicle import VehicleParams
from tombo_propeller.design.candidates import with_nodus_at
from tombo_propeller.design.operating_points import flight_performance

SOFT = [c for c in configurations() if c.nodus]
BLADE = configuration(13).blade
VEHICLE = VehicleParams()


@pytest.mark.parametrize("law", ["repaired", "consistent"])
def test_limits_and_hover_are_those_of_the_thrust_map(law):
    vehicle = dataclasses.replace(VEHICLE, mass=0.6)
    performance = flight_performance(SOFT, vehicle, law)
    for i, soft in enumerate(SOFT):
        chart = thrust_map(soft, law)
        top = min(chart.omega_max, vehicle.rotor_speed_max)
        assert performance.usable_speed[i] == pytest.approx(top, rel=2e-5)
        assert performance.usable_thrust[i] == pytest.approx(float(chart.thrust(top)), rel=1e-4)
        assert performance.motor_limits[i] == (chart.omega_max > vehicle.rotor_speed_max)
        hover = float(chart.thrust(performance.hover_speed[i]))
        assert hover == pytest.approx(vehicle.hover_thrust(), rel=2e-5)


def test_what_cannot_lift_has_no_hover():
    performance = flight_performance(SOFT, VEHICLE, "repaired")
    too_soft = performance.usable_thrust < VEHICLE.hover_thrust()
    assert too_soft.any()
    assert np.array_equal(np.isnan(performance.hover_speed), too_soft)
    assert np.array_equal(np.isnan(performance.hover_lift_over_drag), too_soft)


def test_a_nodus_further_out_has_a_lighter_wing_and_another_chord():
    inner, outer = with_nodus_at(BLADE, 0.035, 0.010), with_nodus_at(BLADE, 0.055, 0.010)
    assert outer.joint.wing_mass_kg < inner.joint.wing_mass_kg == BLADE.joint.wing_mass_kg
    assert outer.joint.wing_centroid_m > inner.joint.wing_centroid_m
    chord = outer.joint.section_area_mm2 / inner.joint.section_area_mm2
    lag = outer.joint.lag_second_moment_mm4 / inner.joint.lag_second_moment_mm4
    assert chord > 1.0  # the nine-inch blade is widest at mid-span
    assert lag == pytest.approx(chord**3)  # and as thick at 50 mm as within


def test_a_nodus_like_iron_makes_the_rigid_propeller_wherever_it_is():
    iron = dataclasses.replace(
        configuration(13).nodus.matrix, secant_modulus_MPa=(2e5,) * 15, poisson_ratio=0.3
    )
    for radius, length in ((0.035, 0.012), (0.05, 0.02), (0.06, 0.006)):
        stiff = dataclasses.replace(
            configuration(13),
            blade=with_nodus_at(BLADE, radius, length),
            nodus=dataclasses.replace(
                configuration(13).nodus, matrix=iron, length_mm=1e3 * length
            ),
        )
        both = flight_performance([stiff, configuration(0)], VEHICLE, "repaired")
        assert both.usable_thrust[0] == pytest.approx(both.usable_thrust[1], rel=1e-3)

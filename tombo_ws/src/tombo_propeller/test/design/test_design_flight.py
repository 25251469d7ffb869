"""The recommended nodus in the collision flight: claims agree with flights."""

import math
from pathlib import Path

import numpy as np
import pytest

from tombo_dynamics.propeller import configuration, thrust_map
from tombo_dynamics.propeller.mounted_propeller import mounted_configuration, thrust_map_of
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario, world_of
from tombo_propeller.design.flight_check import blade_recovery, check_design, recommend
from tombo_propeller.design.flight_files import scenario_of, write_flyable
from tombo_propeller.design.page import DESIGN_FILES, write_design
from tombo_propeller.design.request import DesignRequest, vehicle_for

pytestmark = pytest.mark.slow

SEEDS = range(6)


def index_of(design, number: int) -> int:
    return next(i for i, c in enumerate(design.evaluated.configurations) if c.number == number)


def test_the_recommended_one_flies_as_claimed(made):
    design = made(mass_kg=1.3, min_thrust_margin=1.7, max_collision_force_N=150.0)
    recommendation = recommend(design, SEEDS)
    assert design.evaluated.configurations[recommendation.index].number == 11
    assert recommendation.check.held
    claims = {c.text: c for c in (*recommendation.check.claims, *recommendation.check.limits)}
    assert claims["flights that recover after it"].simulated == len(SEEDS)
    assert claims["thrust margin"].simulated == pytest.approx(2.04, abs=0.01)
    assert claims["first strike's highest force"].simulated == pytest.approx(123.0, abs=0.1)
    assert claims["blade's recovery time"].simulated == pytest.approx(0.39, abs=0.003)
    assert claims["collision force at most 150 N"].held


def test_blades_with_too_weak_a_push_let_it_fall_and_are_rejected(made):
    design = made(mass_kg=1.3, min_thrust_margin=1.5, max_collision_force_N=100.0)
    assert [design.evaluated.configurations[i].number for i in design.choice.order] == [8]
    recommendation = recommend(design, SEEDS)
    assert recommendation.index is None
    ((failed, check),) = recommendation.failed
    assert design.evaluated.configurations[failed].number == 8
    assert not check.held
    assert check.largest_fall_m > 1.0


def test_a_false_claim_is_seen(made):
    design = made(mass_kg=1.3, min_thrust_margin=1.7, max_collision_force_N=150.0)
    index = index_of(design, 13)
    honest = design.evaluated.value[index, 0]
    hover = design.evaluated.operating.hover_speed[index]
    try:
        design.evaluated.value[index, 0] = 1.1 * honest
        design.evaluated.operating.hover_speed[index] = 1.3 * hover
        broken = {c.text for c in check_design(design, index, range(2)).claims if not c.held}
    finally:
        design.evaluated.value[index, 0] = honest
        design.evaluated.operating.hover_speed[index] = hover
    assert broken == {"thrust margin", "rotor speed in hover"}


def test_blade_recovery_counts_from_the_last_release():
    rate = 1.0 - 0.9 ** (1.0 / 3.0)
    decay = np.exp(np.log(rate) * np.arange(1, 1001) / 400.0)  # 90 % of thrust after 0.4 s
    fold = np.zeros((1400, 4))
    fold[100:110, 2] = 1.0
    fold[110:150, 2] = decay[:40]  # struck again before it was straight
    fold[150:170, 2] = 1.0
    fold[170:1170, 2] = decay
    assert blade_recovery(fold) == pytest.approx(0.4, abs=0.002)
    assert math.isnan(blade_recovery(np.zeros((10, 4))))


def test_the_s500_at_its_own_mass_is_the_suites_vehicle():
    vehicle, plain = (
        vehicle_for(DesignRequest(mass_kg=1.3), configuration(13).blade),
        VehicleParams(),
    )
    for name in ("mass", "inertia_xx", "inertia_zz", "arm_length", "nodus_radius"):
        assert getattr(vehicle, name) == pytest.approx(getattr(plain, name), rel=1e-9)
    assert vehicle.rotor_inertia == pytest.approx(plain.rotor_inertia, rel=0.01)


@pytest.mark.parametrize(("mass", "arm"), [(0.9, 0.2), (1.3, 0.24), (1.3, 0.4)])
def test_another_vehicle_touches_the_pillar_at_the_same_place(mass, arm, tmp_path: Path):
    request = DesignRequest(mass_kg=mass, arm_m=arm)
    path = write_flyable(
        tmp_path, scenario_of(request, configuration(13), 145.5, 0.42), configuration(13)
    )
    summary = fly_scenario(load_scenario(str(path)), 1).summary
    assert summary["contact_rotor"] == "front_left"
    assert summary["contact_position_m"][0] == pytest.approx(1.7, abs=0.06)


def test_files_of_a_design_can_be_moved_and_flown(made, tmp_path: Path):
    design = made(mass_kg=1.2, min_thrust_margin=2.5)
    recommendation = recommend(design, ())
    (tmp_path / "a").mkdir()
    write_design(tmp_path / "a", design, recommendation)
    moved = (tmp_path / "a").rename(tmp_path / "b")
    files = {str(p.relative_to(moved)) for p in moved.rglob("*") if p.is_file()}
    assert files <= set(DESIGN_FILES)
    assert {"design.json", "design.yaml", "candidates.png", "library/configurations.yaml"} <= files
    scenario = load_scenario(str(moved / "design.yaml"))
    chosen = design.evaluated.configurations[recommendation.index]
    assert mounted_configuration(scenario.propeller) == chosen
    top = float(thrust_map_of(scenario.propeller).thrust(500.0))
    assert top == pytest.approx(float(thrust_map(chosen).thrust(500.0)))
    assert world_of(scenario).vehicle.nodus_radius == chosen.blade.joint.outer_radius_m

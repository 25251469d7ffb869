"""`tombo vehicle`: its lists, views and files, checked by hand calculation."""

import math
from pathlib import Path

import pytest

from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import write_mcap
from tombo_flight.scenario import load_scenario

ROOT = Path(__file__).parents[5]
EXAMPLE = ROOT / "examples" / "s500_10_inch.yaml"
VALUES = ("name=Mine", "vehicle.mass=1.5", "vehicle.arm_length=0.24", "propeller.k_thrust=1.5e-5",
          "propeller.k_torque=2.4e-7", "propeller.radius=0.127")  # fmt: skip
NEW = tuple(word for value in VALUES for word in ("--set", value))


def surveyed(folder, seed, settings=(), vehicle=None):
    """A recording of the first half of the flight that a diagnosis is made from."""
    path, short = folder / f"{seed}.mcap", ("duration=30", *settings)
    write_mcap(fly_scenario(load_scenario("survey", short, vehicle=vehicle), seed), path)
    return str(path)


@pytest.mark.slow
def test_every_listed_vehicle_is_shown(tombo):
    names = [row["name"] for row in tombo("vehicle", "list", "--json").json]
    assert {"tombo_s500", "crazyflie_2_1", "crazyflie_2_1_brushless", "px4_x500",
            "racer_5_inch"} <= set(names)  # fmt: skip
    for name in names:
        shown = tombo("vehicle", "show", name, "--json").json
        assert shown["hover"]["thrust_N"] == pytest.approx(shown["vehicle"]["mass"] * 9.80665 / 4)
        assert shown["hover"]["thrust_to_weight"] > 1.5
    text = tombo("vehicle", "show", "px4_x500")
    assert text.code == 0 and "motorConstant" in text.out and "7348 rpm" in text.out


def test_the_worked_example_agrees_with_a_hand_calculation(tombo):
    """From the published coefficients and momentum theory, nothing of the suite."""
    density, diameter, turn = 1.2041, 0.254, 2.0 * math.pi
    thrust = 1.5 * 9.80665 / 4.0
    k_thrust = 0.1185 * density * diameter**4 / turn**2
    k_torque = 0.0480 * density * diameter**5 / turn**3
    speed = math.sqrt(thrust / k_thrust)
    power = 4.0 * k_torque * speed**3
    hover = tombo("vehicle", "show", str(EXAMPLE), "--json").json["hover"]
    assert hover["thrust_N"] == pytest.approx(thrust, rel=0.02)
    assert hover["speed_rad_s"] == pytest.approx(speed, rel=0.02)
    assert hover["power_W"] == pytest.approx(power, rel=0.02)
    ideal = 4.0 * thrust**1.5 / math.sqrt(2.0 * density * math.pi * (diameter / 2.0) ** 2)
    assert 0.6 < ideal / hover["power_W"] < 0.75
    page = (ROOT / "docs" / "own_vehicle.md").read_text(encoding="utf-8")
    for said in (f"{thrust:.3f} N", f"{speed:.1f} rad/s", f"{power:.1f} W", f"{ideal:.1f} W"):
        assert said in page


@pytest.mark.slow
def test_a_new_vehicle_is_written_and_flies(tombo, tmp_path):
    assert tombo("vehicle", "new", "mine.yaml", *NEW, "--set", "vehicle.leg_height=0.1").code == 0
    summary = tombo("fly", "hover", "--vehicle", "mine.yaml", "--json",
                    "--set", "duration=20", "--set", "mission.land_time=10").json  # fmt: skip
    assert not summary["crashed"] and summary["conf"] is None


def test_unknown_vehicles_are_refused(refused):
    refused(("vehicle", "show", "px4_x50"), "px4_x50", "did you mean 'px4_x500'")
    refused(("fly", "hover", "--vehicle", "nothing.yaml"), "nothing.yaml", "can't be read")
    refused(
        ("fly", "hover", "--vehicle", "px4_x500", "--set", "propeller.conf=5"),
        "propeller.conf",
        "plain",
    )


@pytest.mark.slow
def test_a_vehicle_from_flights_is_a_file_that_shows_and_diagnoses(tombo, tmp_path):
    logs = [surveyed(tmp_path, seed) for seed in (0, 1)]
    file = str(tmp_path / "mine.yaml")
    said = tombo("vehicle", "from-flights", *logs, "-o", file)
    assert said.code == 0 and "motor time constant" in said.out
    assert tombo("vehicle", "show", file).code == 0
    verdict = tombo("diagnose", *logs, "--vehicle", file, "--json")
    assert '"verdict": "none"' in verdict.out

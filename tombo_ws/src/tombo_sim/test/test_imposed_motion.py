"""The model along a motion says what the simulator said of the same motion."""

import numpy as np
import pytest
from kernel_flight import (
    NOISE,
    TICK,
    VEHICLE,
    commands_of,
    fly_kernel,
    maps,
    motion_of,
    vehicle_of,
)

from tombo_dynamics.effects.compose import new_plant, pack_theta
from tombo_sim.inverse_simulation import (
    ImposedTick,
    run_along_motion,
    simulate_imu_at_rest,
    simulate_mocap,
)

QUIET = np.zeros((1, NOISE))
SEED = 4
EFFECTS = {
    "linear_rotor_drag": {"d_xy": 0.3, "d_z": 0.1},
    "flapping_moment": {"k": 0.02},
    "steady_wind": {"east": 1.2, "north": -0.5},
    "imu_bias": {"gyro_x": 0.02, "accel_y": 0.2},
    "mass_error": {"fraction": 0.08},
    "inertia_error": {"xx": 0.1, "zz": -0.1},
    "cog_offset": {"x": 0.01},
    "motor_lag": {"extra_tau": 0.01},
    "command_delay": {"delay": 0.012},
    "battery_sag": {"resistance": 0.03, "discharge": 0.5},
    "ground_effect": {"strength": 1.0},
    "thrust_scatter": {"deviation": 0.03},
    "weak_propeller": {"rear_left": 0.1},
    "gusts": {"deviation": 1.5, "time": 0.3},
    "imu_noise": {"gyro": 0.01, "accel": 0.2},
}
CHANCE = np.random.default_rng(9).standard_normal((2000, NOISE))
"""The flight's noise, tick by tick: gusts are then known as well."""
SETTLED = 400
"""Ticks until the drives have forgotten where they began."""


def flat(model):
    return model.view(np.float64).reshape(model.size, -1)


@pytest.fixture(scope="module")
def flight():
    return fly_kernel(EFFECTS, seconds=2.0, seed=SEED, tick_noise=CHANCE)


def along(flight, effects, speed=None, noise=CHANCE):
    motion = motion_of(flight)
    out = np.zeros(motion.shape[0], ImposedTick.layout)
    measured = np.zeros((0, 8)) if speed is None else speed
    run_along_motion(vehicle_of(SEED), maps(), pack_theta(effects), noise, TICK, motion,
                 commands_of(flight), measured, out)  # fmt: skip
    return out


@pytest.mark.slow
def test_specific_force_and_imu_errors_are_the_simulators(flight):
    model = along(flight, EFFECTS)[SETTLED:]
    accel = model["force"] + model["accel_error"]
    gyro = flight["rates"][SETTLED:] + model["gyro_error"]
    assert accel == pytest.approx(flight["accel"][SETTLED:], abs=0.01)
    assert gyro == pytest.approx(flight["gyro"][SETTLED:], abs=1e-9)
    assert np.ptp(flight["accel"][SETTLED:], axis=0).min() > 0.1


@pytest.mark.slow
def test_rotor_speeds_and_voltage_are_the_simulators(flight):
    model = along(flight, EFFECTS)[SETTLED:]
    speed = flight["rotor_speed"][SETTLED:]
    assert model["rotor_speed"] == pytest.approx(speed, abs=0.3)
    assert np.ptp(speed) > 10.0
    volts = flight["battery"][SETTLED:, 2]
    assert model["voltage"][:, 0] == pytest.approx(volts, abs=0.01)
    assert model["current"][:, 0] == pytest.approx(flight["battery"][SETTLED:, 1], rel=0.01)


@pytest.mark.parametrize("missing", [e for e in EFFECTS if e != "thrust_scatter"])
def test_a_model_without_an_effect_says_something_else(flight, missing):
    """Each of these effects is in what is predicted."""
    whole, without = (
        flat(along(flight, effects)[SETTLED:])
        for effects in (EFFECTS, {k: v for k, v in EFFECTS.items() if k != missing})
    )
    spread = np.ptp(whole, axis=0) + 1e-6
    assert (np.abs(whole - without).max(axis=0) / spread).max() > 0.005


def test_measured_rotor_speeds_replace_those_of_the_drives(flight):
    """Thrust then comes from them, whatever was asked for; the drives go their own way."""
    true = flight["rotor_speed"]
    speed = np.hstack([true, np.gradient(true, TICK, axis=0)])
    lame = {**EFFECTS, "motor_lag": {"extra_tau": 0.1}}
    slow = along(flight, lame)[SETTLED:]
    told = along(flight, lame, speed)[SETTLED:]
    accel = flight["accel"][SETTLED:]

    def off(model):
        force = model["force"] + model["accel_error"]
        return np.abs(force - accel)[:, 2].max()

    assert off(told) < 1e-9 and off(slow) > 0.01
    assert np.abs(told["rotor_speed"] - true[SETTLED:]).max() > 5.0


CAPTURE = {
    "mocap_marker_offset": {"x": 0.03, "z": -0.02},
    "mocap_misalignment": {"yaw": 0.2, "pitch": 0.03},
    "mocap_body_misalignment": {"roll": 0.02, "yaw": -0.3},
    "mocap_latency": {"delay": 0.011},
}


@pytest.mark.slow
def test_imposed_capture_equals_the_simulators_capture():
    flown = fly_kernel(CAPTURE, seconds=1.5, seed=3)
    rows = [row for _, row in flown.delivered]
    ticks = flown.mocap["stamp"][rows].astype(int)
    true = np.hstack([flown["position"], flown["attitude"]])[ticks]
    seen = simulate_mocap(new_plant(VEHICLE), pack_theta(CAPTURE), QUIET, true, 1 / 30)
    assert seen[:, :3] == pytest.approx(flown.mocap["position"][rows], abs=1e-12)
    assert seen[:, 3:7] == pytest.approx(flown.mocap["attitude"][rows], abs=1e-12)
    assert seen[:, 7] == pytest.approx(np.full(len(rows), 0.011))
    assert not seen[:, 8:].any()


@pytest.mark.slow
def test_a_stamp_error_and_the_vehicle_at_rest():
    still = np.zeros((5, 7))
    still[:, 6] = 1.0
    theta = pack_theta({"mocap_stamp_error": {"offset": -0.02}})
    assert simulate_mocap(new_plant(VEHICLE), theta, QUIET, still, 0.03)[:, 9] == pytest.approx(
        -0.02
    )
    out = np.zeros((4000, 6))
    noise = np.random.default_rng(3).standard_normal((4000, NOISE))
    theta = pack_theta({"imu_noise": {"gyro": 0.02, "accel": 0.3}, "imu_bias": {"accel_x": 0.1}})
    simulate_imu_at_rest(new_plant(VEHICLE), theta, noise, out)
    assert out[:, :3].std() == pytest.approx(0.02, rel=0.05)
    assert out[:, 3:].mean(axis=0) == pytest.approx([0.1, 0.0, 9.81], abs=0.03)

"""Parameters of cascade and estimator: each gain with its unit, bounds and derivation."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_dynamics.params import param

RATE_TICKS = 1
ATTITUDE_TICKS = 4
POSITION_TICKS = 20
"""Periods of the three loops in ticks of 1 ms: 1000, 250 and 50 Hz."""


@dataclass(frozen=True)
class ControlParams:
    """Cascade: position P, velocity PID, attitude P, rate PID.

    Each loop is placed two and a half to three times below the next inner one, whose lag it sees:
    motor lag 35 ms -> rate crossover 19.5 rad/s -> attitude 6.3 -> velocity 2.5 -> position 1.0.
    `docs/control.md` has the margins. `test/loop_analysis.py` computes them from these numbers;
    tests compare docs, texts and the compiled cascade with them.
    """

    position_p: float = param(
        0.95,
        "1/s",
        (0.05, 5.0),
        "velocity asked for per position error",
        "crossover 1.0 rad/s, two and a half times below the velocity loop's; PX4's default",
    )
    brake: float = param(
        100.0,
        "m/s^2",
        (0.2, 100.0),
        "the velocity asked for can be stopped with this deceleration before the set point",
        "no limit: the mission's references are smooth",
    )
    velocity_p: float = param(
        2.5,
        "1/s",
        (0.1, 15.0),
        "acceleration asked for per velocity error",
        "crossover 2.5 rad/s, below half of the attitude loop's 6.3",
    )
    velocity_i: float = param(
        0.6,
        "1/s^2",
        (0.0, 5.0),
        "acceleration per integrated velocity error",
        "corner at velocity_i / velocity_p = 0.24 rad/s, a tenth of the crossover",
    )
    velocity_d: float = param(
        0.12,
        "1",
        (0.0, 1.0),
        "acceleration taken back per measured acceleration",
        "adds 7 deg of phase and 2.5 dB of gain margin; beyond 0.3 the gain margin falls again",
    )
    velocity_max_xy: float = param(2.0, "m/s", (0.1, 15.0), "horizontal velocity limit", "indoor")
    velocity_max_z: float = param(1.0, "m/s", (0.1, 8.0), "vertical velocity limit", "indoor")
    velocity_i_max: float = param(
        4.0,
        "m/s^2",
        (0.0, 8.0),
        "limit of the integral's acceleration",
        "0.4 of gravity: covers wrong mass, thrust scatter of the rigid propeller, and wind",
    )
    tilt_max: float = param(0.6, "rad", (0.05, 1.4), "limit of commanded tilt", "34 deg, indoor")
    attitude_p: float = param(
        6.0,
        "1/s",
        (0.5, 20.0),
        "body rate asked for per attitude error, roll and pitch",
        "crossover 6.3 rad/s, a third of the rate loop's",
    )
    yaw_p: float = param(
        2.5,
        "1/s",
        (0.1, 10.0),
        "body rate asked for per yaw error",
        "yaw has an eighth of the authority of roll; crossover 2.4 rad/s, two fifths of tilt's",
    )
    rate_max: float = param(
        3.8, "rad/s", (0.5, 20.0), "roll and pitch rate limit", "PX4: 220 deg/s"
    )
    yaw_rate_max: float = param(1.5, "rad/s", (0.1, 10.0), "yaw rate limit", "PX4 class")
    rate_p: float = param(
        22.0,
        "1/s",
        (1.0, 80.0),
        "angular acceleration per rate error, roll and pitch",
        "crossover 19.5 rad/s; there the motor's 35 ms cost 34 deg, the derivative gives back 18",
    )
    rate_i: float = param(
        25.0,
        "1/s^2",
        (0.0, 400.0),
        "angular acceleration per integrated rate error",
        "corner at rate_i / rate_p = 1.1 rad/s, below a tenth of the crossover",
    )
    rate_d: float = param(
        0.4,
        "1",
        (0.0, 2.0),
        "angular acceleration taken back per measured one",
        "lead at rate_p / rate_d = 55 rad/s against the motor's 29 rad/s",
    )
    yaw_rate_p: float = param(
        7.0,
        "1/s",
        (0.5, 40.0),
        "angular acceleration per yaw rate error",
        "drag torque alone would cross at 7 rad/s; the reaction to the rotors' own acceleration, "
        "a lead of 0.14 s, makes it 13",
    )
    yaw_rate_i: float = param(
        4.0,
        "1/s^2",
        (0.0, 100.0),
        "angular acceleration per integrated yaw rate error",
        "corner at 0.6 rad/s",
    )
    rate_cutoff: float = param(
        250.0,
        "rad/s",
        (20.0, 3000.0),
        "low-pass of the rate derivative",
        "40 Hz: above the lead, below the 160 Hz at which blades pass",
    )
    rate_i_max: float = param(
        40.0,
        "rad/s^2",
        (0.0, 200.0),
        "limit of the rate integral",
        "thrust scatter of 10 % asks for 25 rad/s^2 at three sigma, 1 cm of gravity offset for 9",
    )
    thrust_min: float = param(
        0.05, "1", (0.0, 0.5), "lowest collective thrust, share of the highest", "keeps rotors on"
    )
    blind_timeout: float = param(
        0.25,
        "s",
        (0.05, 5.0),
        "age of mocap after which the vehicle descends level",
        "seven samples at 30 Hz",
    )
    blind_thrust: float = param(
        0.95,
        "1",
        (0.5, 1.0),
        "thrust over weight in a level descent without mocap",
        "sinks with 0.5 m/s^2 against drag: from 2 m it lands at 1.3 m/s",
    )


@dataclass(frozen=True)
class EstimatorParams:
    """Observer: gyro and accelerometer at 1 kHz, corrected by the mocap pose."""

    position_bandwidth: float = param(
        9.0,
        "rad/s",
        (0.5, 60.0),
        "three equal poles of position, velocity, accelerometer bias",
        "lets 0.7 mm of mocap noise (1.2 mm in 3-D) through as 4.3 mm/s of velocity, each axis",
    )
    attitude_bandwidth: float = param(
        3.0,
        "rad/s",
        (0.1, 40.0),
        "two equal poles of attitude and gyro bias",
        "gyro below a minute's drift, mocap for the mean",
    )
    accel_bias_max: float = param(
        2.0, "m/s^2", (0.0, 10.0), "limit of the estimated accelerometer bias", "MEMS class"
    )
    gyro_bias_max: float = param(
        0.3, "rad/s", (0.0, 2.0), "limit of the estimated gyro bias", "MEMS class"
    )
    mocap_rate: float = param(
        30.0, "Hz", (5.0, 500.0), "rate of the motion capture", "the paper's OptiTrack"
    )
    jump_min: float = param(
        0.25,
        "m",
        (0.01, 100.0),
        "a pose this far from the estimate is refused (nodes)",
        "ten times what a blade strike moves the vehicle between two samples",
    )
    jump_speed: float = param(
        2.0,
        "m/s",
        (0.0, 100.0),
        "what is added to jump_min for each second since the last pose (nodes)",
        "the estimate drifts by 0.1 m in 0.25 s without poses; a margin of five",
    )


@dataclass(frozen=True)
class InputLimits:
    """How long the controller goes on without an input."""

    imu_timeout: float = param(
        0.02,
        "s",
        (0.002, 1.0),
        "age of the gyro after which no command is sent",
        "twenty samples: at 10 rad/s the vehicle has turned by 11 deg unseen",
    )
    odometry_timeout: float = param(
        0.1,
        "s",
        (0.01, 5.0),
        "age of the estimate after which the vehicle levels on its gyro and descends",
        "25 estimates; the position loop's phase is gone by then",
    )
    setpoint_timeout: float = param(
        0.3,
        "s",
        (0.04, 10.0),
        "age of the set point after which the vehicle holds the last one, at rest",
        "15 set points; 0.2 m of approach",
    )

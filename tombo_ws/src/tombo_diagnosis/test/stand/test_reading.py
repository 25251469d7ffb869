"""Tables of a stand: units, mappings, plateaus; and the message where they can't be used."""

import math

import numpy as np
import pytest

from tombo_diagnosis.stand.analyse import analyse
from tombo_diagnosis.stand.summary_text import summary
from tombo_diagnosis.stand.tables.assemble import assemble
from tombo_diagnosis.stand.tables.plateaus import plateaus
from tombo_diagnosis.stand.tables.table_reader import parse_mapping, read_stand
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import configuration, evaluate

RPM = np.linspace(1000.0, 6000.0, 12)
POINT = evaluate(configuration(13), RPM * math.pi / 30.0)


def write(path, header, *columns):
    rows = "\n".join(",".join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True))
    path.write_text(f"{header}\n{rows}\n")
    return path


def read_mapped(path, mapping, header, *columns):
    """Read a table with the text of its mapping."""
    (path / "m.yaml").write_text(mapping)
    return read_stand(write(path / "a.csv", header, *columns), str(path / "m.yaml"))


def test_units_in_the_headings_are_understood(tmp_path):
    columns = (POINT.thrust_N / 9.80665, POINT.torque_Nm, RPM, np.degrees(POINT.beta_rad))
    header = "Thrust (kgf),Torque (N·m),rpm,beta_deg"
    table = read_stand(write(tmp_path / "a.csv", header, *columns))
    assert np.allclose(table.channels["thrust"], POINT.thrust_N, rtol=1e-6)
    assert np.allclose(table.channels["speed"], RPM * math.pi / 30.0, rtol=1e-6)
    assert np.allclose(table.channels["beta"], POINT.beta_rad, rtol=1e-6)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("rpm", 1.0), ("rad/s", math.pi / 30.0), ("Hz", 1.0 / 60.0), ("erpm", None)],
)
def test_every_unit_of_speed_is_the_same_run(tmp_path, unit, factor):
    poles = 14 if factor is None else 2
    shown = RPM * (7.0 if factor is None else factor)
    name = "rpm" if factor is None else unit
    mapping = (
        f"channels: {{speed: {{columns: w, unit: '{name}', poles: {poles}}}, "
        "thrust: {columns: t, unit: N}}"
    )
    table = read_mapped(tmp_path, mapping, "w,t", shown, POINT.thrust_N)
    assert np.allclose(table.channels["speed"], RPM * math.pi / 30.0)


def test_several_rotors_are_one_by_mean_square(tmp_path):
    mapping = (
        "rotors: 2\nchannels: {speed: {columns: [r1, r2], unit: rpm},"
        " thrust: {columns: g, unit: g}}\n"
    )
    grams = 2000.0 * POINT.thrust_N / 9.80665
    table = read_mapped(tmp_path, mapping, "r1,r2,g", RPM, 1.1 * RPM, grams)
    assert np.allclose(table.channels["thrust"], POINT.thrust_N)
    assert np.allclose(table.channels["speed"], RPM * math.pi / 30.0 * math.sqrt(1.105))


def recording(lag=20, seed=0):
    """A staircase of 12 commands, 50 rows each, the cell late, tared at 0.3 N."""
    rng = np.random.default_rng(seed)
    levels = [0.0, *np.linspace(2000.0, 6000.0, 6), *np.linspace(5500.0, 1500.0, 6)]
    rpm = np.repeat(levels, 50)
    thrust = 2e-5 * (rpm * math.pi / 30.0) ** 2
    late = np.concatenate([np.zeros(lag), thrust[: thrust.size - lag]])
    late += 0.3 + 0.002 * rng.standard_normal(rpm.size)
    return rpm + rng.standard_normal(rpm.size) * (rpm > 0.0), late, np.repeat(np.arange(13), 50)


def test_lag_and_tare_of_a_recording_are_found(tmp_path):
    rpm, thrust, command = recording()
    path = write(tmp_path / "a.csv", "rpm,thrust_N,pwm", np.maximum(rpm, 0.0), thrust, command)
    result, found = plateaus(read_stand(path))
    (lag,) = (f for f in found if f.check == "lag")
    assert abs(int(lag.message.split(" rows")[0].split()[-1]) - 20) <= 2
    turning = result.speed > 10.0
    k = result.thrust[turning] / result.speed[turning] ** 2
    assert np.allclose(k, 2e-5, rtol=0.01)
    assert {f.check for f in found} >= {"lag", "tare"}


def test_an_outlier_is_excluded_and_reported(tmp_path):
    rng = np.random.default_rng(1)
    thrust = POINT.thrust_N * (1.0 + 1e-3 * rng.standard_normal(12))
    rpm, thrust = np.repeat(RPM, 2), np.repeat(thrust, 2)
    thrust[9] *= 1.5
    result, found = plateaus(read_stand(write(tmp_path / "a.csv", "rpm,thrust_N", rpm, thrust)))
    assert result.speed.size == 23
    [finding] = [f for f in found if f.check == "outlier"]
    assert f"{rpm[9]:.0f}" in finding.message


def test_a_glitch_of_one_of_four_tachometers_does_not_move_the_speed(tmp_path):
    rpm = np.linspace(9000.0, 9900.0, 100)
    bad = np.tile(rpm, (4, 1))
    bad[2, 50] = 900.0
    thrust = 2e-8 * (rpm * math.pi / 30.0) ** 2
    mapping = (
        "model: plain\nrotors: 1\nchannels: {speed: {columns: [a, b, c, d], unit: rpm},"
        " thrust: {columns: t, unit: N}}\n"
    )
    table = read_mapped(tmp_path, mapping, "a,b,c,d,t", *bad, thrust)
    assert table.channels["speed"][50] == pytest.approx(rpm[50] * math.pi / 30.0, rel=0.01)
    assert "c 1" in next(f for f in table.findings if f.check == "speed_glitch").message


BAD = {
    "rpm,thrust_N\n1,2\n": "3 or more",
    "time_s,thrust_N\n1,2\n2,3\n3,4\n": "no column for speed",
    "rpm,time_s\n1,2\n2,3\n3,4\n": "thrust or torque",
    "rpm,thrust\n1000,2\n2000,3\n3000,4\n": "has no unit",
    "rpm,thrust[furlong]\n1000,2\n2000,3\n3000,4\n": "unit of column",
    "rpm,thrust_N\nnan,2\n,3\nx,4\n": "rows with numbers",
    "rpm,thrust_N\n1000,-0.1\n2000,-0.5\n3000,-1.0\n": "falls with speed",
    "speed_rad_s,thrust_N\n10000,0.1\n20000,0.5\n30000,1.0\n": "pole count",
    "rpm,thrust_N\n100,0.1\n150,0.5\n170,1.0\n": "reaches 170 rpm",
    "rpm,thrust_N,thrust_sigma_N\n1000,1,.1\n2000,4,-1\n3000,9,.1\n": "has -1",
    "rpm,thrust_N,thrust_N\n1000,1,1\n2000,4,5\n3000,9,9\n": "'thrust_N' twice",
    "rpm,thrust\n1000,2\n2000,3\n3001,4\n": r"\(N, mN, kN, g, gf, kg",
    "rpm,thrust_N,beta_rad\n1000,0.1,5\n2000,0.5,8\n3000,1.0,12\n": "degrees",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_tables_are_refused_with_a_reason(tmp_path, text):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=BAD[text]) as error:
        read_stand(path)
    assert "\n" not in str(error.value)
    assert "accepted" in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("channels: {thrust: {columns: t}}", "no unit"),
        ("channels: {thrust: {columns: [a, b], unit: N}}", "one name of a column"),
        ("channels: {thrust: {columns: t, unit: N, sign: 3}}", "sign"),
        ("channels: {speed: {columns: t, unit: rpm, poles: 7}}", "even"),
        ("chanels: {}", "did you mean 'channels'"),
        ("model: helicopter", "model"),
        ("rotors: 0", "rotors"),
    ],
)
def test_bad_mappings_are_refused_with_a_reason(text, words):
    with pytest.raises(InputError, match=words):
        parse_mapping(text, "m")


@pytest.mark.slow
def test_speeds_beyond_the_law_are_excluded_and_reported(tmp_path):
    rpm = np.linspace(2000.0, 12000.0, 9)
    thrust = 1e-7 * rpm**2
    table = read_stand(write(tmp_path / "a.csv", "rpm,thrust_N", rpm, thrust))
    points, findings = assemble([table], 5, "repaired")
    assert any("6635 rpm" in f.message for f in findings if f.check == "speed")
    words = summary(analyse(points), ())
    assert words.startswith("4 points")  # of nine: those beyond do not count


def test_too_few_points_within_the_law_are_refused(tmp_path):
    rpm = np.array([2000.0, 4000.0, 14000.0, 16000.0, 17900.0])
    table = read_stand(write(tmp_path / "a.csv", "rpm,thrust_N", rpm, 1e-7 * rpm**2))
    with pytest.raises(InputError, match=r"2 of 5 points .* accepted: 3 or more"):
        assemble([table], 5, "repaired")


def test_a_cell_mounted_the_other_way_round_can_be_read(tmp_path):
    mapping = (
        "channels: {speed: {columns: rpm, unit: rpm}, thrust: {columns: t, unit: N, sign: -1}}"
    )
    table = read_mapped(tmp_path, mapping, "rpm,t", RPM, -POINT.thrust_N)
    assert np.allclose(table.channels["thrust"], POINT.thrust_N)


@pytest.mark.slow
def test_one_speed_is_never_enough_for_a_name(tmp_path):
    path = write(tmp_path / "a.csv", "rpm,thrust_N", np.full(4, 5000.0), np.full(4, 4.6))
    result = analyse(assemble([read_stand(path)], 13, "repaired")[0])
    assert result.judgement.verdict == "set"
    assert {"thrust_gain", "thrust_coefficient"} <= set(result.judgement.members)


def test_the_same_run_twice_is_refused(tmp_path):
    one = read_stand(write(tmp_path / "a.csv", "rpm,thrust_N", RPM, POINT.thrust_N))
    copy = read_stand(write(tmp_path / "b.csv", "rpm,thrust_N", RPM, POINT.thrust_N))
    for other in (one, copy):
        with pytest.raises(InputError, match="the same numbers"):
            assemble([one, other], 13, "repaired")


@pytest.mark.parametrize(("conf", "words"), [(13.5, "13.5"), (99, "99")])
def test_an_unknown_configuration_says_where_it_stands(tmp_path, conf, words):
    path = write(tmp_path / "a.csv", "kind,rpm,thrust_N", np.full(12, conf), RPM, POINT.thrust_N)
    path.write_text(path.read_text().replace("kind", "conf"))
    with pytest.raises(InputError) as error:
        assemble([read_stand(path)], 13, "repaired")
    assert all(x in str(error.value) for x in ("a.csv", "'conf'", words))


def test_a_large_tare_is_no_wrong_unit(tmp_path):
    thrust = POINT.thrust_N + 3.0 * POINT.thrust_N[-1]
    path = write(tmp_path / "a.csv", "rpm,thrust_N", RPM, thrust)
    assert assemble([read_stand(path)], 13, "repaired")[0].count == 12


@pytest.mark.parametrize(
    ("speed", "thrust", "accepted"),
    [
        (1.0, 1e3 / 9.80665, False),
        (math.pi / 30.0, 1.0, False),
        (1.0, 4.0, False),
        (1.0, 1.5, True),
    ],
    ids=["grams", "rad/s", "four rotors", "newtons"],
)
def test_thrust_in_a_wrong_unit_is_refused(tmp_path, speed, thrust, accepted):
    rpm = np.linspace(4500.0, 6000.0, 12)
    newton = evaluate(configuration(13), rpm * math.pi / 30.0).thrust_N
    path = write(tmp_path / "a.csv", "rpm,thrust_N", rpm * speed, newton * thrust)
    if accepted:
        assert assemble([read_stand(path)], 13, "repaired")[0].count == 12
        return
    right = read_stand(write(tmp_path / "b.csv", "rpm,thrust_N", rpm, newton))
    with pytest.raises(InputError, match=r"a\.csv.*'thrust_N' as N is .* the model's thrust"):
        assemble([right, read_stand(path)], 13, "repaired")


def ramp(rng, steps=0):
    """Command [us], speed [rpm] and thrust [N] of a ramp, with plateaus of 30 rows behind it."""
    share = np.concatenate(
        [np.linspace(0.0, 1.0, 400), np.repeat(np.linspace(0.2, 0.8, 3), 30 * (steps > 0))]
    )
    speed = 6000.0 * share
    thrust = 9e-6 * (speed * math.pi / 30.0) ** 2 + rng.normal(0.0, 0.01, share.size)
    return 1000.0 + 1000.0 * share, speed, thrust


@pytest.mark.parametrize("steps", [0, 3])
@pytest.mark.parametrize("seed", range(5))
def test_a_ramp_of_commands_is_cut_into_points_and_its_rows_are_said(tmp_path, steps, seed):
    columns = ramp(np.random.default_rng(seed), steps)
    points, found = plateaus(read_stand(write(tmp_path / "a.csv", "pwm,rpm,thrust_N", *columns)))
    assert points.speed.size >= 38 and points.speed.max() > 5800.0 * math.pi / 30.0
    k = points.thrust @ points.speed**2 / (points.speed**2 @ points.speed**2)
    assert k == pytest.approx(9e-6, rel=0.01)
    (said,) = [f.message for f in found if f.check == "rows"]
    assert said.startswith(f"{points.speed.size} points from ") and int(said.split()[3]) >= 360


@pytest.mark.parametrize("unit", ["N·m", "N⋅m", "N.m", "N-m", "Nm"])
def test_a_dead_tachometer_gives_way_in_a_table_of_rcbenchmark(tmp_path, unit):
    header = f"ESC signal (µs),Torque ({unit}),Thrust (N)"
    header += ",Motor Optical Speed (RPM),Motor Electrical Speed (RPM)"
    columns = (RPM, POINT.torque_Nm, POINT.thrust_N, 0.0 * RPM, RPM)
    table = read_stand(write(tmp_path / "a.csv", header, *columns))
    assert np.allclose(table.channels["speed"], RPM * math.pi / 30.0)
    assert np.allclose(table.channels["torque"], POINT.torque_Nm)


@pytest.mark.parametrize(("lost", "count"), [([5], 1), ([0, 1, 2], 2), ([4, 11], 2)])
def test_a_tachometer_that_drops_out_is_no_standstill(tmp_path, lost, count):
    """The first of several rows before the start may be one of a rotor that stands."""
    speed = RPM.copy()
    speed[lost] = 0.0
    table = read_stand(write(tmp_path / "a.csv", "rpm,thrust_N", speed, POINT.thrust_N))
    assert table.channels["speed"].size == RPM.size - count
    (said,) = [f for f in table.findings if f.check == "speed_dropout"]
    assert f"in {count} rows" in said.message


def test_known_weights_at_standstill_stay(tmp_path):
    speed, hung = np.concatenate([np.zeros(2), RPM]), np.concatenate([[2.0, 4.0], 0.0 * RPM])
    thrust = hung + np.concatenate([np.zeros(2), POINT.thrust_N])
    path = write(tmp_path / "a.csv", "rpm,thrust_N,applied_thrust_N", speed, thrust, hung)
    assert read_stand(path).channels["speed"].size == speed.size


def test_coefficients_of_a_table_parted_by_spaces_are_loads(tmp_path):
    """As UIUC publishes static runs: the diameter in inches is in the name."""
    rows = "\n".join(f"{rpm:9.2f}   0.110000   0.045000 " for rpm in RPM)
    (tmp_path / "apcsf_10x4.7_static.txt").write_text(f"RPM     CT       CP     \n{rows}\n")
    table = read_stand(tmp_path / "apcsf_10x4.7_static.txt")
    n, d = RPM / 60.0, 0.254
    assert np.allclose(table.channels["thrust"], 0.11 * 1.225 * n**2 * d**4)
    power = 0.045 * 1.225 * n**3 * d**5
    assert np.allclose(table.channels["torque"] * 2.0 * math.pi * n, power)


def test_coefficients_need_a_diameter(tmp_path):
    with pytest.raises(InputError, match="diameter_mm"):
        read_stand(write(tmp_path / "a.csv", "rpm,ct", RPM, 0.0 * RPM + 0.11))


def test_lines_may_end_with_a_carriage_return_alone(tmp_path):
    path = write(tmp_path / "a.csv", "rpm,thrust_N", RPM, POINT.thrust_N)
    path.write_bytes(path.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r"))
    assert np.allclose(read_stand(path).channels["thrust"], POINT.thrust_N)

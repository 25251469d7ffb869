"""Tables: units, axes and orders of a mapping, and damaged files."""

import gzip

import numpy as np
import pytest
from log_writers import close, table_text
from made_flight import made_flight
from scipy.spatial.transform import Rotation

from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.readers.csv_log import read_csv
from tombo_logs.readers.csv_mapping import parse_mapping, shipped

FLIGHT = made_flight(duration=8.0, mocap_hz=50.0, imu_hz=100.0)
POSE = ("position", "attitude")
P, Q = (FLIGHT.series[name].values for name in POSE)
GYRO = FLIGHT.series["gyro"].values[: len(P)]
COLUMNS = """
  position: {columns: [x, y, z], unit: m}
  attitude: {columns: [qx, qy, qz, qw]}
"""


def written(path, text):
    path.write_text(text)
    return path


def table(path, **columns):
    names = list(columns)
    rows = np.column_stack([columns[n] for n in names])
    lines = [",".join(names), *(",".join(repr(float(x)) for x in row) for row in rows)]
    return written(path, "\n".join(lines) + "\n")


def posed(path, position, quaternion, **more):
    """A table of poses with the columns of COLUMNS."""
    return table(
        path,
        t=FLIGHT.series["position"].t,
        **dict(zip("xyz", position.T, strict=True)),
        **dict(zip(("qx", "qy", "qz", "qw"), quaternion.T, strict=True)),
        **more,
    )


def read(path, mapping):
    """The flight of a table under the text of a mapping."""
    return read_csv(path, "a", parse_mapping(mapping, "lab"))


def numbered(name, values):
    return {f"{name}{i}": column for i, column in enumerate(values.T)}


def same_turns(a, b):
    assert (Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude().max() < 1e-9


def test_a_table_with_our_names_needs_no_mapping(tmp_path):
    log = read_csv(written(tmp_path / "a.csv", table_text(FLIGHT)), "a")
    assert set(log.series) == set(FLIGHT.series)
    for name, series in FLIGHT.series.items():
        # each channel has the rows that it had, at its own stamps
        close(log.series[name].t - log.series[name].t[0], series.t - series.t[0], 2e-6)
        close(log.series[name].values, series.values)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_delimiters_byte_order_marks_and_comments_are_understood(tmp_path, delimiter):
    text = "\ufeff# from the lab\n" + table_text(FLIGHT, POSE, delimiter)
    log = read_csv(written(tmp_path / "a.csv", text), "a")
    close(log.series["position"].values, FLIGHT.series["position"].values)


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_commas_are_understood(tmp_path, delimiter):
    text = table_text(FLIGHT, POSE, delimiter).replace(".", ",")
    log = read_csv(written(tmp_path / "a.csv", text), "a")
    close(log.series["position"].values, FLIGHT.series["position"].values)
    (finding,) = log.findings
    assert finding.severity == "info" and "decimal commas" in finding.message


@pytest.mark.parametrize(
    ("names", "cells"),
    [("", ""), ("frame_id,", "map,"), ("frame_id,child,", ",base_link,"), ("1,frame,", "0,map,")],
)
@pytest.mark.parametrize("mark", ["#", "%"])
def test_a_header_may_stand_behind_a_mark_with_texts_in_the_rows(tmp_path, mark, names, cells):
    header, *rows = table_text(FLIGHT, POSE).splitlines()
    text = "\n".join([f"{mark} from the lab", mark + names + header, *(cells + r for r in rows)])
    log = read_csv(written(tmp_path / "a.csv", text + "\n"), "a")
    close(log.series["position"].values, FLIGHT.series["position"].values)


def test_a_minus_before_a_column_and_a_scale_turn_it_round(tmp_path):
    slow = {
        f"w{i}": 0.1 * column for i, column in enumerate(FLIGHT.series["rotor_speed"].values.T)
    }
    n = len(P)
    path = posed(tmp_path / "a.csv", P * [1, -1, 1], Q, **{k: v[:n] for k, v in slow.items()})
    text = (
        f"time: t\nchannels:{COLUMNS.replace('x, y, z', 'x, -y, z')}"
        "  rotor_speed: {columns: [-w0, w1, -w2, w3], unit: rad/s, scale: 10}\n"
    )
    log = read(path, text)
    close(log.series["position"].values, P)
    close(log.series["rotor_speed"].values, FLIGHT.series["rotor_speed"].values[:n])


def test_units_and_axes_of_a_mapping_give_the_flight_back(tmp_path):
    """NED and FRD, millimetres, degrees per second, g, thousandths of a second, wxyz."""
    world, body = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]), np.diag([1.0, -1.0, -1.0])
    p, q = FLIGHT.series["position"], FLIGHT.series["attitude"]
    attitude = Rotation.from_matrix(world @ Rotation.from_quat(q.values).as_matrix() @ body)
    n = p.t.size
    gyro, accel = (FLIGHT.series[c].values[:n] @ body.T for c in ("gyro", "accel"))
    x, y, z, w = attitude.as_quat().T
    path = table(
        tmp_path / "a.csv", ms=1000.0 * p.t, w=w, x=x, y=y, z=z,
        **dict(zip("ned", 1000.0 * (p.values @ world.T).T, strict=True)),
        **numbered("g", np.degrees(gyro)), **numbered("a", accel / GRAVITY),
        **{f"pwm{i}": 1000.0 + 250.0 * i + 0.0 * p.t for i in range(4)},
    )  # fmt: skip
    mapping = """
time: {column: ms, unit: ms}
world: NED
body: FRD
channels:
  position: {columns: [n, e, d], unit: mm}
  attitude: {columns: [w, x, y, z], order: wxyz}
  gyro: {columns: [g0, g1, g2], unit: deg/s}
  accel: {columns: [a0, a1, a2], unit: g}
  motor_command: {columns: [pwm3, pwm0, pwm1, pwm2], range: [1000, 2000]}
"""
    log = read(path, mapping)
    close(log.series["position"].t, p.t - p.t[0])
    close(log.series["position"].values, p.values)
    same_turns(log.series["attitude"].values, q.values)
    close(log.series["gyro"].values, FLIGHT.series["gyro"].values[:n])
    close(log.series["accel"].values, FLIGHT.series["accel"].values[:n])
    close(log.series["motor_command"].values[0], [0.75, 0.0, 0.25, 0.5])


@pytest.mark.parametrize("order", ["rpy", "ypr"])
def test_angles_are_turned_into_quaternions(tmp_path, order):
    ypr = Rotation.from_quat(Q).as_euler("ZYX", degrees=True)
    angles = ypr if order == "ypr" else ypr[:, ::-1]
    path = posed(tmp_path / "a.csv", P, Q, **numbered("a", angles))
    mapping = f"""
time: t
channels:
  position: {{columns: [x, y, z], unit: m}}
  attitude: {{columns: [a0, a1, a2], order: {order}, unit: deg}}
"""
    same_turns(read(path, mapping).series["attitude"].values, Q)


def test_turn_deg_takes_a_rigid_body_back_to_base_link(tmp_path):
    off = Rotation.from_euler("xyz", [3.0, -5.0, 40.0], degrees=True)
    path = posed(tmp_path / "a.csv", P, (Rotation.from_quat(Q) * off).as_quat())
    turn = off.inv().as_euler("xyz", degrees=True).tolist()
    log = read(path, f"time: t\nturn_deg: {turn}\nchannels:{COLUMNS}")
    same_turns(log.series["attitude"].values, Q)


def test_a_channel_may_have_stamps_and_arrivals_of_its_own(tmp_path):
    t = FLIGHT.series["position"].t
    path = posed(tmp_path / "a.csv", P, Q, sent=t - 0.02, came=t + 0.01)
    text = (
        "time: t\nchannels:\n"
        "  position: {columns: [x, y, z], unit: m, time: sent, arrival: came}\n"
        "  attitude: {columns: [qx, qy, qz, qw]}\n"
    )
    log = read(path, text)
    close(log.series["position"].t, t - t[0])
    close(log.series["attitude"].t, t - t[0] + 0.02)
    close(log.series["position"].arrival - log.series["position"].t, 0.03)


def test_columns_that_no_mapping_fits_are_listed(tmp_path):
    path = written(tmp_path / "a.csv", "zeit,hoehe,breite\n1,2,3\n")
    with pytest.raises(InputError, match=r"zeit, hoehe, breite.*docs/logs\.md.*--mapping"):
        read_csv(path, "a")


def test_a_missing_column_is_named_with_the_closest_there_is(tmp_path):
    path = written(tmp_path / "a.csv", table_text(FLIGHT).replace("position_z", "position_zz", 1))
    with pytest.raises(InputError, match=r"'position_z'.*did you mean 'position_zz'"):
        read_csv(path, "a", shipped()["generic"])


def test_a_column_may_be_spelled_in_another_case(tmp_path):
    mapping = f"time: {{column: t, unit: s}}\nchannels: {COLUMNS.replace('qw', 'Qw')}"
    same_turns(read(posed(tmp_path / "a.csv", P, Q), mapping).series["attitude"].values, Q)


def test_a_channel_with_part_of_its_columns_is_left_out_and_said(tmp_path):
    text = table_text(FLIGHT).replace("gyro_z", "gyro_zz", 1)
    log = read_csv(written(tmp_path / "a.csv", text), "a")
    assert "gyro" not in log.series
    assert [(f.check, f.channel) for f in log.findings] == [("missing", "gyro")]


def test_a_cut_archive_is_read_up_to_where_it_is_whole(tmp_path):
    whole = gzip.compress(table_text(FLIGHT, POSE).encode())
    (tmp_path / "a.csv.gz").write_bytes(whole[: len(whole) * 2 // 3])
    log = read_csv(tmp_path / "a.csv.gz", "a")
    position = log.series["position"].values
    assert 0.4 * len(P) < len(position) < len(P)
    assert any("cut off" in f.message for f in log.findings)
    close(position, P[: len(position)])


def test_rows_that_are_not_whole_are_left_out_and_counted(tmp_path):
    lines = table_text(FLIGHT, POSE).splitlines()
    lines[5] = lines[5].rpartition(",")[0]
    lines[9] = lines[9].replace(lines[9].split(",")[1], "oops")
    lines[12] = '"' + lines[12]  # a mark that never ends
    log = read_csv(written(tmp_path / "a.csv", "\n".join(lines)), "a")
    texts = " ".join(f.message for f in log.findings)
    assert "1 of" in texts and "1 cells are no numbers" in texts
    assert log.series["position"].t.size == FLIGHT.series["position"].t.size - 1


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "is empty"),
        (b"\x1f\x8b\x08garbage", "can't be unpacked"),
        (b"1,2,3\n4,5,6\n", "accepted: a header"),
        (b"nothing that is a table", "accepted: a header"),
        (b"t,position_x\n", "no mapping given"),
    ],
)
def test_what_is_no_table_is_said_in_a_line(tmp_path, content, complaint):
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=complaint) as error:
        read_csv(path, "a")
    assert "\n" not in str(error.value)


def test_a_header_without_rows_and_a_column_twice_are_refused(tmp_path):
    header = table_text(FLIGHT, POSE).splitlines()[0]
    with pytest.raises(InputError, match="no row of numbers"):
        read_csv(written(tmp_path / "a.csv", header + "\n"), "a")
    with pytest.raises(InputError, match="'position_x' twice"):
        read_csv(written(tmp_path / "b.csv", f"{header},position_x\n1,2,3,4,5,6,7,8,9\n"), "b")


def test_rows_without_a_column_of_times_have_a_stated_rate(tmp_path):
    path = posed(tmp_path / "a.csv", P, Q)
    log = read(path, f"time: {{rate: 50}}\nchannels:{COLUMNS}")
    close(log.series["position"].t, np.arange(len(P)) / 50.0, 1e-12)
    close(log.series["position"].values, P)


@pytest.mark.parametrize("time", ["{rate: 0}", "{rate: many}", "{rate: 50, column: t}"])
def test_a_rate_is_a_number_in_place_of_a_column(time):
    with pytest.raises(InputError, match="rate"):
        parse_mapping(f"time: {time}\nchannels:{COLUMNS}", "lab")

"""Any file: what kind it is, its first bytes say; other files are refused in one line."""

import gzip
from pathlib import Path

import pytest
from log_writers import table_text, write_bag, write_ulog
from made_flight import made_flight

from tombo_dynamics.errors import InputError
from tombo_logs.readers.log_reader import flight_names, read_logs

FLIGHT = made_flight(duration=6.0, mocap_hz=50.0, imu_hz=100.0)
OTHER = made_flight(duration=6.0, mocap_hz=50.0, imu_hz=100.0, seed=1)


@pytest.mark.parametrize("name", ["a", "a.mcap"])
def test_the_kind_of_a_file_is_not_its_name(tmp_path, name):
    path = tmp_path / name
    write_ulog(path, FLIGHT)
    assert "PX4 log" in read_logs([path])[0].source
    path.unlink()
    write_bag(path, FLIGHT)
    assert "recording" in read_logs([path])[0].source
    path.write_text(table_text(FLIGHT))
    assert "table" in read_logs([path])[0].source
    path.write_bytes(gzip.compress(table_text(FLIGHT).encode()))
    assert "table" in read_logs([path])[0].source


def test_a_flight_given_twice_is_refused(tmp_path):
    """Held-out flights would confirm their own errors."""
    one = tmp_path / "one.csv"
    one.write_text(table_text(FLIGHT))
    with pytest.raises(InputError, match="given twice"):
        read_logs([one, tmp_path])


def test_logs_of_a_folder_have_short_and_unique_names(tmp_path):
    for folder, flight in (("mon", FLIGHT), ("tue", OTHER)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "circle.csv").write_text(table_text(flight))
        (tmp_path / folder / "notes.md").write_text("a fine day")
    logs = read_logs([tmp_path / "mon", tmp_path / "tue" / "circle.csv"])
    assert [log.name for log in logs] == ["mon/circle", "tue/circle"]


def test_generic_file_names_are_replaced_by_the_folder_or_numbered():
    paths = ["/d/run-1/flight.mcap", "/d/run-2/flight.mcap", "/d/x/log_0.csv.gz", "/d/y.ulg"]
    assert flight_names([Path(p) for p in paths]) == ["run-1", "run-2", "x", "y"]
    assert flight_names([Path("/a/d/y.csv"), Path("/a/d/y.ulg")]) == ["y#1", "y#2"]
    paths = ["/home/me/flights/lab/1.csv", "/home/me/flights/lab/2.csv", "/home/me/x/1.csv"]
    assert flight_names([Path(p) for p in paths]) == ["lab/1", "lab/2", "x/1"]


def test_a_mapping_brings_airframe_and_turn_to_recordings(tmp_path):
    bag, mapping = tmp_path / "a.mcap", tmp_path / "lab.yaml"
    write_bag(bag, FLIGHT)
    mapping.write_text(
        "turn_deg: [0, 0, 90]\nairframe: {name: f450, mass: 1.2, arm_length: 0.2, "
        "rotor_radius: 0.12}\n"
    )
    plain, turned = read_logs([bag])[0], read_logs([bag], mapping)[0]
    assert turned.airframe.mass == 1.2 and turned.airframe.inertia is None
    first, second = (log.series["attitude"].values[0] for log in (plain, turned))
    assert abs(first @ second) == pytest.approx(0.5**0.5, abs=1e-6)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "is empty"),
        (b"\x7fELF\x02\x01\x01\0\0\0", "no log that is known"),
        (b"\x89MCAP0\r\n", "has no poses|holds no|no recording|MCAP"),
        (b"\x55\x4c\x6f\x67\x01\x12\x35\x01", "not a whole ULog"),
        (b"SQLite format 3\0", "."),
        (b"#ROSBAG V1.2\n", "version"),
    ],
)
def test_what_is_no_log_is_refused_in_a_line(tmp_path, content, complaint):
    path = tmp_path / "a.bin"
    path.write_bytes(content)
    with pytest.raises(InputError, match=complaint) as error:
        read_logs([path])
    assert "\n" not in str(error.value)


def test_paths_that_lead_nowhere(tmp_path):
    for paths, complaint in (([], "no logs"), ([tmp_path], "holds no logs"),
                             ([tmp_path / "no"], "does not exist")):  # fmt: skip
        with pytest.raises(InputError, match=complaint):
            read_logs(paths)

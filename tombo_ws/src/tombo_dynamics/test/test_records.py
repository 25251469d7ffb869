"""Records: fields by name, shared with compiled code, described by unit and doc."""

import copy

import pytest

from tombo_dynamics.jit import compiled
from tombo_dynamics.records import Record, field, fill_record
from tombo_dynamics.vehicle import VehicleParams


class Point(Record):
    place = field("m", "map", 3)
    count = field("1", "number of detections", kind=int)


class Track(Record):
    start = field("", "where it begins", kind=Point)
    points = field("", "a ring", 4, kind=Point)
    vehicle = field("", "who flies", kind=VehicleParams)
    valid = field("1", "", kind=bool)


@compiled
def walk(track, k):
    track.start.place[1] += track.vehicle.mass
    track.points[k].count += 2
    track.valid = True


def test_compiled_code_writes_what_python_reads():
    track = Track.new()
    fill_record(track.vehicle, VehicleParams(mass=1.7))
    walk(track, 3)
    assert track.start.place == pytest.approx([0.0, 1.7, 0.0])
    assert [point.count for point in track.points] == [0, 0, 0, 2]
    assert track.valid


def test_a_deep_copy_keeps_record_and_array_one_piece_of_memory():
    track = Track.new()
    both = copy.deepcopy({"record": track, "array": track.as_array()})
    both["record"].start.count = 5
    assert both["array"][0].start.count == 5
    assert track.start.count == 0


def test_a_name_with_a_meaning_in_numpy_is_refused():
    with pytest.raises(ValueError, match="Shape: numpy has its own meaning for shape"):
        type("Shape", (Record,), {"shape": field("1", "")})

"""The dataclasses of the messages are those of their definitions."""

from __future__ import annotations

import dataclasses
import inspect

import pytest

from tombo_benchmarks.docs.message_module import message_classes, message_module
from tombo_dynamics import messages
from tombo_dynamics.errors import InputError


def test_module_is_as_the_definitions_say():
    module = inspect.getsource(messages)
    assert message_module(module) == module, "run `make messages`"


WIND = """# Estimate of the wind.

uint8 SOURCE_DRIFT=1    # from the drift in hover
uint8 SOURCE_TILT=2     # from the mean tilt
int8 NONE=-1            # value of rotor where no rotor says it

std_msgs/Header header            # [s] stamp: time of the estimate; frame map (ENU)
geometry_msgs/Vector3 velocity    # [m/s] of the air in map
float64 age 1.5                   # [s] since the last change
uint8 source                      # [-] no frame; one of the SOURCE_ constants
int8 rotor                        # [-] no frame; struck rotor
"""


def made(text):
    namespace = vars(messages).copy()
    exec(message_classes({"tombo_msgs/msg/Wind": text}), namespace)
    return namespace


def test_definition_becomes_enum_constant_and_dataclass():
    found = made(WIND)
    assert {one.name: one.value for one in found["Source"]} == {"DRIFT": 1, "TILT": 2}
    assert found["ROTOR_NONE"] == -1
    kind = found["Wind"]
    assert kind.__doc__ == "Estimate of the wind."
    assert kind.frame == "map"
    fields = {one.name: one for one in dataclasses.fields(kind)}
    assert list(fields) == ["stamp_ns", "velocity", "age", "source", "rotor"]
    assert dict(fields["velocity"].metadata) == {"unit": "m/s", "length": 3}
    assert dict(fields["age"].metadata) == {"unit": "s"}


def test_message_without_a_fixed_size_becomes_no_class():
    assert "Wind" not in made(WIND + "string[] names    # [-] no frame; of the estimators\n")


@pytest.mark.parametrize(
    ("line", "wanted", "complaint"),
    [
        ("[m/s] of the air in map", "of the air in map", r"a comment as '# \[m\] what it is'"),
        ("; frame map (ENU)", "; frame odom", "frame map|base_link"),
        ("geometry_msgs/Vector3 velocity", "geometry_msgs/Pose velocity", "accepted: numbers"),
        ("value of rotor where", "where", "NONE; accepted: a constant that a field"),
        ("float64 age 1.5", "float64 age = 1.5 s", "accepted: a field or a constant"),
    ],
)
def test_definition_that_does_not_say_enough_is_refused(line, wanted, complaint):
    assert line in WIND
    with pytest.raises(InputError, match=complaint):
        message_classes({"tombo_msgs/msg/Wind": WIND.replace(line, wanted)})

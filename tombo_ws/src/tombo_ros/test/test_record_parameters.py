"""Records as ROS parameters: set and described by services, refused with a reason."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

pytest.importorskip("rclpy")

import rclpy
from rcl_interfaces.msg import ParameterType, SetParametersResult
from rcl_interfaces.srv import DescribeParameters, SetParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from tombo_control.params import EstimatorParams
from tombo_control.planning.course import Waypoint
from tombo_control.planning.mission import MissionParams
from tombo_dynamics.errors import InputError
from tombo_dynamics.params import param
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice
from tombo_ros.record_parameters import RecordParameters


@dataclass(frozen=True)
class _Counted:
    number: int = param(3, "1", (1, 9), "how many")
    share: float = param(0.5, "1", (0.0, 1.0), "how much", "estimated")
    on: bool = True
    name: str = "none"


def _messages(values: dict[str, Any]) -> list[Any]:
    return [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]


class _Served:
    """Parameters of a node in one context, a client in another; DDS between them."""

    def __init__(self, arguments: tuple[str, ...] = ()) -> None:
        self.contexts = [rclpy.Context(), rclpy.Context()]
        line = ["--ros-args", *[word for a in arguments for word in ("-p", a)]]
        rclpy.init(args=line, context=self.contexts[0])
        rclpy.init(context=self.contexts[1])
        self.node = rclpy.create_node("served", context=self.contexts[0])
        self.client = rclpy.create_node("client", context=self.contexts[1])
        self.executor = SingleThreadedExecutor(context=self.contexts[0])
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.over = False

    def begin(self) -> RecordParameters:
        records = {
            "estimator": EstimatorParams(),
            "counted": _Counted(),
            "propeller": PropellerChoice(),
            "mission": MissionParams(),
        }
        self.parameters = RecordParameters(self.node, records, fixed=("propeller",))
        self.parameters.declare("speed", 1.0, "how fast", bounds=(0.0, 10.0), read_only=False)
        self.parameters.declare("seed", 4, "random seed", bounds=(0, 100))
        self.parameters.declare("animal", "dog", "kept", read_only=False)
        self.parameters.declare("topics", [], "to record", read_only=False)
        self.executor.add_node(self.node)
        self.thread.start()
        return self.parameters

    def _serve(self) -> None:
        while not self.over:
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        client = self.client.create_client(kind, f"/served/{name}")
        assert client.wait_for_service(60.0)
        future = client.call_async(request)
        executor = SingleThreadedExecutor(context=self.contexts[1])
        executor.add_node(self.client)
        executor.spin_until_future_complete(future, 10.0)
        executor.remove_node(self.client)
        self.client.destroy_client(client)
        return future.result()

    def set(self, **values: Any) -> list[SetParametersResult]:
        request = SetParameters.Request(parameters=_messages(values))
        return list(self.call(SetParameters, "set_parameters", request).results)

    def set_together(self, **values: Any) -> SetParametersResult:
        request = SetParametersAtomically.Request(parameters=_messages(values))
        return self.call(SetParametersAtomically, "set_parameters_atomically", request).result

    def stored(self, name: str) -> Any:
        return self.node.get_parameter(name).value

    def close(self) -> None:
        self.over = True
        if self.thread.is_alive():
            self.thread.join(5.0)
        for node, context in zip((self.node, self.client), self.contexts, strict=True):
            node.destroy_node()
            rclpy.shutdown(context=context)


@pytest.fixture(scope="module")
def _domain() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", "101")
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield


@pytest.fixture(scope="module")
def served(_domain: None) -> Iterator[_Served]:
    made = _Served()
    made.begin()
    yield made
    made.close()


def _started(arguments: tuple[str, ...]) -> RecordParameters:
    """Parameters of a node started with arguments; never served."""
    made = _Served(arguments)
    try:
        return made.begin()
    finally:
        made.close()


@pytest.mark.slow
def test_a_field_is_set_and_the_record_replaced_as_a_whole(served: _Served) -> None:
    before = served.parameters.records["estimator"]
    served.parameters.changed()
    for _ in range(2):  # the same value again counts as set
        (result,) = served.set(estimator__jump_min=0.75)
        assert result.successful
    after = served.parameters.records["estimator"]
    assert after.jump_min == served.stored("estimator.jump_min") == 0.75
    assert before.jump_min != 0.75
    assert served.parameters.changed() == ["estimator", "estimator"]
    assert served.parameters.changed() == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"estimator__jump_min": 1e9}, "estimator.jump_min"),
        ({"estimator__jump_min": float("nan")}, "estimator.jump_min"),
        ({"estimator__jump_min": "far"}, "expected 'Type.DOUBLE' got 'Type.STRING'"),
        ({"estimator__jump_min": True}, "expected 'Type.DOUBLE' got 'Type.BOOL'"),
        ({"counted__number": 10}, "counted.number"),
        ({"estimator__jump_min": 2}, "expected 'Type.DOUBLE' got 'Type.INTEGER'"),
        ({"speed": -1.0}, "speed"),
        ({"seed": 5}, "seed"),
        ({"estimator__jmup_min": 1.0}, "undeclared"),
        ({"propeller__conf": 10}, "propeller.conf is read-only: it is used at the start"),
        ({"use_sim_time": True}, "use_sim_time is read-only: it is used at the start"),
        ({"mission__course": "[{sped: 1}]"}, "'sped'"),
        ({"mission__course": "[{speed: 1"}, "mission.course is not valid YAML"),
    ],
)
def test_a_bad_value_is_refused_with_a_reason_and_changes_nothing(
    served: _Served, values: dict[str, Any], named: str
) -> None:
    records, name = dict(served.parameters.records), next(iter(values)).replace("__", ".")
    stored = served.stored(name) if served.node.has_parameter(name) else None
    served.parameters.changed()
    (result,) = served.set(**values)
    assert not result.successful
    assert named in result.reason
    assert "\n" not in result.reason
    assert served.parameters.records == records
    assert served.parameters.changed() == []
    if stored is not None:
        assert served.stored(name) == stored


@pytest.mark.slow
def test_a_structure_is_set_as_yaml_in_a_text(served: _Served) -> None:
    assert served.stored("mission.course") == ""
    (result,) = served.set(mission__course="[{x: 1, speed: 2e-1}, {yaw: 1.5}]")
    assert result.successful
    course = (Waypoint(x=1.0, speed=0.2), Waypoint(yaw=1.5))
    assert served.parameters.records["mission"].course == course
    assert served.set(mission__height=1.5)[0].successful
    assert served.parameters.records["mission"].course == course
    assert served.set(mission__course="")[0].successful
    assert served.parameters.records["mission"].course is None
    started = _started(('mission.course:="[{x: 2.0}]"',))
    assert started.records["mission"].course == (Waypoint(x=2.0),)


@pytest.mark.slow
def test_several_at_once_are_taken_all_or_none(served: _Served) -> None:
    served.set(estimator__mocap_rate=30.0, counted__share=0.5, speed=1.0)
    served.parameters.changed()
    result = served.set_together(estimator__mocap_rate=60.0, counted__share=7.0, speed=2.0)
    assert not result.successful
    assert "counted.share" in result.reason
    assert served.parameters.records["estimator"].mocap_rate == 30.0
    assert served.parameters.get("speed") == served.stored("speed") == 1.0
    assert served.parameters.changed() == []
    result = served.set_together(estimator__mocap_rate=60.0, counted__share=0.75, speed=2.0)
    assert result.successful
    assert served.parameters.records["estimator"].mocap_rate == 60.0
    assert served.parameters.records["counted"].share == 0.75
    assert served.parameters.get("speed") == 2.0
    assert sorted(served.parameters.changed()) == ["counted", "estimator", "speed"]


@pytest.mark.slow
def test_each_parameter_is_described_typed_and_bounded(served: _Served) -> None:
    names = ["estimator.jump_min", "counted.number", "counted.on", "counted.name", "seed", "speed"]
    request = DescribeParameters.Request(names=names)
    answer = served.call(DescribeParameters, "describe_parameters", request).descriptors
    double, integer = ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_INTEGER
    on_off, text = ParameterType.PARAMETER_BOOL, ParameterType.PARAMETER_STRING
    assert [d.type for d in answer] == [double, integer, on_off, text, integer, double]
    assert [d.read_only for d in answer] == [False, False, False, False, True, False]
    jump, number, *_ = answer
    assert jump.description.endswith("[m]") and jump.additional_constraints
    (reach,), (whole,) = jump.floating_point_range, number.integer_range
    assert (reach.from_value, reach.to_value) == (0.01, 100.0)
    assert (whole.from_value, whole.to_value) == (1, 9)


# --- given at the start


def test_values_given_at_the_start_are_taken(_domain: None) -> None:
    made = _started(("estimator.jump_min:=2", "counted.number:=4", "speed:=2", "animal:=cow"))
    assert made.records["estimator"].jump_min == 2.0  # a whole number where a fraction is meant
    assert isinstance(made.records["estimator"].jump_min, float)
    assert made.records["counted"].number == 4
    assert made.get("speed") == 2.0
    assert made.get("animal") == "cow"
    assert made.get("topics") == []


@pytest.mark.parametrize(
    ("argument", "named"),
    [
        ("estimator.jump_min:=-1.0", "estimator.jump_min: -1.0 is out of bounds"),
        ("estimator.jump_min:=far", "estimator.jump_min: 'far' is no double"),
        ("counted.number:=2.5", "counted.number: 2.5 is no integer"),
        ("counted.on:=1", "counted.on"),
        ("speed:=11", "speed"),
    ],
)
def test_bad_values_at_the_start_are_refused(_domain: None, argument: str, named: str) -> None:
    with pytest.raises(InputError) as refused:
        _started((argument,))
    assert named in str(refused.value)
    assert "accepted" in str(refused.value)


def test_a_misspelt_name_is_told_with_the_one_that_is_meant(_domain: None) -> None:
    made = _started(("estimator.jmp_min:=2.0", "animals:=cow", "nothing.like_it:=1.0"))
    assert made.unknown() == [
        "unknown parameter 'estimator.jmp_min'; did you mean 'estimator.jump_min'?",
        "unknown parameter 'animals'; did you mean 'animal'?",
    ]

"""As much of `launch` and `launch_ros` as our launch files use, to see what they would start.

Both exist in a standard ROS 2 install only. These stand-ins take the same arguments by the same
names, and resolve them as the real ones do.
"""

from __future__ import annotations

import runpy
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

SRC = Path(__file__).parents[4] / "tombo_ws" / "src"
LAUNCH = SRC / "tombo_bringup" / "launch"


@dataclass
class Configuration:
    name: str


@dataclass
class Share:
    package: str


@dataclass(kw_only=True)
class Executable:
    executable: str
    package: str


@dataclass
class NotEquals:
    left: Any
    right: Any


@dataclass
class If:
    predicate: Any


class Unless(If):
    pass


@dataclass
class Value:
    value: Any
    value_type: type


@dataclass
class Argument:
    name: str
    description: str = field(kw_only=True)
    default_value: Any = field(default=None, kw_only=True)


@dataclass
class Source:
    location: Any


@dataclass
class Include:
    source: Source
    launch_arguments: Any = field(kw_only=True)
    condition: If | None = field(kw_only=True)


@dataclass
class Process:
    cmd: list[Any]
    output: str = "log"
    condition: If | None = None


@dataclass(kw_only=True)
class Node:
    executable: Any
    package: Any = None
    name: Any = None
    namespace: Any = None
    parameters: list[Any] = field(default_factory=list)
    remappings: list[Any] = field(default_factory=list)
    ros_arguments: list[Any] = field(default_factory=list)
    arguments: list[Any] = field(default_factory=list)
    output: str = "log"
    condition: If | None = None


@dataclass
class Description:
    entities: list[Any]


MODULES: dict[str, dict[str, Any]] = {
    "launch": {"LaunchDescription": Description},
    "launch.actions": {
        "DeclareLaunchArgument": Argument,
        "ExecuteProcess": Process,
        "IncludeLaunchDescription": Include,
    },
    "launch.conditions": {"IfCondition": If, "UnlessCondition": Unless},
    "launch.launch_description_sources": {"PythonLaunchDescriptionSource": Source},
    "launch.substitutions": {
        "LaunchConfiguration": Configuration,
        "NotEqualsSubstitution": NotEquals,
    },
    "launch_ros": {},
    "launch_ros.actions": {"Node": Node},
    "launch_ros.parameter_descriptions": {"ParameterValue": Value},
    "launch_ros.substitutions": {"ExecutableInPackage": Executable, "FindPackageShare": Share},
}


@dataclass
class Started:
    """A process that would run: of a node of the suite its name is `<namespace>/<name>`."""

    package: str
    executable: str
    name: str
    files: list[Path]
    parameters: dict[str, Any]
    command: list[str]


def install(monkeypatch: Any) -> None:
    """Put the stand-ins where `import launch` finds them, for one test."""
    for name, content in MODULES.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)


def describe(file: str) -> list[Any]:
    """Return the entities of a launch file."""
    made = runpy.run_path(str(LAUNCH / file))["generate_launch_description"]()
    assert isinstance(made, Description)
    return made.entities


def arguments_of(file: str) -> dict[str, Argument]:
    return {e.name: e for e in describe(file) if isinstance(e, Argument)}


def launch(file: str, **given: str) -> list[Started]:
    """Return what `ros2 launch tombo_bringup FILE name:=value ...` would start."""
    context = dict(given)
    started: list[Started] = []
    for entity in describe(file):
        if isinstance(entity, Argument):
            if entity.name not in context:
                assert entity.default_value is not None, f"{file}: {entity.name} must be given"
                context[entity.name] = text(entity.default_value, context)
        elif entity.condition is not None and not holds(entity.condition, context):
            continue
        elif isinstance(entity, Include):
            path = Path(text(entity.source.location, context))
            assert path.parent == LAUNCH and path.is_file(), path
            handed = {name: text(value, context) for name, value in entity.launch_arguments}
            unknown = handed.keys() - arguments_of(path.name).keys()
            assert not unknown, f"{path.name} has no argument {unknown}"
            started += launch(path.name, **handed)
        elif isinstance(entity, Node):
            started.append(as_started(entity, context))
        else:
            command = [text(word, context) for word in entity.cmd]
            started.append(Started("", "", "", [], {}, command))
    return started


def text(value: Any, context: dict[str, str]) -> str:
    if isinstance(value, Configuration):
        return context[value.name]
    if isinstance(value, Share):
        return str(SRC / value.package)
    if isinstance(value, Executable):
        return f"lib/{value.package}/{value.executable}"
    if isinstance(value, list | tuple):
        return "".join(text(part, context) for part in value)
    if isinstance(value, NotEquals):
        return str(text(value.left, context) != text(value.right, context)).lower()
    assert isinstance(value, str), value
    return value


def holds(condition: If, context: dict[str, str]) -> bool:
    words = {"true": True, "1": True, "false": False, "0": False}
    holds = words[text(condition.predicate, context).lower()]
    return holds != isinstance(condition, Unless)


def as_started(node: Node, context: dict[str, str]) -> Started:
    files: list[Path] = []
    parameters: dict[str, Any] = {}
    for source in node.parameters:
        if isinstance(source, dict):
            parameters |= {name: plain(value, context) for name, value in source.items()}
        else:
            files.append(Path(text(source, context)))
    namespace = text(node.namespace or "", context)
    name = text(node.name or "", context)
    return Started(
        text(node.package, context),
        text(node.executable, context),
        f"{namespace}/{name}",
        files,
        parameters,
        [text(word, context) for word in [*node.arguments, *node.ros_arguments]],
    )


def plain(value: Any, context: dict[str, str]) -> Any:
    if not isinstance(value, Value):
        return text(value, context)
    found = text(value.value, context)
    if value.value_type is bool:
        return {"true": True, "false": False}[found.lower()]
    return value.value_type(found)

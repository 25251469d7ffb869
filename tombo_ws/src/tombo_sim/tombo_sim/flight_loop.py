"""The compiled flight: plant, sensors and all cores, tick by tick, written out from the wiring.

The same functions that the cores' shells call. `tombo_flight.run_wiring` flies the same flight in
plain Python, nodes in lockstep do over DDS; a test holds the three to the last bit.

In each tick the simulator senses, every core takes what was published in the tick before, in the
order of its `inputs`, and is stepped if its period is due or a message has come; the rotor command
acts in the tick. What is to be done in Python is left to it: the tick is then complete but for the
steps of these cores.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.core import Compiled, Core, Output, as_row, field_of
from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import load_generated
from tombo_dynamics.records import Record, field
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_sim.kernel import FlightProgress, Flights, Shared, new_log
from tombo_sim.sensing import Captures, MocapEntry
from tombo_sim.wiring import COMMAND, CORES, IMU, PHASE, POSE, SENSORS

_SPARE = 64
"""Rows that a table has besides."""
_SIMULATOR = "simulator"


def _reads_table(core: type[Core], topic: str) -> bool:
    """Return whether a core takes a topic from its table; the IMU's sample is at hand."""
    at_hand = core.compiled is not None and core.steps_on_messages
    return topic != IMU or not (at_hand and core.compiled and IMU in core.compiled.takes)


def _tables(cores: Sequence[type[Core]]) -> dict[str, Output]:
    """Return the topics of which a flight keeps the messages."""
    needed = {t for core in cores for t in core.inputs if _reads_table(core, t)}
    outputs = {t: output for core in cores for t, output in core.outputs.items()}
    return {
        topic: output
        for topic, output in {**SENSORS, **outputs}.items()
        if topic in needed or not (output.logged or topic in SENSORS)
    }


def _readers(cores: Sequence[type[Core]], tables: Mapping[str, Output]) -> list[tuple[str, str]]:
    """Return who takes from which table: name of the core, topic."""
    simulator = [(_SIMULATOR, PHASE)] if PHASE in tables else []
    return simulator + [
        (core.name, topic)
        for core in cores
        for topic in core.inputs
        if topic in tables and _reads_table(core, topic)
    ]


TABLES = _tables(CORES)
"""Topics in the order of `Flights.published`."""
READERS = _readers(CORES, TABLES)
"""Core and topic in the order of `Flights.read`."""
_INDEX = {topic: i for i, topic in enumerate(TABLES)}


def place_of(core: type[Core], topic: str) -> tuple[int, int]:
    """Return where a core reads a topic: indices of `READERS` and of `TABLES`."""
    return READERS.index((core.name, topic)), _INDEX[topic]


def _entry(output: Output) -> type[Record]:
    fields = {"tick": field("tick", "", kind=int), "message": field("", "", kind=output.layout)}
    return type("Entry", (Record,), fields)


_ENTRIES = [_entry(output) for output in TABLES.values()]


# --- The source --------------------------------------------------------------------------------


class _Source:
    """The text of the loop."""

    def __init__(self, cores: Sequence[type[Core]]) -> None:
        self.cores = cores
        self.imports: dict[str, str] = {}
        self.publishers: list[str] = []

    def imported(self, function: Callable[..., Any], name: str) -> str:
        """Import a compiled function under a name."""
        plain = getattr(function, "py_func", function)
        self.imports[name] = f"from {plain.__module__} import {plain.__name__} as {name}"
        return name

    @staticmethod
    def memory(core: type[Core]) -> str:
        """Return the name of a core's first memory."""
        assert core.compiled is not None
        return _name(core, core.compiled.memories[0])

    @staticmethod
    def views(c: int, core: type[Core]) -> dict[str, str]:
        """Return memories and parameters of a core: name → where it is."""
        compiled = core.compiled
        if compiled is None:
            return {}
        memories = {
            _name(core, path): f"flights.memories[{c}][{k}][i]"
            for k, path in enumerate(compiled.memories)
        }
        return memories | {
            _name(core, path): f"shared.params[{c}][{k}][0]"
            for k, path in enumerate(compiled.params)
        }

    def call(self, core: type[Core], function: Callable[..., Any], what: str, *more: str) -> str:
        """Return a call of one of a core's functions."""
        assert core.compiled is not None
        name = self.imported(function, f"{core.name}_{what}")
        names = [_name(core, path) for path in (*core.compiled.memories, *core.compiled.params)]
        return f"{name}({', '.join([*names, *more, 'now'])})"

    def publish(self, core: type[Core]) -> list[str]:
        """Return lines that publish what is due."""
        lines = []
        for topic, output in core.outputs.items():
            if topic in TABLES:
                name = f"publish_{_INDEX[topic]}"
                memory = self.memory(core)
                lines.append(f"if {memory}.{output.due}:")
                lines.append(f"    {name}({memory}, table_{_INDEX[topic]}, counts, tick)")
                lines.append("    published = True")
                if f'def {name}(memory, table, counts, tick) -> "None":' not in self.publishers:
                    message = output.message
                    if not isinstance(message, str):
                        message = self.imported(message, f"fill_{_INDEX[topic]}")
                        write = f"{message}(memory, entry.message)"
                    else:
                        write = f"entry.message = memory.{message}"
                    self.publishers += _publisher(name, topic, output.due, write)
        return lines

    def take(self, core: type[Core], topic: str, then: list[str]) -> list[str]:
        """Return lines that hand a core all there is of a topic."""
        assert core.compiled is not None
        what = f"take_{list(core.inputs).index(topic)}"
        function = core.compiled.takes[topic]
        if topic not in TABLES or (core.name, topic) not in READERS:
            return [self.call(core, function, what, "imu"), *then]
        row = f"read[{READERS.index((core.name, topic))}]"
        call = self.call(core, function, what, f"table_{_INDEX[topic]}[{row}].message")
        unread = f"{'news and ' if core.steps_on_messages else ''}{_unread(core.name, topic)}"
        return [f"while {unread}:", *_indented([call, f"{row} += 1", *then])]

    def turn(self, c: int, core: type[Core]) -> list[str]:
        """Return a core's turn in a tick."""
        compiled = core.compiled
        period = f"now % {core.period_ns} == 0"
        inputs = [t for t in core.inputs if t in SENSORS or t in TABLES]
        in_python = [t for t in inputs if compiled is None or t not in compiled.takes]
        unread = " or ".join(_unread(core.name, topic) for topic in in_python)
        if compiled is None:
            messages = core.steps_on_messages and in_python
            return [
                f"if {period} or {unread}:" if messages else f"if {period}:",
                f"    flight.to_step |= {1 << c}",
            ]
        takes = [t for t in inputs if t in compiled.takes]
        if [*takes, *in_python] != inputs:
            raise TypeError(f"{core.__name__}: topics without a function are the last of inputs")
        if compiled.step is None:
            published = self.publish(core)
            lines = [line for topic in takes for line in self.take(core, topic, published)]
            return lines + self._to_python(c, unread, [])
        step = [self.call(core, compiled.step, "step"), *self.publish(core)]
        if compiled.asks is not None:
            asks = self.call(core, compiled.asks, "asks")
            step = [f"if {asks}:", f"    flight.to_step |= {1 << c}", "else:", *_indented(step)]
        step = self._to_python(c, unread, step)
        if not core.steps_on_messages:
            hand = [line for topic in takes for line in self.take(core, topic, [])]
            return [f"if {period}:", *_indented([*hand, *step])]
        has_messages = f"{core.name}_has_messages"
        hand = [
            line for topic in takes for line in self.take(core, topic, [f"{has_messages} = True"])
        ]
        due = " or ".join([has_messages, period, *([unread] if unread else [])])
        return [f"{has_messages} = False", *hand, f"if {due}:", *_indented(step)]

    @staticmethod
    def _to_python(c: int, unread: str, otherwise: list[str]) -> list[str]:
        if not unread:
            return otherwise
        lines = [
            f"if {unread}:",
            f"    flight.to_step |= {1 << c}",
            f"    flight.to_hand |= {1 << c}",
        ]
        return lines + (["else:", *_indented(otherwise)] if otherwise else [])

    def text(self) -> str:
        """Return the whole module."""
        views = dict(_VIEWS)
        for c, core in enumerate(self.cores):
            views |= self.views(c, core)
        views |= {f"table_{k}": f"flights.published[{k}][i]" for k in range(len(TABLES))}
        names = ", ".join(views)
        turns = [
            line
            for c, core in enumerate(self.cores)
            for line in (f"# {core.name}", *self.turn(c, core))
        ]
        by_name = {core.name: core for core in self.cores}
        commands = next(core for core in self.cores if COMMAND in core.outputs)
        if commands.compiled is None:
            raise TypeError(
                f"{commands.__name__}: publishes {COMMAND}, which acts in its tick; accepted: a "
                "compiled core"
            )
        command = f"{self.memory(commands)}.{commands.outputs[COMMAND].message}.speed"
        estimator, controller = by_name["estimator"], by_name["controller"]
        row = ", ".join([
            self.memory(estimator), self.memory(controller), _name(controller, "autopilot"),
        ])  # fmt: skip
        loop = [
            "tick = flight.tick",
            "now = EPOCH_NS + tick * TICK_NS",
            "noise = tick_noise[tick - base]",
            "read_imu(plant, maps, noise, theta)",
            "imu = ImuReading(now, plant.gyro, plant.accel)",
            *_published_sample(),
            "if tick == capture_ticks[captures.next]:",
            "    capture_pose(plant, mocap_noise, theta, entries, captures, tick)",
            "arrived = next_arrival(entries, captures, tick)",
            "while arrived >= 0:",
            "    news = True",
            *_indented(_published_pose()),
            "    arrived = next_arrival(entries, captures, tick)",
            *_phase(),
            "watch_flight(plant, flight)",
            *turns,
            f"plant.rotor_command = {command}",
            "if 0 <= tick < log.position.shape[0]:",  # 0: no index is counted from the end
            f"    write_row(plant, {row}, log, tick)",
            "finish_tick(plant, noise, theta)",
            "news = published",
            "published = False",
            "flight.tick = tick + 1",
            "if flight.to_step != 0:",
            "    return True",
        ]
        steps = [line for c, core in enumerate(self.cores) for line in self.step(c, core)]
        head = ['"""Generated from the wiring. Do not edit."""', *_stamps(self.cores), ""]
        return "\n".join([
            *head, *_IMPORTS, *self.imports.values(), *self.publishers,
            "", "", "@compiled(inline=False, counted=False)",
            f'def fly_ticks({names}, stop) -> "bool":',
            *_indented([*_BEGIN, "while flight.tick < min(stop, flight.end):"]),
            *_indented(_indented(loop)), "    return False",
            "", "", "@compiled(counted=False)", 'def fly(flights, shared, i, stop) -> "bool":',
            *_indented([*_assigned(views), f"return fly_ticks({names}, stop)"]),
            *steps, *_forget(), "",
        ])  # fmt: skip

    def step(self, c: int, core: type[Core]) -> list[str]:
        """Return the function that makes a step that was left to Python."""
        compiled = core.compiled
        if compiled is None or compiled.step is None:
            return []
        tables = [
            f"table_{_INDEX[t]} = flights.published[{_INDEX[t]}][i]"
            for t in core.outputs
            if t in TABLES
        ]
        body = [
            "counts = flights.counts[i]",
            "tick = flights.progress[i].tick - 1",
            "now = EPOCH_NS + tick * TICK_NS",
            *_assigned(self.views(c, core)),
            *tables,
            self.call(core, compiled.step, "step"),
            *self.publish(core),
        ]
        return _function(f"step_{core.name}(flights, shared, i)", body)


def _name(core: type[Core], path: str) -> str:
    return f"{core.name}_{path.replace('.', '_')}"


def _assigned(values: Mapping[str, str]) -> list[str]:
    return [f"{name} = {value}" for name, value in values.items()]


def _indented(lines: Sequence[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _function(head: str, body: Sequence[str]) -> list[str]:
    head = f'def {head} -> "None":'
    return ["", "", "@compiled(inline=False, counted=False)", head, *_indented(body)]


def _unread(name: str, topic: str) -> str:
    """Return the condition that there is a message to take: of a sensor that of this tick, too."""
    row, k = f"read[{READERS.index((name, topic))}]", _INDEX[topic]
    when = "<=" if topic in SENSORS else "<"
    return f"({row} < counts[{k}] and table_{k}[{row}].tick {when} tick)"


def _publisher(name: str, topic: str, due: str, write: str) -> list[str]:
    k = _INDEX[topic]
    return _function(f"{name}(memory, table, counts, tick)", [
        f"row = counts[{k}]",
        "if row < table.shape[0]:",
        "    entry = table[row]",
        "    entry.tick = tick",
        f"    {write}",
        f"    counts[{k}] = row + 1",
        f"memory.{due} = False",
    ])  # fmt: skip


def _published_sample() -> list[str]:
    k = _INDEX.get(IMU)
    return [] if k is None else [f"publish_sample(imu, table_{k}, counts, {k}, tick)"]


def _published_pose() -> list[str]:
    k = _INDEX.get(POSE)
    if k is None:
        return []
    return [f"publish_pose(entries[arrived], table_{k}, counts, {k}, tick)"]


def _phase() -> list[str]:
    if PHASE not in TABLES:
        return []
    row, k = f"read[{READERS.index((_SIMULATOR, PHASE))}]", _INDEX[PHASE]
    return [
        f"while news and {_unread(_SIMULATOR, PHASE)}:",
        f"    flight.phase = table_{k}[{row}].message.phase",
        f"    {row} += 1",
    ]


def _forget() -> list[str]:
    """Return the function that drops the messages that all have taken."""
    body = ["counts, read = flights.counts[i], flights.read[i]"]
    for topic, k in _INDEX.items():
        rows = [f"read[{r}]" for r, (_, read_topic) in enumerate(READERS) if read_topic == topic]
        first = f"min({', '.join([f'counts[{k}]', *rows])})" if rows else f"counts[{k}]"
        body += [f"gone = {first}", f"drop_rows(flights.published[{k}][i], counts, {k}, gone)"]
        body += [f"{row} -= gone" for row in rows]
    return _function("forget_messages(flights, i)", body)


def _stamps(cores: Sequence[type[Core]]) -> Iterator[str]:
    """Return a line for each file of a core: its machine code is of this content."""
    for module in dict.fromkeys(core.__module__ for core in cores):
        path = getattr(sys.modules[module], "__file__", None)
        if path is not None:
            digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]
            yield f"# {module} {digest}"


_IMPORTS = [
    "from tombo_dynamics.jit import compiled",
    "from tombo_dynamics.rigid_body import finish_tick",
    "from tombo_dynamics.time_base import EPOCH_NS, TICK_NS",
    "from tombo_sim.kernel import ImuReading, drop_rows, publish_pose, publish_sample",
    "from tombo_sim.kernel import watch_flight, write_row",
    "from tombo_sim.sensing import capture_pose, next_arrival, read_imu",
]
_VIEWS = {
    "plant": "flights.plant[i]",
    "maps": "shared.maps[0]",
    "theta": "flights.theta[i]",
    "tick_noise": "flights.noise[i]",
    "base": "flights.base[i]",
    "capture_ticks": "flights.capture_ticks[i]",
    "mocap_noise": "flights.mocap_noise[i]",
    "entries": "flights.entries[i]",
    "captures": "flights.captures[i]",
    "counts": "flights.counts[i]",
    "read": "flights.read[i]",
    "flight": "flights.progress[i]",
    "log": "shared.log",
}
_BEGIN = [
    "flight.to_step = 0",
    "flight.to_hand = 0",
    "published = False",
    "news = True  # what Python has published, too",
]


def _load() -> Any:
    text = _Source(CORES).text()
    name = f"tombo_flight_loop_{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    return load_generated(name, text)


_generated = _load()
fly = _generated.fly
"""Fly `flights` i until tick `stop`, its end, or steps to make in Python: then True."""
forget_messages = _generated.forget_messages
"""Drop the messages of flight i that all have taken."""
step_reaction = _generated.step_reaction
"""Step the reaction of flight i, which was left to Python in the last tick."""


# --- Flights in Python -------------------------------------------------------------------------


def new_published(count: int, ticks: int) -> tuple[Any, ...]:
    """Return empty tables for N flights of so many ticks."""
    return tuple(
        np.zeros((count, ticks // output.every + _SPARE), entry.layout)
        for output, entry in zip(TABLES.values(), _ENTRIES, strict=True)
    )


def _compiled(core: Core) -> Compiled:
    return core.compiled or Compiled((), (), {})


def memories_of(cores: Sequence[Core]) -> tuple[tuple[Any, ...], ...]:
    """Return the memories of each core, as arrays (1)."""
    return tuple(
        tuple(field_of(core, path).as_array() for path in _compiled(core).memories)
        for core in cores
    )


def params_of(cores: Sequence[Core]) -> tuple[tuple[Any, ...], ...]:
    """Return the parameters of each core, as arrays (1, ...)."""
    return tuple(
        tuple(as_row(field_of(core, path)) for path in _compiled(core).params) for core in cores
    )


def one_flight(
    plant: Record,
    theta: Array,
    captures: tuple[Any, Array],
    cores: Sequence[Core],
    published: tuple[Any, ...],
) -> Flights:
    """Return a flight at tick 0, without normals of the plant.

    Args:
        plant: the vehicle, as of `flight_setup.begin`.
        theta: (P) parameters of the effects.
        captures: (M) ticks of capture and (M, 9) standard normals.
        cores: those of the wiring.
        published: of `new_published`, for one flight.
    """
    ticks, normals = captures
    return Flights(
        plant.as_array(),
        theta[None],
        np.zeros((1, 0, normals.shape[1])),
        np.zeros(1, np.int64),
        ticks[None],
        normals[None],
        np.zeros((1, ticks.size), MocapEntry.layout),
        np.zeros(1, Captures.layout),
        memories_of(cores),
        published,
        np.zeros((1, len(TABLES)), np.int64),
        np.zeros((1, len(READERS)), np.int64),
        np.zeros(1, FlightProgress.layout),
    )


def new_flights(
    count: int, plant: Any, theta: Array, cores: Sequence[Core], captures: int, block: int
) -> Flights:
    """Return room for N flights of so many poses, with normals for `block` ticks."""
    template = one_flight(
        plant, theta, (np.zeros(captures, np.int64), np.zeros((captures, 9))), cores, ()
    )
    noise = np.zeros((1, block, template.noise.shape[2]))
    repeated = _repeated(template._replace(noise=noise), count)
    flights: Flights = repeated._replace(published=new_published(count, block))
    return flights


def _repeated(arrays: Any, count: int) -> Any:
    """Return zeros as arrays (1, ...), for each of N."""
    if isinstance(arrays, tuple):
        parts = [_repeated(part, count) for part in arrays]
        return type(arrays)(*parts) if hasattr(arrays, "_fields") else tuple(parts)
    return np.zeros((count, *arrays.shape[1:]), arrays.dtype)


def shared_by(maps: Record, cores: Sequence[Core], log: Any = None) -> Shared:
    """Return what flights share; without a log nothing is written down."""
    return Shared(maps.as_array(), params_of(cores), new_log(0) if log is None else log)


def hand_over(flights: Flights, i: int, core: Core) -> None:
    """Hand a core what is there for it in Python, in the last tick of flight i."""
    tick = int(flights.progress["tick"][i]) - 1
    for topic in core.inputs:
        if (core.name, topic) not in READERS or topic in _compiled(core).takes:
            continue
        r, k = place_of(type(core), topic)
        table, last = flights.published[k][i], tick if topic in SENSORS else tick - 1
        while flights.read[i, r] < flights.counts[i, k]:
            entry = table[flights.read[i, r]]
            if entry["tick"] > last:
                break
            flights.read[i, r] += 1
            core.on(topic, TABLES[topic].message_of(entry["message"]), EPOCH_NS + tick * TICK_NS)


def step_in_python(flights: Flights, i: int, cores: Sequence[Core]) -> Iterator[Core]:
    """Step the cores of flight i that are to be, in its last tick; yield each, then publish."""
    steps, tick = int(flights.progress["to_step"][i]), int(flights.progress["tick"][i]) - 1
    for c, core in enumerate(cores):
        if steps >> c & 1:
            hand_over(flights, i, core)
            published = core.step(EPOCH_NS + tick * TICK_NS)
            yield core
            for topic, message in published:
                _publish(flights, i, topic, message, tick)


def _publish(flights: Flights, i: int, topic: str, message: Any, tick: int) -> None:
    if topic not in TABLES:
        return
    k = _INDEX[topic]
    row, table = int(flights.counts[i, k]), flights.published[k][i]
    if row >= table.size:
        raise InputError(
            f"{topic}: more than {row} messages; accepted: one in {TABLES[topic].every} ticks"
        )
    entry = table[row]
    entry["tick"] = tick
    for name in TABLES[topic].layout.fields:
        if hasattr(message, name):
            entry["message"][name] = getattr(message, name)
    flights.counts[i, k] = row + 1


def published_by(flights: Flights, i: int) -> dict[str, Any]:
    """Return what the cores have published in flight i: topic → rows of tick and message.

    What the log has is left out.

    Raises:
        InputError: a table was full.
    """
    published = {}
    for k, (topic, output) in enumerate(TABLES.items()):
        table, rows = flights.published[k][i], int(flights.counts[i, k])
        if rows >= table.size:
            raise InputError(
                f"{topic}: more than {rows} messages; accepted: one in {output.every} ticks"
            )
        if topic not in SENSORS and not output.logged:
            published[topic] = table[:rows]
    return published

"""Mapping files of stands: which columns hold which channel, in which units.

YAML; `docs/stand.md` explains it by example. Without one, shipped mappings are recognised by
their header and plain names of columns are understood.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.yaml_text import parse_yaml
from tombo_logs.readers.mapping_file import (
    ChannelMap,
    columns_of,
    number_of,
    read_mapping,
    shipped_mappings,
    table_of,
    unit_of,
)
from tombo_logs.readers.units import SPELLINGS, UNITS, factor

CHANNELS: Mapping[str, str] = {
    "time": "s",
    "speed": "rad/s",
    "reference_speed": "rad/s",
    "thrust": "N",
    "torque": "N m",
    "beta": "rad",
    "applied_thrust": "N",
    "applied_torque": "N m",
    "thrust_sigma": "N",
    "torque_sigma": "N m",
    "command": "1",
    "voltage": "V",
    "current": "A",
    "power": "W",
    "conf": "1",
    "run": "1",
    "propeller": "1",
}
"""Channel -> its unit here."""
MULTI_COLUMN_CHANNELS = ("speed", "reference_speed")
"""Channels that may have several columns, one a rotor."""
_NAMES = {
    "speed": ("rpm", "speed", "omega", "motor_speed", "motor_optical_speed", "rotor_speed"),
    "reference_speed": ("reference_speed", "second_speed", "reference_rpm"),
    "thrust": ("thrust", "weight", "force", "lift"),
    "torque": ("torque", "moment"),
    "beta": ("beta", "flap", "flap_angle", "deformation", "deformation_angle"),
    "applied_thrust": ("applied_thrust", "known_thrust", "check_weight"),
    "applied_torque": ("applied_torque", "known_torque"),
    "thrust_sigma": ("thrust_sigma", "thrust_dev", "thrust_std"),
    "torque_sigma": ("torque_sigma", "torque_dev", "torque_std"),
    "command": ("pwm", "command", "esc", "throttle"),
    "voltage": ("voltage", "v", "vbat"),
    "current": ("current", "i"),
    "power": ("power", "p", "electrical_power"),
    "time": ("time", "t", "stamp", "timestamp"),
    "conf": ("conf", "configuration"),
    "run": ("run", "repeat"),
    "propeller": ("propeller", "specimen"),
}
_HEADING = re.compile(r"^\s*(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*$")
_OTHERS = ("rpm", "rad_s", "Hz", "deg", "rad", "V", "A", "W", "mW", "s", "ms")
_UNITS_IN_NAMES = (*UNITS["N"], *(u.replace(" ", "") for u in UNITS["N m"]), *_OTHERS)
_SUFFIX = re.compile(rf"^(.*?)_({'|'.join(map(re.escape, _UNITS_IN_NAMES))})$")


@dataclass(frozen=True)
class StandMapping:
    """A mapping file, checked."""

    name: str
    about: str = ""
    header: tuple[str, ...] = ()
    """All columns of the files that it is for, to recognise them by; empty: any."""
    model: str = "tombo"
    """tombo, or plain: thrust as the square of speed, of any other propeller."""
    rotors: int = 1
    """Rotors that pull on the cell together."""
    diameter_mm: float = 0.0
    """Of a plain propeller; 0: not known."""
    tare: str = "start"
    """start: readings at standstill before the run are zero; none: already so."""
    channels: Mapping[str, ChannelMap] = field(default_factory=dict)


def shipped() -> dict[str, StandMapping]:
    """Return the mappings that come with the package, by name."""
    return shipped_mappings("tombo_diagnosis", "stand/mappings", parse_mapping)


def load_mapping(name: str) -> StandMapping:
    """Read a mapping: the name of a shipped one, or a YAML file.

    Raises:
        InputError: no such mapping, or one that can't be used.
    """
    return read_mapping(name, shipped(), parse_mapping)


def parse_mapping(text: str, name: str) -> StandMapping:
    """Check the text of a mapping file.

    Raises:
        InputError: not a mapping; says which key is wrong and what is accepted.
    """
    what = f"mapping '{name}'"
    values = table_of(parse_yaml(text, what), what, [f.name for f in fields(StandMapping)])
    model, tare = str(values.get("model", "tombo")), str(values.get("tare", "start"))
    choices = {"model": (model, ("tombo", "plain")), "tare": (tare, ("start", "none"))}
    for key, (given, accepted) in choices.items():
        if given not in accepted:
            raise unknown_name(f"{what}: {key}", given, accepted)
    channels = table_of(values.get("channels"), f"{what}: channels", CHANNELS)
    header = values.get("header") or ()
    if isinstance(header, str) or not isinstance(header, Sequence):
        raise InputError(f"{what}: header {shown(header)}; accepted: a list of columns")
    return StandMapping(
        name=str(values.get("name", Path(name).stem)),
        about=str(values.get("about", "")),
        header=tuple(map(str, header)),
        model=model,
        rotors=int(number_of(values.get("rotors", 1), 1, 64, f"{what}: rotors")),
        diameter_mm=number_of(values.get("diameter_mm", 0.0), 0.0, 1e4, f"{what}: diameter_mm"),
        tare=tare,
        channels={key: _channel(key, value, what) for key, value in channels.items()},
    )


def _channel(key: str, content: object, what: str) -> ChannelMap:
    """Read a channel: `sign` and `poles`, 2 where the column has turns, make its scale."""
    what = f"{what}: {key}"
    values = table_of(content, what, ("columns", "unit", "sign", "poles"))
    many = key in MULTI_COLUMN_CHANNELS
    names = "names of columns, one a rotor" if many else "one name of a column"
    columns = columns_of(values.get("columns", ()), what, None if many else 1, names)
    unit = unit_of(values, CHANNELS[key], what)
    sign = number_of(values.get("sign", 1.0), -1.0, 1.0, f"{what}: sign")
    if abs(sign) != 1.0:
        raise InputError(f"{what}: sign {sign:g}; accepted: 1 or -1")
    poles = int(number_of(values.get("poles", 2), 2, 200, f"{what}: poles"))
    if poles % 2:
        raise InputError(f"{what}: poles {poles}; accepted: an even number of magnets")
    return ChannelMap(columns, unit, scale=sign * 2.0 / poles)


def mapping_for_header(columns: Sequence[str]) -> StandMapping | None:
    """Return a shipped mapping whose header a table has, or None."""
    return next(
        (m for m in shipped().values() if m.header and set(m.header) <= set(columns)), None
    )


def infer_mapping(columns: Sequence[str], path: Path) -> StandMapping:
    """Return a mapping from plain names of columns: thrust_N, rpm, torque [mN m], beta_deg ...

    Raises:
        InputError: no speed, or neither thrust nor torque; or a unit that is not known.
    """
    found: dict[str, ChannelMap] = {}
    for column in columns:
        name, unit = _split(column)
        channel = next((c for c, names in _NAMES.items() if name in names), None)
        if channel is None or channel in found:
            continue
        if not unit:
            unit = "rpm" if name.endswith("rpm") else CHANNELS[channel]
            if channel in ("thrust", "torque", "beta") or (channel == "speed" and name != "rpm"):
                raise InputError(
                    f"'{path}': column '{column}' has no unit; accepted: a unit in its name, as "
                    f"{name}[{CHANNELS[channel]}] ({_units(channel)}), or --mapping"
                )
        factor(unit, CHANNELS[channel], f"column '{column}' of '{path}'")
        found[channel] = ChannelMap((column,), unit)
    if "speed" not in found or not {"thrust", "torque"} & set(found):
        lacking = "speed" if "speed" not in found else "thrust or torque"
        raise InputError(
            f"'{path}': no column for {lacking} among {', '.join(columns)[:200]}; accepted: names "
            f"as rpm, thrust_N, torque_Nm, beta_deg (thrust in {', '.join(UNITS['N'])}; torque in "
            f"{', '.join(u.replace(' ', '') for u in UNITS['N m'])}), or --mapping"
        )
    return StandMapping("names of the columns", channels=found)


def _units(channel: str) -> str:
    wanted = CHANNELS[channel]
    return "rpm, rad/s, Hz" if wanted == "rad/s" else ", ".join(UNITS[wanted])


def _split(column: str) -> tuple[str, str]:
    """Return the name and the unit of a heading."""
    match = _HEADING.match(column)
    name, unit = (match.group(1), match.group(2) or "") if match else (column, "")
    if not unit:
        suffix = _SUFFIX.match(name)
        if suffix and name.lower() not in {n for names in _NAMES.values() for n in names}:
            name, unit = suffix.group(1), suffix.group(2)
    name = re.sub(r"[^\w]+", "_", name.strip().lower()).strip("_")
    if unit.lower() == "rpm" and name == "":
        name = "rpm"
    return name, SPELLINGS.get(unit, unit)

"""From a table of a thrust stand to a checked run in SI units.

A mapping file (YAML; `docs/stand.md` explains it by example) says which columns hold which
channel, in which units. Without one, shipped mappings are recognised by their header and plain
names of columns are understood.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from tombo_bag.flight import Finding
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number
from tombo_dynamics.propeller import RPM, SPEED_LIMIT
from tombo_dynamics.yaml_text import parse_yaml
from tombo_logs.readers.csv_mapping import (
    ChannelMap,
    columns_of,
    read_mapping,
    shipped_mappings,
    table_of,
    unit_of,
)
from tombo_logs.readers.csv_table import open_table
from tombo_logs.readers.units import SPELLINGS, UNITS, factor

_COLUMNS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "time": ("s", ("time", "t", "stamp", "timestamp")),
    "speed": ("rad/s", (
        "rpm", "speed", "omega", "motor_speed", "motor_optical_speed", "motor_electrical_speed",
        "rotor_speed",
    )),
    "reference_speed": ("rad/s", ("reference_speed", "second_speed", "reference_rpm")),
    "thrust": ("N", ("thrust", "weight", "force", "lift")),
    "torque": ("N m", ("torque", "moment")),
    "beta": ("rad", ("beta", "flap", "flap_angle", "deformation", "deformation_angle")),
    "applied_thrust": ("N", ("applied_thrust", "known_thrust", "check_weight")),
    "applied_torque": ("N m", ("applied_torque", "known_torque")),
    "thrust_sigma": ("N", ("thrust_sigma", "thrust_dev", "thrust_std")),
    "torque_sigma": ("N m", ("torque_sigma", "torque_dev", "torque_std")),
    "command": ("1", ("pwm", "command", "esc", "esc_signal", "throttle")),
    "voltage": ("V", ("voltage", "v", "vbat")),
    "current": ("A", ("current", "i")),
    "power": ("W", ("power", "p", "electrical_power")),
    "conf": ("1", ("conf", "configuration")),
    "run": ("1", ("run", "repeat")),
    "propeller": ("1", ("propeller", "specimen")),
    "thrust_coefficient": ("1", ("ct",)),
    "power_coefficient": ("1", ("cp",)),
}  # fmt: skip
"""Channel -> its unit here, and the names of columns that need no mapping."""
CHANNELS: Mapping[str, str] = {channel: unit for channel, (unit, _) in _COLUMNS.items()}
"""Channel -> its unit here."""
MULTI_COLUMN_CHANNELS = ("speed", "reference_speed")
"""Channels that may have several columns, one a rotor."""
_CHANNEL_OF = {name: channel for channel, (_, names) in _COLUMNS.items() for name in names}
"""Name of a column -> its channel."""
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
    """Of a plain propeller whose loads are coefficients; 0: that in the file's name."""
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
        InputError: not a mapping; says which key is wrong, and the accepted values.
    """
    what = f"mapping '{name}'"
    values = table_of(parse_yaml(text, what), what, [f.name for f in fields(StandMapping)])
    model, tare = str(values.get("model", "tombo")), str(values.get("tare", "start"))
    choices = {"model": (model, ("tombo", "plain")), "tare": (tare, ("start", "none"))}
    for key, (choice, accepted) in choices.items():
        if choice not in accepted:
            raise unknown_name(f"{what}: {key}", choice, accepted)
    channels = table_of(values.get("channels"), f"{what}: channels", CHANNELS)
    header = values.get("header") or ()
    if isinstance(header, str) or not isinstance(header, Sequence):
        raise InputError(f"{what}: header {shown(header)}; accepted: a list of columns")
    return StandMapping(
        name=str(values.get("name", Path(name).stem)),
        about=str(values.get("about", "")),
        header=tuple(map(str, header)),
        model=model,
        rotors=int(check_number(f"{what}: rotors", values.get("rotors", 1), "1", (1, 64))),
        diameter_mm=check_number(
            f"{what}: diameter_mm", values.get("diameter_mm", 0.0), "mm", (0.0, 1e4)
        ),
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
    sign = check_number(f"{what}: sign", values.get("sign", 1.0), "1", (-1.0, 1.0))
    if abs(sign) != 1.0:
        raise InputError(f"{what}: sign {sign:g}; accepted: 1 or -1")
    poles = int(check_number(f"{what}: poles", values.get("poles", 2), "1", (2, 200)))
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

    The first of several columns for a channel is taken.

    Raises:
        InputError: no speed, or neither thrust nor torque; or a unit that is not known.
    """
    channels: dict[str, ChannelMap] = {}
    for column in columns:
        name, unit = _split(column)
        channel = _CHANNEL_OF.get(name)
        if channel is None or channel in channels:
            continue
        if channel == "command":
            unit = "1"  # compared with itself alone
        if not unit:
            unit = "rpm" if name.endswith("rpm") else CHANNELS[channel]
            if channel in ("thrust", "torque", "beta") or (channel == "speed" and name != "rpm"):
                raise InputError(
                    f"'{path}': column '{column}' has no unit; accepted: a unit in its name, as "
                    f"{name}[{CHANNELS[channel]}] ({_units(channel)}), or --mapping"
                )
        factor(unit, CHANNELS[channel], f"column '{column}' of '{path}'")
        channels[channel] = ChannelMap((column,), unit)
    if "speed" not in channels or not {"thrust", "torque", *_COEFFICIENTS} & set(channels):
        lacking = "speed" if "speed" not in channels else "thrust or torque"
        raise InputError(
            f"'{path}': no column for {lacking} among {', '.join(columns)[:200]}; accepted: names "
            f"as rpm, thrust_N, torque_Nm, beta_deg (thrust in {', '.join(UNITS['N'])}; torque in "
            f"{', '.join(u.replace(' ', '') for u in UNITS['N m'])}), or --mapping"
        )
    return StandMapping("names of the columns", channels=channels)


def _units(channel: str) -> str:
    wanted = CHANNELS[channel]
    return "rpm, rad/s, Hz" if wanted == "rad/s" else ", ".join(UNITS[wanted])


def _split(column: str) -> tuple[str, str]:
    """Return the name and the unit of a heading."""
    match = _HEADING.match(column)
    name, unit = (match.group(1), match.group(2) or "") if match else (column, "")
    if not unit:
        suffix = _SUFFIX.match(name)
        if suffix and name.lower() not in _CHANNEL_OF:
            name, unit = suffix.group(1), suffix.group(2)
    name = re.sub(r"[^\w]+", "_", name.strip().lower()).strip("_")
    if unit.lower() == "rpm" and name == "":
        name = "rpm"
    return name, SPELLINGS.get(unit, unit)


_COEFFICIENTS = {"thrust_coefficient": "thrust", "power_coefficient": "torque"}
"""Channel -> the load that it is the coefficient of."""
_AIR_DENSITY_KG_M3 = 1.225
"""kg/m^3, of the standard atmosphere: coefficients have the density of their day taken out."""
_SIZE = re.compile(r"(?<![\d.])(\d{1,2}(?:\.\d+)?)x\d")
"""A propeller in a file's name, as 10x4.7: diameter and pitch in inches."""
_INCH_M = 0.0254


def _loads_of_coefficients(
    channels: dict[str, Array], mapping: StandMapping, path: Path
) -> StandMapping:
    """Replace coefficients of thrust and power by loads; return the mapping that has been used.

    T = C_T rho n^2 D^4 and Q = C_P rho n^2 D^5 / (2 pi), with n in turns per second.

    Raises:
        InputError: the diameter is not known.
    """
    given = [key for key in _COEFFICIENTS if key in channels]
    named = _SIZE.search(path.name)
    d = 1e-3 * mapping.diameter_mm or (_INCH_M * float(named[1]) if named else 0.0)
    if not d:
        raise InputError(
            f"'{path}': coefficients C_T and C_P, and no diameter; accepted: diameter_mm in "
            "--mapping, or a name with diameter and pitch in inches, as apcsf_10x4.7.txt"
        )
    columns = dict(mapping.channels)
    for key in given:
        load = _COEFFICIENTS[key]
        scale = d**4 if load == "thrust" else d**5 / (2.0 * math.pi)
        n = channels["speed"] / (2.0 * math.pi)
        value = channels.pop(key) * _AIR_DENSITY_KG_M3 * n**2 * scale
        channels.setdefault(load, value)
        columns.setdefault(load, columns[key])
    return replace(mapping, channels=columns, diameter_mm=1e3 * d)


_MAX_STANDSTILL_SHARE = 0.002
"""Share of the highest speed below which the rotor stands."""
_MIN_RECORDING_ROWS = 60
"""A table with more rows than this whose speed hardly moves from row to row is a recording."""
_MAX_RECORDING_STEP_SHARE = 0.004
"""Share of the highest speed: the largest median step of a recording."""
_MIN_TURNING_LOAD_SHARE = 0.1
"""Share of the loads' range over the load at standstill with which a rotor turns."""
_MIN_LOAD_DIFFERENCE_SHARE = 0.02
"""The same of rows before the start, which stand alike."""
_MAX_SPEED_RAD_S = 1.2e4
"""Of plain propellers."""
_MIN_TOP_SPEED_RAD_S = 20.0
"""rad/s: a stand that never turns faster has its unit wrong."""
_PER_ROTOR = ("thrust", "torque", "applied_thrust", "applied_torque", "thrust_sigma")


@dataclass(frozen=True, eq=False)
class StandTable:
    """A run as recorded, in SI units, by rotor."""

    name: str
    source: str
    mapping: StandMapping
    channels: Mapping[str, Array]
    """Name -> (N,); speed is the root of the rotors' mean square, loads are by rotor."""
    findings: tuple[Finding, ...]


def read_stand(path: Path, mapping: str | None = None) -> StandTable:
    """Read a table of a thrust stand, CSV or CSV.gz.

    Without the name or file of a mapping it is recognised by the header, or by plain names.

    Raises:
        InputError: empty, no header, columns missing, or values that can't be what they are said
            to be; it names column, value and the expected form.
    """
    loaded = None if mapping is None else load_mapping(mapping)
    table = open_table(path)
    chosen = loaded or mapping_for_header(table.columns)
    if chosen is None:
        numbers, _ = table.numbers(table.number_columns())
        dead = {name for name, values in numbers.items() if not np.nan_to_num(values).any()}
        # of two sensors of a quantity the one that says something
        chosen = infer_mapping(sorted(table.columns, key=lambda name: name in dead), path)
    wanted = [c for channel in chosen.channels.values() for c in channel.columns]
    missing = [c for c in wanted if c not in table.columns]
    if missing or "speed" not in chosen.channels:
        lacking = f"column '{missing[0]}'" if missing else "channel speed in the mapping"
        raise InputError(
            f"'{path}': no {lacking}; accepted: a table with {', '.join(wanted) or 'speed'}; it "
            f"has {', '.join(table.columns)[:200]}"
        )
    numbers, damage = table.numbers(sorted(set(wanted)))
    name = path.name.split(".")[0]
    findings = [Finding("table", "warning", name, d) for d in (*table.damage, *damage)]
    findings += [Finding("table", "info", name, remark) for remark in table.remarks]
    channels: dict[str, Array] = {}
    for key, where in chosen.channels.items():
        scale = where.factor(CHANNELS[key], f"{key} of '{path}'")
        columns = np.column_stack([scale * numbers[c] for c in where.columns])
        if key in ("speed", "reference_speed"):
            if key == "speed":
                # a rotor that turns the other way may have negative speeds
                columns, glitches = _without_glitches(np.abs(columns), name, where.columns)
                findings += glitches
            channels[key] = np.sqrt(np.mean(columns**2, axis=1))
        else:
            channels[key] = columns[:, 0] / (chosen.rotors if key in _PER_ROTOR else 1)
    if set(_COEFFICIENTS) & set(channels):
        chosen = _loads_of_coefficients(channels, chosen, path)
        text = (
            f"loads are of C_T and C_P, with a diameter of {chosen.diameter_mm:.4g} mm and air of "
            f"{_AIR_DENSITY_KG_M3} kg/m3"
        )
        findings.append(Finding("coefficients", "info", name, text))
    rows = np.isfinite(channels["speed"])
    loads = [channels[c] for c in ("thrust", "torque") if c in channels]
    if not loads:
        raise InputError(f"'{path}': neither thrust nor torque; accepted: one of them at least")
    rows &= np.isfinite(np.column_stack(loads)).any(axis=1)
    if not rows.all():
        text = (
            f"{(~rows).sum()} of {rows.size} rows have no number in speed or loads "
            f"({', '.join(wanted[:6])}) and are left out"
        )
        findings.append(Finding("missing", "warning", name, text))
    if rows.sum() < 3:
        raise InputError(
            f"'{path}': {int(rows.sum())} rows with numbers in speed and a load; accepted: 3 or "
            f"more with {', '.join(wanted)}"
        )
    channels = {key: values[rows] for key, values in channels.items()}
    lost = _dropouts(channels)
    if lost.any():
        text = f"0 rpm in {lost.sum()} rows whose load says that the rotor turns; left out"
        findings.append(Finding("speed_dropout", "warning", name, text, channel="speed"))
        channels = {key: values[~lost] for key, values in channels.items()}
    source = f"{path} ({chosen.name})"
    result = StandTable(name, source, chosen, channels, tuple(findings))
    _check_plausible(result, path)
    return result


def _without_glitches(
    speed: Array, name: str, columns: tuple[str, ...]
) -> tuple[Array, list[Finding]]:
    """Put single samples in which one rotor alone is far off back to its neighbours' median."""
    findings: list[Finding] = []
    if not is_recording(np.nan_to_num(speed).max(axis=1)):  # points have no neighbours in time
        return speed, findings
    around = median_filter(speed, (7, 1), mode="nearest")
    far = np.abs(speed - around) > np.maximum(0.05 * around, 10.0)
    fast = around > 0.2 * np.nanmax(around, initial=0.0)
    if speed.shape[1] > 1:
        far &= far.sum(axis=1, keepdims=True) < speed.shape[1]
    else:
        far &= np.abs(speed - around) > 0.3 * around
    bad = far & fast
    if bad.any():
        counts = zip(columns, bad.sum(axis=0), strict=True)
        per = ", ".join(f"{c} {n}" for c, n in counts if n)
        text = f"samples far from their neighbours set apart: {per}"
        findings.append(Finding("speed_glitch", "warning", name, text, channel="speed"))
    return np.where(bad, around, speed), findings


def stands(speed: Array) -> NDArray[np.bool_]:
    """Return where the rotor stands, of speeds (N,)."""
    return np.asarray(speed <= _MAX_STANDSTILL_SHARE * float(speed.max(initial=1.0)))


def is_recording(speed: Array) -> bool:
    """Return whether rows are samples of a recording, whose speed hardly moves between them."""
    steps = np.abs(np.diff(speed)) / max(float(speed.max()), 1e-9)
    return speed.size > _MIN_RECORDING_ROWS and float(np.median(steps)) < _MAX_RECORDING_STEP_SHARE


def _dropouts(channels: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Return the operating points at 0 rpm whose load lies on that of a turning rotor.

    Not where known weights hang on the cell: they load it at standstill.
    """
    speed, y = channels["speed"], channels.get("thrust", channels.get("torque", np.zeros(0)))
    still = stands(speed)
    known = np.isfinite(y) & ~still
    weighed = {"applied_thrust", "applied_torque"} & set(channels)
    if weighed or is_recording(speed) or not still.any() or known.sum() < 3:
        return np.zeros(speed.size, bool)
    # the load is a zero and a share of the square of speed
    k, zero = np.polyfit(speed[known] ** 2, y[known], 1)
    share = np.sign(k) * (y - zero) / max(float(np.ptp(y[known])), 1e-12)
    first = int(np.argmin(still))
    lost = still & (share > _MIN_TURNING_LOAD_SHARE)
    lost[:first] |= share[:first] > share[:first].min(initial=np.inf) + _MIN_LOAD_DIFFERENCE_SHARE
    return np.asarray(lost)


def _check_plausible(table: StandTable, path: Path) -> None:
    """Refuse speeds, loads, angles and standard deviations that can't be true.

    Raises:
        InputError: one of them; names the column and the accepted values.
    """
    channels = table.channels
    most = SPEED_LIMIT if table.mapping.model == "tombo" else _MAX_SPEED_RAD_S
    top = float(channels["speed"].max())
    if not _MIN_TOP_SPEED_RAD_S <= top <= most:
        _refuse(
            table, path, "speed", f"reaches {top / RPM:.0f} rpm",
            f"{_MIN_TOP_SPEED_RAD_S / RPM:.0f} to {most / RPM:.0f} rpm: is the unit right (rpm, "
            "rad/s, Hz), or the pole count?",
        )  # fmt: skip
    for key in ("thrust", "torque"):
        if key in channels and _rise(channels["speed"] ** 2, channels[key]) < 0.0:
            _refuse(
                table, path, key, "falls with speed",
                f"{key} that rises; of a cell mounted the other way round give `sign: -1` in "
                "--mapping",
            )  # fmt: skip
    angle = float(np.nanmax(np.abs(channels.get("beta", np.zeros(1))), initial=0.0))
    if angle > 0.5 * math.pi:
        accepted = "below 90: is the unit right (deg, rad)?"
        _refuse(table, path, "beta", f"reaches {math.degrees(angle):.0f} degrees", accepted)
    for key in ("thrust_sigma", "torque_sigma"):
        if key in channels and not (channels[key] > 0.0).all():
            accepted = "numbers above 0, the noise's standard deviation"
            _refuse(table, path, key, f"has {np.nanmin(channels[key]):g}", accepted)


def _refuse(table: StandTable, path: Path, key: str, wrong: str, accepted: str) -> None:
    where = table.mapping.channels[key]
    raise InputError(
        f"'{path}': column '{where.columns[0]}' {wrong} as {where.unit}; accepted: {accepted}"
    )


def _rise(square: Array, load: Array) -> float:
    """Return the rise of a load with the square of speed; of a single speed the load itself."""
    known = np.isfinite(load)
    x, y = square[known], load[known]
    if x.size < 3 or np.ptp(x) < 0.1 * x.max():
        return float(np.median(y)) if x.size else 0.0
    return float(np.polyfit(x, y, 1)[0])

"""The products of `make docs`: which files each writes, and the function that makes it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from tombo_benchmarks.docs.markdown import table_markdown, updated
from tombo_dynamics.errors import InputError

CONFIG: Final = "tombo_ws/src/tombo_bringup/config"
CAMPAIGN: Final = "tombo_ws/src/tombo_propeller/tombo_propeller/reproduce/campaign.yaml"
Make = Callable[[Path, Path], None]
"""Writes a product; takes the project's folder and that of the shared data."""


@dataclass(frozen=True)
class Product:
    """Something in the documentation that comes from the code.

    Attributes:
        written: files, and `PAGE#NAME` for what stands between the markers of a page.
        make: writes them.
        data: folder of the shared data that it needs; empty if it needs none.
    """

    written: tuple[str, ...]
    make: Make
    data: str = ""


def _tables(root: Path, data: Path) -> None:
    from tombo_benchmarks.docs.parameter_file import parameter_file
    from tombo_benchmarks.docs.tables import PAGES, effects_markdown, tables, wiring_mermaid
    from tombo_flight.suite.parameter_yaml import default_file
    from tombo_sim.wiring import COMMAND, CORES, SENSORS

    _write(root / "docs" / "effects.md", effects_markdown())
    _write(root / CONFIG / "all_parameters.yaml", parameter_file())
    _write(root / CONFIG / "suite.yaml", default_file())
    for page in PAGES:
        _fill(root / "docs" / page, tables(page))
    _fill(root / "docs" / "architecture.md", {"wiring": wiring_mermaid(CORES, SENSORS, COMMAND)})


def _reproduction(root: Path, data: Path) -> None:
    from tombo_benchmarks.docs.tables import claims_markdown
    from tombo_propeller.reproduce.plots import overview
    from tombo_propeller.reproduce.reproduction import reproduce

    found = reproduce()
    _fill(root / "docs" / "reproduction.md", {"claims": claims_markdown(found)})
    overview(found).savefig(root / "docs" / "reproduction.png", dpi=110)


def _flight(root: Path, data: Path) -> None:
    from tombo_benchmarks.docs.flight_animation import animation
    from tombo_flight.flight import fly_scenario
    from tombo_flight.scenario import load_scenario

    (root / "docs" / "flight.gif").write_bytes(animation(fly_scenario(load_scenario(), 0)))


def _campaign(root: Path, data: Path) -> None:
    """Fly the campaigns of the README's table."""
    flown = {
        name: _fly_many("paper_collision", settings, range(100))
        for name, settings in (
            ("", ()),
            ("unaided", ("reaction.name=none",)),
            ("rigid", ("propeller.conf=0",)),
            ("reflex_", ("reaction.name=reflex",)),
        )
    }
    total = {name: flights["aggregate"] for name, flights in flown.items()}
    values: dict[str, str] = {
        "flights": str(total[""]["flights"]),
        "recovered": str(total[""]["recovered"]),
        "crashed_without_reaction": str(total["unaided"]["crashed"]),
        "crashed_rigid": str(total["rigid"]["crashed"]),
        "reflex_recovered": str(total["reflex_"]["recovered"]),
    }
    for name, key, digits, factor in (
        ("falls_m", "max_falling_distance_m", 2, 1.0),
        ("unstable_s", "unstable_phase_s", 1, 1.0),
        ("whole_recovery_s", "recovery_time_s", 1, 1.0),
        ("latency_ms", "contact_known_s", 0, 1e3),
    ):
        for prefix in ("", "reflex_"):
            low, median, high = (
                f"{factor * total[prefix][key][share]:.{digits}f}"
                for share in ("p05", "median", "p95")
            )
            values |= {prefix + name: median, f"{prefix}{name}_range": f"{low} to {high}"}
    aggressive = _fly_many("aggressive", (), range(100))["aggregate"]
    values["false_alarms"] = str(aggressive["false_alarms"])
    falls = sorted(f["max_falling_distance_m"] for f in flown[""]["flights"])
    values["falls_modes_m"] = "; ".join(
        f"{len(mode)} flights {mode[0]:.2f} to {mode[-1]:.2f}" for mode in two_modes(falls)
    )
    head = (
        "# This suite's simulated flights of the paper's experiment, for comparison only. Written "
        "by\n# `make docs`: medians, and the range from 5 to 95 % of the flights.\n"
    )
    _write(root / CAMPAIGN, head + "".join(f'{k}: "{v}"\n' for k, v in values.items()))
    _fill(root / "README.md", {"campaign": campaign_table(values)})


def two_modes(values: Sequence[float]) -> tuple[Sequence[float], ...]:
    """Split sorted values at their widest gap; one group if no gap is a quarter of the range."""
    gaps = [b - a for a, b in pairwise(values)]
    if not gaps or max(gaps) < 0.25 * (values[-1] - values[0]):
        return (values,)
    cut = gaps.index(max(gaps)) + 1
    return values[:cut], values[cut:]


_CAMPAIGN_TABLE: Final = """\
| | paper | its reaction, simulated, seeds 0–99: median (5 to 95 %) | `reflex`, the same |
|---|---|---|---|
| recovers with the reaction | yes | {recovered} of {flights} | {reflex_recovered} of {flights} |
| crashes without it | yes | {crashed_without_reaction} of {flights} |  |
| crashes with rigid propellers (Conf. 0), even with the reaction | – | {crashed_rigid} of \
{flights} |  |
| largest falling distance | 0.5 m (mean) | {falls_m} m ({falls_m_range}) | \
{reflex_falls_m} m ({reflex_falls_m_range}) |
{modes}\
| unstable phase | 1.5 s | {unstable_s} s ({unstable_s_range}) | \
{reflex_unstable_s} s ({reflex_unstable_s_range}) |
| recovery, from contact to settled at x_r | 5 s | \
{whole_recovery_s} s ({whole_recovery_s_range}) | \
{reflex_whole_recovery_s} s ({reflex_whole_recovery_s_range}) |
| contact known, mocap at 30 Hz | – | {latency_ms} ms ({latency_ms_range}) | \
{reflex_latency_ms} ms ({reflex_latency_ms_range}) |
| false alarms in 100 flights of jumps, gusts and dropouts | – | {false_alarms} |  |
"""


def campaign_table(values: Mapping[str, str]) -> str:
    """Return the README's table of the campaign's figures."""
    modes = (mode.split(" ", 2) for mode in values["falls_modes_m"].split("; "))
    rows = (
        f"| falling distance, {count} of the flights | – | {m} m |  |\n" for count, _, m in modes
    )
    return _CAMPAIGN_TABLE.format(**values, modes="".join(rows))


_VARIATIONS: Final[tuple[tuple[str, tuple[str, ...]], ...]] = (
    ("nothing", ()),
    ("strike 10 ms", ("effects.blade_strike.duration=0.010",)),
    ("strike 12 ms", ("effects.blade_strike.duration=0.012",)),
    ("strike 16 ms", ("effects.blade_strike.duration=0.016",)),
    ("slant 0.25 rad", ("effects.blade_strike.slant=0.25",)),
    ("slant 0.55 rad", ("effects.blade_strike.slant=0.55",)),
    ("0.5 m/s", ("mission.approach_speed=0.5",)),
    ("0.9 m/s", ("mission.approach_speed=0.9",)),
    ("pillar 4 cm further right", ("obstacle.y=0.23",)),
    ("pillar 4 cm further left", ("obstacle.y=0.31",)),
    ("pillar of radius 0.1 m", ("obstacle.x=2.0725", "obstacle.y=0.2283", "obstacle.radius=0.1")),
    ("pillar of radius 0.5 m", ("obstacle.x=2.4568", "obstacle.y=0.3395", "obstacle.radius=0.5")),
    ("frame contact half as stiff", ("effects.contact_force.stiffness=3000",)),
    ("frame contact twice as stiff", ("effects.contact_force.stiffness=12000",)),
    (
        "a pole of 30 mm, right ahead of the hub",
        ("obstacle.x=2.0108", "obstacle.y=0.1697", "obstacle.radius=0.03"),
    ),
)
"""The variations of docs/calibration.md, as settings. A pillar keeps its point of contact."""


def _calibration(root: Path, data: Path) -> None:
    figures, rows = ("max_falling_distance_m", "unstable_phase_s", "recovery_time_s"), []
    for name, settings in _VARIATIONS:
        total, unaided = (
            _fly_many("paper_collision", (*settings, *more), range(1000, 1050))["aggregate"]
            for more in ((), ("reaction.name=none",))
        )
        crashed = str(total["crashed"]), str(unaided["crashed"])
        rows.append((name, *crashed, *(_spread(total[key]) for key in figures)))
    head = ("changed", "crashed", "crashed without", "falls m", "unstable s", "recovery s")
    _fill(root / "docs" / "calibration.md", {"variations": table_markdown(head, rows)})


def _spread(values: Mapping[str, Any]) -> str:
    if not values["count"]:
        return "–"
    return f"{values['median']:.2f} ({values['p05']:.2f} to {values['p95']:.2f})"


def _arena(root: Path, data: Path) -> None:
    from tombo_flight.sweep.folder import RESULT, read_head
    from tombo_flight.sweep.results import HEAD, point_rows

    reactions = "reaction.name=admittance,bounce,mpc,none,reflex"
    asked = ("sweep", "collisions", reactions, "--disturbances", "--seeds", "5000:5030")
    with TemporaryDirectory() as folder:
        _tombo(*asked, "-o", folder)
        results = read_head(Path(folder))[RESULT]
    left_out = ("unstable [s]", "peak force [N]", "rotor right", "false alarms/h")
    shown = [name not in left_out for name in ("reaction", *HEAD)]
    rows = [
        ("" if n else group, *compress(row, shown))
        for group, lines in point_rows(results)
        for n, row in enumerate(lines)
    ]
    head = ("collision", *compress(("reaction", *HEAD), shown))
    table = f"`tombo {' '.join(asked)}`:\n\n{table_markdown(head, rows)}"
    _fill(root / "docs" / "sweep.md", {"arena": table})


def _evidence(root: Path, data: Path) -> None:
    from tombo_benchmarks.docs.evidence_pictures import draw_evidence

    draw_evidence(root / "docs")


def _px4(root: Path, data: Path) -> None:
    with TemporaryDirectory() as folder:
        _tombo("fly", "--px4", "--seed", "0", "-o", folder, "--force")
        shutil.copy(Path(folder) / "flight.png", root / "docs" / "px4_flight.png")
        summary = json.loads((Path(folder) / "summary.json").read_text(encoding="utf-8"))
    falls = summary["max_falling_distance_m"]
    text = (
        "![A flight over MAVLink: PX4 goes from hold to offboard, the vehicle hits the pillar, "
        f"falls {falls:.2f} m, returns to x_r and is landed by PX4](px4_flight.png)\n"
    )
    _fill(root / "docs" / "px4.md", {"px4_flight": text})


def _diagnosis(root: Path, data: Path) -> None:
    from tombo_diagnosis.diagnosis import diagnosis_mapping
    from tombo_diagnosis.flight.diagnose import diagnose_unchecked
    from tombo_diagnosis.flight.nominal import nominal_model
    from tombo_diagnosis.report.figures import draw_pair
    from tombo_diagnosis.report.residual_data import best_pair, by_channel
    from tombo_flight.report.style import figure_bytes
    from tombo_logs.readers.log_reader import read_logs

    logs = sorted((data / "flights").glob("*.csv.gz"))
    flights = read_logs(logs, mapping="nanobench")
    diagnosis = diagnose_unchecked(flights, nominal_model())[0]
    pair = best_pair(by_channel(diagnosis.residuals))
    if pair is not None:
        (root / "docs" / "diagnosis.png").write_bytes(figure_bytes(draw_pair(pair)))
    found = diagnosis_mapping(diagnosis)
    _fill(root / "docs" / "diagnosis.md", {"crazyflie": crazyflie_text(found)})
    _fill(root / "README.md", {"diagnosis": _certainty_text(found)})


def _certainty_text(found: Mapping[str, Any]) -> str:
    """Return how sure a diagnosis is, and what else is possible."""
    text = f"*Confidence of the verdict: {100 * found['confidence']:.0f} %."
    if found["set"]:
        *first, last = (name.replace("_", " ") for name in found["set"])
        others = f"{', '.join(first)} or {last}" if first else last
        text += f" One more cause is present, {others}: these flights can't distinguish them."
    return f"{text}*\n"


def crazyflie_text(found: Mapping[str, Any]) -> str:
    """Return the paragraph about the five Crazyflie flights from `diagnosis.json`."""
    rows = [
        (f"`{cause['effect']}`", name, f"{t['value']:.3g} {t['unit']}",
         f"{t['low']:.3g} to {t['high']:.3g}")
        for cause in found["causes"]
        for name, t in cause["theta"].items()
    ]  # fmt: skip
    table = table_markdown(("cause", "parameter", "value", "95 % interval"), rows)
    evidence = {c["effect"]: c["evidence"] for c in found["candidates"]}
    apart = evidence["linear_rotor_drag"] - evidence["quadratic_body_drag"]
    gain = {g["channel"]: g for g in found["gain"] if g["horizon"] == "one step"}
    x, y = (gain[f"force {axis}"]["reduction"] for axis in "xy")
    return (
        f"The Crazyflie flights of the picture in the README: verdict *{found['verdict']}*.\n\n"
        f"{table}\nLinear drag has a log evidence {apart:.0f} higher than quadratic drag. With "
        f"the causes in the model, the\nforce error on held-out flights falls by {100 * x:.0f} % "
        f"in x and {100 * y:.0f} % in y.\n"
    )


def _picture(name: str, target: str, *command: str) -> Make:
    """Return what runs a command of tombo, and copies one of its pictures into the docs."""

    def make(root: Path, data: Path) -> None:
        with TemporaryDirectory() as folder:
            _tombo(*command, "-o", folder, "--force")
            shutil.copy(Path(folder) / name, root / "docs" / target)

    return make


PRODUCTS: Final = {
    "tables": Product(
        (
            *("docs/effects.md", "docs/nodes.md#nodes", "docs/nodes.md#topics"),
            *(f"{CONFIG}/all_parameters.yaml", f"{CONFIG}/suite.yaml"),
            *("docs/safety.md#states", "docs/safety.md#transitions", "docs/faults.md#faults"),
            *("docs/architecture.md#wiring", "docs/first_real_flight.md#first_flight"),
        ),
        _tables,
    ),
    "flight": Product(("docs/flight.gif",), _flight),
    "campaign": Product((CAMPAIGN, "README.md#campaign"), _campaign),
    "reproduction": Product(
        ("docs/reproduction.png", "docs/reproduction.md#claims"), _reproduction
    ),
    "calibration": Product(("docs/calibration.md#variations",), _calibration),
    "arena": Product(("docs/sweep.md#arena",), _arena),
    "px4": Product(("docs/px4_flight.png", "docs/px4.md#px4_flight"), _px4),
    "diagnosis": Product(
        ("docs/diagnosis.png", "docs/diagnosis.md#crazyflie", "README.md#diagnosis"),
        _diagnosis,
        data="flights",
    ),
    "evidence": Product(
        ("docs/crash_rates.png", "docs/confidence.png", "docs/px4_losses.png"), _evidence
    ),
    "design": Product(
        ("docs/design.png",),
        _picture(
            *("candidates.png", "design.png", "propeller", "design", "--mass", "1.3"),
            *("--frame", "s500", "--min-thrust-margin", "1.7", "--max-collision-force", "150"),
        ),
    ),
}
"""By name, in the order in which they are made: the reproduction quotes the campaign."""


def _fly_many(base: str, settings: Sequence[str], seeds: range) -> dict[str, Any]:
    import pandas as pd

    from tombo_flight.flight_output import flight_summary
    from tombo_flight.process.study import fly_seeds
    from tombo_flight.scenario import load_scenario
    from tombo_flight.sweep.statistics import flight_statistics

    rows = fly_seeds(load_scenario(base, settings), seeds, flight_summary, summary_only=True)
    flights = list(rows.values())
    return {"flights": flights, "aggregate": flight_statistics(pd.DataFrame(flights))}


def _tombo(*arguments: str) -> None:
    command = [sys.executable, "-m", "tombo_bringup.cli.main", *arguments]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise InputError(f"tombo {arguments[0]} ended with {done.returncode}: {last}")


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def _fill(path: Path, tables: Mapping[str, str]) -> None:
    _write(path, updated(path.read_text(encoding="utf-8"), tables))

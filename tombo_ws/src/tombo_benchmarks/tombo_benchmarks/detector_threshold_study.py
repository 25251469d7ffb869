"""Study of the detector's threshold: latency and false alarms.

    python -m tombo_benchmarks.detector_threshold_study [--flights 120]
        [--figure docs/detector_threshold.png]

Every flight is flown once, with the triggers off, and its statistic is kept; any threshold is then
judged on it afterwards. Until its first event a flight is the same with the triggers on.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_bag.topics import MOCAP_POSE
from tombo_benchmarks.docs.markdown import table_markdown
from tombo_dynamics.arrays import Array
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.flight_metrics import statistic_of_poses
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.scenario import Scenario, load_scenario

FIRST_SEED = 5000
THRESHOLDS: Array = np.round(np.geomspace(2.0, 1000.0, 82), 2)
REQUIRED_LATENCY_S = 0.120
_WINDOW_S = 0.5
"""A strike that has not been found by then counts as missed."""

COLLISIONS: dict[str, tuple[str, ...]] = {
    "paper": (),
    "0.4 m/s": ("mission.approach_speed=0.4",),
    "1.0 m/s": ("mission.approach_speed=1.0",),
    "Conf. 8, the softest push": ("propeller.conf=8",),
    "Conf. 10": ("propeller.conf=10",),
    "Conf. 9, the hardest push": ("propeller.conf=9",),
    "pole of 3 cm": ("obstacle.radius=0.03", "obstacle.x=2.0108", "obstacle.y=0.1697"),
    "gusts of 0.7 m/s": ("effects.gusts.deviation=0.7",),
}
"""Variations of the scenario paper_collision, by settings."""
FREE_FLIGHTS: dict[str, tuple[str, ...]] = {
    "aggressive": (),
    "gusts of 1.5 m/s": ("effects.gusts.deviation=1.5",),
    "steps of 3 m": ("mission.step_size=3.0",),
    "2.5 times the mocap noise": (
        "effects.mocap_noise.position=0.00175",
        "effects.mocap_noise.attitude=0.005",
    ),
}
"""Variations of the scenario aggressive, by settings."""


@dataclass(frozen=True)
class DetectorTrace:
    """The detector's statistic in one flight, and the true contact."""

    stamp: Array
    """(M,) capture times of the samples [s]."""
    arrival: Array
    """(M,) when they came; an event is published in the same tick [s]."""
    statistic: Array
    """(M,) normalised innovation squared; 0 where the detector was not armed."""
    contact: float
    """Time of the first contact [s]; inf without one."""


Traces = dict[str, list[DetectorTrace]]
"""By variation."""


@dataclass(frozen=True)
class ThresholdResult:
    """Latency and false alarms of many flights at one threshold."""

    threshold: float
    latency: Array
    """Of the strikes that were found, from contact to the arrival of the sample [s]."""
    missed: int
    """Strikes not found within half a second."""
    early: int
    """Flights with an event before contact."""
    false_alarms: int
    """Events before contact, or without one."""
    minutes: float
    """Time watched before contact [min]."""

    def latency_ms(self, percentile: float) -> float:
        """Return a percentile of the latency [ms]; a missed strike counts as infinitely late."""
        whole = np.sort(np.concatenate([self.latency, np.full(self.missed, math.inf)]))
        if not whole.size:
            return math.nan
        return 1e3 * float(whole[math.ceil(percentile / 100.0 * whole.size) - 1])

    @property
    def false_alarms_per_minute(self) -> float:
        """False alarms per minute watched."""
        return self.false_alarms / self.minutes if self.minutes else math.nan


Outcomes = dict[str, list[ThresholdResult]]
"""By variation, at each of `THRESHOLDS`."""


def record_traces(
    scenario: Scenario, seeds: Iterable[int], workspace: Workspace | None = None
) -> list[DetectorTrace]:
    """Fly a scenario with the triggers off and keep what the detector saw.

    Raises:
        InputError: as `fly_scenario`.
    """
    quiet = dataclasses.replace(
        scenario, detector=dataclasses.replace(scenario.detector, trigger="none")
    )
    memory = workspace or Workspace()
    watches = []
    for seed in seeds:
        record = fly_scenario(quiet, seed, memory)
        poses = record[MOCAP_POSE.name]
        height = poses["position"].values[:, 2] - poses["position"].values[0, 2]
        armed = height > scenario.detector.arm_height
        contact = record.summary["collision_time_s"]
        watches.append(
            DetectorTrace(
                stamp=poses.t,
                arrival=poses.arrival,
                statistic=np.where(armed, statistic_of_poses(record), 0.0),
                contact=math.inf if contact is None else float(contact),
            )
        )
    return watches


def evaluate_threshold(
    watches: Sequence[DetectorTrace], threshold: float, holdoff: float
) -> ThresholdResult:
    """Return what `threshold` makes of the flights, with `holdoff` [s] after a false alarm."""
    latency = []
    missed = early = alarms = 0
    watched = 0.0
    for w in watches:
        above = w.statistic > threshold
        before = w.stamp < w.contact
        count = _events(w.stamp[above & before], holdoff)
        alarms += count
        early += count > 0
        watched += float(np.diff(w.stamp, append=w.stamp[-1:])[before & (w.statistic > 0.0)].sum())
        if math.isfinite(w.contact):
            found = np.flatnonzero(above & ~before & (w.stamp < w.contact + _WINDOW_S))
            if found.size:
                latency.append(float(w.arrival[found[0]]) - w.contact)
            else:
                missed += 1
    return ThresholdResult(threshold, np.array(latency), missed, early, alarms, watched / 60.0)


def _events(stamps: Array, holdoff: float) -> int:
    """Count the events: none within `holdoff` of the last one."""
    count = 0
    free = -math.inf
    for stamp in stamps:
        if stamp >= free:
            count += 1
            free = float(stamp) + holdoff
    return count


def draw_study(collisions: Outcomes, free: Outcomes, chosen: float) -> Figure:
    """Draw latency and false alarms over the threshold, and one against the other.

    Args:
        collisions: the first variation is the reference.
        free: of flights without an obstacle.
        chosen: the threshold in use.
    """
    with new_figure(11.0, 5.2, 110, layout="constrained") as figure:
        left, right = figure.subfigures(1, 2)
        late, alarms = left.subplots(2, 1, sharex=True)
        _draw_latency(late, collisions)
        _draw_alarms(alarms, free)
        for axes in (late, alarms):
            axes.axvline(chosen, color=style.INK, lw=1.4, ls="--")
        late.set_title(f"dashed: threshold in use, {chosen:g}", loc="left", fontsize=9)
        _draw_against(right.subplots(), collisions, free, chosen)
    return figure


def _draw_latency(axes: Axes, collisions: Outcomes) -> None:
    for i, outcomes in reversed(list(enumerate(collisions.values()))):
        late = [o.latency_ms(95.0) for o in outcomes]
        color, width = (style.BLUE, 2.2) if i == 0 else (style.SKY, 0.9)
        label = {0: "the paper's flight", 1: "variations"}.get(i)
        axes.plot(THRESHOLDS, late, color=color, lw=width, label=label)
    required_ms = 1e3 * REQUIRED_LATENCY_S
    axes.axhline(required_ms, color=style.MUTED, lw=1.0, ls=":", label="required")
    axes.set(xscale="log", ylim=(0.0, 200.0), ylabel="p95 latency from contact [ms]")
    axes.legend(loc="upper left", ncols=2)


def _draw_alarms(axes: Axes, free: Outcomes) -> None:
    last = len(free) - 1
    for i, (name, outcomes) in enumerate(free.items()):
        rate = [o.false_alarms_per_minute for o in outcomes]
        ends = {0: (style.VERMILLION, 2.2, f"{name} flights"), last: (style.PURPLE, 1.4, name)}
        color, width, label = ends.get(i, (style.ORANGE, 0.9, "variations" if i == 1 else None))
        axes.plot(THRESHOLDS, rate, color=color, lw=width, label=label)
    axes.set(ylim=(0.0, 20.0), ylabel="false alarms per minute")
    axes.set_xlabel("threshold on the statistic")
    axes.legend(loc="upper right")


def _draw_against(axes: Axes, collisions: Outcomes, free: Outcomes, chosen: float) -> None:
    reference = next(iter(collisions.values()))
    late = [o.latency_ms(95.0) for o in reference]
    colors = (style.INK, style.VERMILLION)
    for (name, outcomes), color in zip(
        [next(iter(free.items())), list(free.items())[-1]], colors, strict=True
    ):
        rate = [o.false_alarms_per_minute for o in outcomes]
        axes.plot(rate, late, color=color, lw=1.4, marker=".", ms=4, label=name)
        k = int(np.argmin(np.abs(THRESHOLDS - chosen)))
        axes.plot(rate[k], late[k], "o", color=color, ms=9, mfc="none", mew=1.6)
        for shown in (5.0, 20.0, 200.0) if color == style.INK else (10.0, 40.0, 500.0):
            k = int(np.argmin(np.abs(THRESHOLDS - shown)))
            axes.annotate(
                f"{shown:g}",
                (rate[k], late[k]),
                xytext=(5.0, -9.0 if color == style.INK else 5.0),
                textcoords="offset points",
                fontsize=7,
                color=color,
            )
    axes.set_xscale("symlog", linthresh=0.1)
    axes.set(xlabel="false alarms per minute", ylabel="p95 latency, paper's flight [ms]")
    axes.set_ylim(0.0, 100.0)
    axes.legend(
        loc="lower right", fontsize=8, title=f"thresholds along the line; ring: {chosen:g}"
    )


@dataclass(frozen=True)
class ThresholdStudy:
    """What was flown: traces by variation, with and without an obstacle."""

    collisions: Traces
    free: Traces
    scenario: Scenario


def run_study(flights: int) -> ThresholdStudy:
    """Fly each variation with `flights` seeds; progress on standard error."""
    seeds = range(FIRST_SEED, FIRST_SEED + flights)
    memory = Workspace()

    def flown(base: str, kinds: dict[str, tuple[str, ...]]) -> Traces:
        found = {}
        for name, settings in kinds.items():
            sys.stderr.write(f"{base}: {name}\n")
            found[name] = record_traces(load_scenario(base, settings), seeds, memory)
        return found

    return ThresholdStudy(
        flown("paper_collision", COLLISIONS), flown("aggressive", FREE_FLIGHTS), load_scenario()
    )


def draw(study: ThresholdStudy, path: Path) -> None:
    """Draw the figure into a file."""
    holdoff = study.scenario.detector.holdoff

    def swept(kinds: Traces) -> Outcomes:
        return {
            name: [evaluate_threshold(traces, float(t), holdoff) for t in THRESHOLDS]
            for name, traces in kinds.items()
        }

    threshold = study.scenario.detector.threshold
    figure = draw_study(swept(study.collisions), swept(study.free), threshold)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def markdown(study: ThresholdStudy) -> str:
    """Return the table of docs/collision.md, and the largest statistic without a contact."""
    holdoff, chosen = study.scenario.detector.holdoff, study.scenario.detector.threshold
    columns = ("paper", "0.4 m/s", "1.0 m/s", "pole of 3 cm", "Conf. 8, the softest push")
    *alarms, noisy = study.free
    groups = (f"false alarms: {names}" for names in (", ".join(alarms), noisy))
    head = ("threshold", *columns, *groups)
    rows = []
    for threshold in (8.0, 13.0, 30.0, 60.0, 100.0, 150.0, 200.0):
        counts = [
            str(evaluate_threshold(traces, threshold, holdoff).false_alarms)
            for traces in study.free.values()
        ]
        shown = f"**{threshold:g}**" if threshold == chosen else f"{threshold:g}"
        cells = [_latencies(study.collisions[name], threshold, holdoff) for name in columns]
        rows.append((shown, *cells, ", ".join(counts[:-1]), counts[-1]))
    largest = [f"{name} {_largest(traces):.1f}" for name, traces in study.free.items()]
    minutes = evaluate_threshold(study.free["aggressive"], 1.0, holdoff).minutes
    return (
        f"{table_markdown(head, rows)}\nEach column of false alarms is {minutes:.0f} minutes of "
        f"flight. Largest statistic without a contact: {', '.join(largest)}.\n"
    )


def _largest(traces: Sequence[DetectorTrace]) -> float:
    """Return the largest statistic of some flights."""
    return max(float(trace.statistic.max()) for trace in traces)


def _latencies(traces: Sequence[DetectorTrace], threshold: float, holdoff: float) -> str:
    found = evaluate_threshold(traces, threshold, holdoff)
    shares = (found.latency_ms(share) for share in (50.0, 95.0))
    cells = [f"{value:.0f}" if math.isfinite(value) else "missed" for value in shares]
    worst = f"{found.missed} missed" if found.missed else f"{found.latency_ms(100.0):.0f}"
    return " / ".join([*cells, worst])


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly, print the table and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--flights", type=int, default=120, help="flights of each kind")
    parser.add_argument("--figure", type=Path, default=Path("detector_threshold.png"))
    options = parser.parse_args(arguments)
    study = run_study(options.flights)
    sys.stdout.write(markdown(study))
    draw(study, options.figure)


if __name__ == "__main__":
    main()

"""One scenario flown with many seeds, on all cores; the result as a page, with its picture."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tombo_bag.flight import Flight
from tombo_dynamics.errors import InputError
from tombo_flight.campaign.statistics import aggregate
from tombo_flight.flight_output import flight_summary
from tombo_flight.json_text import plain
from tombo_flight.own_files import imported_files
from tombo_flight.process.study import Task, fly_seeds
from tombo_flight.process.study_folder import Fly, StudyFolder
from tombo_flight.report import paper_values as paper
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.milestones import reaction_words
from tombo_flight.report.page import Page, Section, Table, Text
from tombo_flight.report.paper_comparison import fixed, is_paper_flight
from tombo_flight.scenario import Scenario, as_mapping
from tombo_flight.scenario_file import complete_mapping
from tombo_flight.sweep.study import figure_columns, figures_of, row_of
from tombo_flight.version import tombo_version

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class CampaignStudy:
    """One scenario, flown with many seeds; a flight's key is its seed."""

    kind = "campaign"
    summary_only = True
    scenario: Scenario
    seeds: range

    @property
    def keys(self) -> range:
        """The keys of its flights."""
        return self.seeds

    def as_mapping(self) -> dict[str, Any]:
        """Return it in the types of JSON: what `campaign.json` says."""
        values: dict[str, Any] = {
            "tombo_version": tombo_version(),
            "scenario": self.scenario.name,
            "values": plain(complete_mapping(self.scenario)),
            "seeds": [self.seeds.start, self.seeds.stop],
            "imports": plain(imported_files()),
        }
        return values

    def columns(self) -> dict[str, str]:
        """Return the columns of the table."""
        return {"flight": "count", "seed": "count", **figure_columns(), "error": "text"}

    def labels(self, point: None) -> dict[str, Any]:
        """Return nothing: all flights are of one point."""
        return {}

    def scenario_at(self, point: None) -> Scenario:
        """Return what is flown."""
        return self.scenario

    def figures(self, flight: Flight, scenario: Scenario) -> dict[str, Any]:
        """Return the columns of a flight."""
        return row_of(flight_summary(flight))


def analyse_campaign(study: CampaignStudy, opened: StudyFolder, fly: Fly) -> Page:
    """Fly all seeds and return their page."""
    began, new = time.perf_counter(), not opened.kept
    fly((Task(seed, None, seed) for seed in study.seeds), len(study.seeds))
    wall_s = time.perf_counter() - began if new else 0.0
    opened.finish()
    return campaign_page(kept_campaign(study, opened, wall_s))


def kept_campaign(
    study: CampaignStudy, opened: StudyFolder, wall_s: float = 0.0
) -> dict[str, Any]:
    """Return the campaign of the flights that are in its folder.

    Args:
        study: what is flown.
        opened: its folder.
        wall_s: how long it took [s]; 0: more than once, it is not known.
    """
    rows = opened.rows((*figure_columns(), "error"))
    flown = {
        seed: {"error": row["error"]} if row["error"] else _summary_of(study, seed, row)
        for seed, row in rows.items()
    }
    return _campaign_of(study.scenario, study.seeds, flown, wall_s)


def _summary_of(study: CampaignStudy, seed: int, row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the summary of a flight that was not recorded, as of `flight_summary`."""
    more = {
        "tombo_version": tombo_version(), "model": study.scenario.model or None,
        "recorded_messages": None,
    }  # fmt: skip
    return {**more, "seed": seed, **figures_of(row)}


def fly_campaign(
    scenario: Scenario,
    seeds: range,
    *,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> dict[str, Any]:
    """Fly a scenario with each of the seeds, without a folder, and return the campaign.

    The order of the flights is that of the seeds, whichever process flew them. A campaign that is
    stopped holds the flights up to the first one missing.

    Args:
        scenario: what to fly.
        seeds: the seeds.
        workers: number of processes; the cores that this process may use if None.
        progress: called with the number of flights done.
        stop: asked ten times a second; True ends all processes and the campaign.

    Returns:
        scenario, model, conf, law, reaction, disturbances, first_seed, last_seed, tombo_version,
        interrupted, `flights` (summaries, see `flight_output`), `not_flown` (seed and error of
        flights that can't be) and `aggregate` of `flights` (see `campaign.statistics`).

    Raises:
        InputError: as `fly_scenario`, with the seed, where no flight can be flown.
    """
    began = time.perf_counter()
    flown = fly_seeds(
        scenario,
        seeds,
        flight_summary,
        summary_only=True,
        workers=workers,
        progress=progress,
        stop=stop,
    )
    return _campaign_of(scenario, seeds, flown, time.perf_counter() - began)


def _campaign_of(
    scenario: Scenario, seeds: range, flown: Mapping[int, Mapping[str, Any]], wall_s: float
) -> dict[str, Any]:
    rows = {seed: flown[seed] for seed in takewhile(flown.__contains__, seeds)}
    flights = [row for row in rows.values() if "error" not in row]
    not_flown = [{"seed": seed, **row} for seed, row in rows.items() if "error" in row]
    if not_flown and not flights:
        raise InputError(f"seed {not_flown[0]['seed']}: {not_flown[0]['error']}")
    return {
        "tombo_version": tombo_version(),
        "scenario": scenario.name,
        "of_paper": is_paper_flight(as_mapping(scenario)),
        "model": scenario.model or None,
        "conf": None if scenario.propeller.plain else scenario.propeller.conf,
        "law": None if scenario.propeller.plain else scenario.propeller.law,
        "reaction": scenario.reaction.name,
        "disturbances": scenario.disturbances,
        "first_seed": seeds[0],
        "last_seed": seeds[-1],
        "interrupted": len(rows) < len(seeds),
        "flights": flights,
        "not_flown": not_flown,
        "aggregate": aggregate(flights, wall_s),
    }


PANELS: Final = (
    (
        "max_falling_distance_m",
        "largest falling distance [m]",
        1.0,
        paper.MEAN_MAX_FALLING_DISTANCE_M,
    ),
    ("unstable_phase_s", "unstable phase [s]", 1.0, paper.UNSTABLE_PHASE_S),
    ("recovery_time_s", "recovery time [s]", 1.0, paper.MEAN_RECOVERY_TIME_S),
    ("contact_known_s", "detection latency [ms]", 1e3, None),
    ("max_tilt_rad", "largest tilt [°]", 180.0 / math.pi, None),
    ("approach_rms_m", "RMS error in the approach [m]", 1.0, None),
)
"""Figure, label of its axis, factor to the unit shown, the paper's value."""
_ROWS: Final = (
    ("max_falling_distance_m", "fall [m]", 1.0, 2, paper.MEAN_MAX_FALLING_DISTANCE_M),
    ("unstable_phase_s", "unstable [s]", 1.0, 2, paper.UNSTABLE_PHASE_S),
    ("recovery_time_s", "recovery [s]", 1.0, 2, paper.MEAN_RECOVERY_TIME_S),
    ("strikes", "strikes", 1.0, 1, None),
    ("contact_known_s", "latency [ms]", 1e3, 0, None),
    ("settled_error_m", "settled [m]", 1.0, 3, None),
    ("max_tilt_rad", "tilt [°]", 180.0 / math.pi, 1, None),
    ("hover_rms_m", "hover RMS [m]", 1.0, 3, None),
    ("approach_rms_m", "approach RMS [m]", 1.0, 3, None),
)
"""Key of the aggregate, words, factor to the unit shown, decimals, the paper's value."""


def campaign_page(campaign: Mapping[str, Any]) -> Page:
    """Return the page of a campaign: of each figure median and 5 to 95 % range."""
    total = campaign["aggregate"]
    crashes = 2 * total["crashed"] > total["flights"]
    return Page(
        title=f"Campaign of {campaign['scenario']}",
        eyebrow="Campaign",
        headline=_title(campaign),
        summary=_outcome(total),
        verdict_style="bad" if crashes else "good",
        sections=[Section("", [_figures(campaign)]), Section("", [Text(_remarks(campaign))])],
        data=campaign,
    )


def _figures(campaign: Mapping[str, Any]) -> Table:
    of_paper = campaign["of_paper"]
    lines = []
    for key, name, scale, digits, printed in _ROWS:
        values = campaign["aggregate"][key]
        if not values["count"]:  # as of the figures of a collision where there is no obstacle
            continue
        cells = [name, "–" if printed is None else f"{printed:g}"] if of_paper else [name]
        for part in ("median", "p05", "p95", "max"):
            value = values[part]
            cells.append("–" if value is None else fixed(scale * value, digits))
        lines.append([*cells, str(values["count"])])
    head = ["", *(["paper"] if of_paper else []), "median", "5 %", "95 %", "max", "of"]
    return Table(head, lines)


def _outcome(total: Mapping[str, Any]) -> str:
    if not total["flights"]:
        return "No flight has ended."
    low, high = total["crash_rate_95"]
    more = {"crashed": f" ({100.0 * low:.1f} to {100.0 * high:.1f} %)"}
    counts = ("collided", "detected", "recovered", "crashed", "landed")
    line = ", ".join(f"{total[name]} {name}{more.get(name, '')}" for name in counts)
    return f"{total['flights']} flights: {line}; {total['false_alarms']} false alarms."


def _remarks(campaign: Mapping[str, Any]) -> list[str]:
    total, lines = campaign["aggregate"], []
    for flight in campaign["not_flown"][:1]:
        count, seed = len(campaign["not_flown"]), flight["seed"]
        lines.append(f"{count} not flown; the first: seed {seed}: {flight['error']}")
    if campaign["interrupted"]:
        asked = campaign["last_seed"] - campaign["first_seed"] + 1
        done = total["flights"] + len(campaign["not_flown"])
        lines.append(f"Interrupted: {done} of {asked} flights are done.")
    factor = total["real_time_factor"]
    if factor is not None:
        lines.append(f"Flown in {total['wall_time_s']:.1f} s, {factor:.0f} times real time.")
    return lines


def _title(campaign: Mapping[str, Any]) -> str:
    reaction = reaction_words(campaign["reaction"])
    propeller = f"Conf. {campaign['conf']}, law {campaign['law']}"
    parts = [
        "plain propellers" if campaign["conf"] is None else propeller,
        campaign["model"] and f"model {campaign['model']}",
        reaction,
        campaign["disturbances"] and "with disturbances",
    ]
    seeds = f"seeds {campaign['first_seed']} to {campaign['last_seed']}"
    return f"{campaign['scenario']}, {seeds} ({', '.join(str(part) for part in parts if part)})"


def draw_campaign(campaign: Mapping[str, Any]) -> Figure:
    """Draw histograms of a campaign's figures, 1800 x 1050 px; marked are median, range, paper.

    Largest falling distances have two modes: the vehicle catches itself at once, or only after it
    has tilted. A mean would lie between them.
    """
    flights, total = campaign["flights"], campaign["aggregate"]
    reaction = reaction_words(campaign["reaction"])
    with new_figure(12.0, 7.0, 150) as figure:
        for axes, (key, label, scale, printed) in zip(histograms(figure), PANELS, strict=True):
            values = [scale * flight[key] for flight in flights if flight[key] is not None]
            of_paper = printed if campaign["of_paper"] else None
            draw_histogram(axes, np.array(values, dtype=np.float64), label, of_paper)
        figure.suptitle(
            f"{campaign['scenario']}, seeds {campaign['first_seed']} to {campaign['last_seed']}, "
            + ("plain propellers" if campaign["conf"] is None else f"Conf. {campaign['conf']}")
            + ("" if reaction is None else f", {reaction}")
            + (", with disturbances" if campaign["disturbances"] else "")
            + f": {total['flights']} flights, {total['collided']} collided, "
            f"{total['crashed']} crashed, {total['recovered']} recovered",
            parse_math=False,
        )
    return figure


def histograms(figure: Figure) -> list[Axes]:
    """Return axes for the histograms of `PANELS` in a figure of 12 x 7 inches.

    They have fixed places: a layout that measures the texts would draw all of them twice.
    """
    places = {"left": 0.045, "right": 0.99, "bottom": 0.065, "top": 0.92, "hspace": 0.26}
    return list(figure.subplots(2, 3, gridspec_kw={**places, "wspace": 0.15}).flat)


def draw_histogram(
    axes: Axes, values: np.ndarray[Any, np.dtype[np.float64]], label: str, printed: float | None
) -> None:
    """Draw a histogram with median, 5 to 95 % range, and the value that the paper prints."""
    from matplotlib.ticker import MaxNLocator

    axes.set_xlabel(label)
    axes.set_ylabel("flights")
    if not values.size:
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", color=style.MUTED)
        axes.set(xticks=[], yticks=[])
        return
    bins = max(5, min(30, round(2.0 * values.size**0.5)))
    low, median, high = np.percentile(values, (5.0, 50.0, 95.0))
    axes.axvspan(low, high, color=style.FAINT, lw=0.0, label=f"5 to 95 %: {low:.3g} to {high:.3g}")
    counts, edges = np.histogram(values, bins)
    axes.stairs(counts, edges, fill=True, color=style.SKY)
    axes.axvline(median, color=style.INK, lw=1.4, label=f"median {median:.3g}")
    if printed is not None:
        axes.axvline(printed, color=style.VERMILLION, lw=1.8, ls="--", label=f"paper {printed:g}")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylim(0.0, 1.05 * counts.max())
    spacing = {"handlelength": 1.2, "handletextpad": 0.4, "columnspacing": 1.0}
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1, ncols=3, **spacing)

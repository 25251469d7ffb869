"""`tombo benchmark stand`: synthetic cases of the stand diagnosis, scored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from tombo_benchmarks.cli.benchmark_run import DrawnCases
from tombo_flight.report.page import Cell, Table

_ROWS: Final[tuple[tuple[str, str, str, float], ...]] = (
    ("top1_large", "right cause first, large", ">= 95 %", 0.95),
    ("top1_medium", "... medium", "", 0.0),
    ("top1_small", "... small", "", 0.0),
    ("answer_large", "... or in a set of six at most, large", "", 0.0),
    ("answer_medium", "... medium", "", 0.0),
    ("answer_small", "... small", "", 0.0),
    ("right_if_named", "right if named", "", 0.0),
    ("truth_in_set", "truth in the answered set", "", 0.0),
    ("mean_set_size", "mean size of the set", "", 0.0),
    ("false_alarm", "false alarm without an effect", "<= 5 %", 0.05),
    ("false_alarm_upper", "... upper bound, 95 %", "", 0.0),
    ("unknown_wrongly_named", "unknown cause wrongly named", "<= 2 %", 0.02),
    ("unknown_partly_explained", "... called partly explained", "", 0.0),
    ("unknown_missed", "... missed", "", 0.0),
    ("pair_both", "two causes: both", "", 0.0),
    ("pair_one", "... at least one", "", 0.0),
    ("parameter_error_median", "parameter error, median", "", 0.0),
    ("parameter_error_p90", "... 90 % below", "", 0.0),
    ("coverage_95", "95 % intervals that cover", "", 0.0),
    ("seconds_per_case", "seconds a case", "", 0.0),
)
_PLAIN: Final = ("mean_set_size", "seconds_per_case")
_STANDS: Final = ("full", "beta", "torque", "thrust")


def benchmark_stand(drawn: DrawnCases) -> None:
    """Hide what can be wrong in simulated thrust-stand runs, and count how often it is found.

    The stands are richer than the candidates: everything off by tolerances, heavy
    tails, unknown shapes such as stall, friction, Reynolds number, resonance, creep.
    Four kinds of stand, from thrust alone to check loads and a second tachometer.
    """
    from tombo_benchmarks.diagnosis.stand_evaluation import benchmark as run

    drawn.score_drawn("stand", run, 200, print_score)


def print_score(aggregate: Mapping[str, Any], cases: int) -> None:
    """Print the score: all cases, then each kind of stand."""
    from tombo_bringup.cli.tables import print_table

    parts = (aggregate, *(aggregate[s] for s in _STANDS))
    rows: list[Sequence[str | Cell]] = [("cases", "", *(str(p["cases"]) for p in parts))]
    for key, words, asked, limit in _ROWS:
        cells = []
        for part in parts:
            value = part.get(key)
            text = "–"
            if value is not None:
                text = f"{value:.2f}" if key in _PLAIN else f"{100.0 * value:.1f} %"
            good = not asked or value is None or (value >= limit) == asked.startswith(">")
            cells.append(Cell(text, "" if good or value == limit else "bad"))
        rows.append((words, asked, *cells))
    head = ("", "asked for", "all", *_STANDS)
    print_table(Table(head, rows, title=f"{cases} blind stand cases"))

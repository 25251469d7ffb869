"""Real flights: which answers count as right, and the page of a few trials from their files."""

import json
from dataclasses import replace

import pytest

from tombo_benchmarks.diagnosis.runner import BenchmarkResult
from tombo_benchmarks.real.real_benchmark import aggregate, examine, outcome_of
from tombo_benchmarks.real.real_page import real_page
from tombo_benchmarks.real.trials import NOTHING, ROOT, Trial, trials
from tombo_bringup.cli.main import run
from tombo_flight.report.page import page_json

DATA = ROOT.parent / "shared" / "data"
WEIGHT = Trial("crazypad", "healthy", (), "", "weight", "weight", frozenset({"weight.a"}))
SOUND = replace(WEIGHT, truth=NOTHING, right=frozenset(), accepted=frozenset({"drag", "unknown"}))


@pytest.mark.parametrize(
    ("trial", "verdict", "said", "outcome"),
    [
        (WEIGHT, "named", {"weight.a"}, "right"),
        (WEIGHT, "named", {"weight.b"}, "wrong"),
        (WEIGHT, "set", {"weight.a", "weak.a"}, "set"),
        (WEIGHT, "set", {"weight.b", "weak.a"}, "wrong"),
        (WEIGHT, "set", {"weight.a", "b", "c", "d"}, "wrong"),
        (WEIGHT, "unknown", set(), "unknown"),
        (WEIGHT, "none", set(), "none"),
        (SOUND, "none", set(), "right"),
        (SOUND, "named", {"drag"}, "right"),
        (SOUND, "named", {"drag", "wind"}, "wrong"),
        (SOUND, "unknown", set(), "right"),
        (replace(SOUND, accepted=frozenset()), "unknown", set(), "wrong"),
    ],
)
def test_outcome(trial, verdict, said, outcome):
    assert outcome_of(trial, verdict, frozenset(said)) == outcome


def row(outcome, confidence, truth="weight", verdict="named"):
    return {
        "case": 0, "data_set": "crazypad", "way": "healthy", "done": "", "truth": truth,
        "right": [], "verdict": verdict, "said": [], "confidence": confidence, "outcome": outcome,
    }  # fmt: skip


def test_stated_against_right_leaves_out_what_states_no_cause():
    rows = [
        *[row("right", 0.95)] * 8, *[row("wrong", 0.95)] * 2, row("set", 0.8),
        row("unknown", 0.95, verdict="unknown"), row("refused", None, verdict="refused"),
        row("wrong", 0.99, NOTHING, "unknown"), row("right", 0.7, NOTHING, "none"),
    ]  # fmt: skip
    found = aggregate(rows)
    low, middle, high, every = found["stated"]
    assert [b["answers"] for b in (low, middle, high, every)] == [1, 1, 10, 12]
    # Wilson's interval of 8 of 10, by his formula with z = 1.96
    assert (high["right"], high["low"], high["high"]) == pytest.approx(
        (0.8, 0.490, 0.943), abs=1e-3
    )
    assert found["healthy"]["wrong"] == 1 and found["outcomes"]["refused"] == 1
    assert json.loads(page_json(real_page(BenchmarkResult(rows, found))))["aggregate"][
        "cases"
    ] == len(rows)


def test_a_folder_without_flights_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        run(["benchmark", "real", "--data", str(tmp_path)])
    assert left.value.code == 2
    assert "no flights there; accepted: a folder with" in capsys.readouterr().err


@pytest.mark.skipif(not (DATA / "crazypad").is_dir(), reason=f"no {DATA / 'crazypad'}")
def test_trials_hold_no_flight_against_itself():
    listed = trials(DATA)
    assert all(not {*t.logs} & {*t.healthy} for t in listed)
    assert all((DATA / log).is_file() for t in listed for log in (*t.logs, *t.healthy))
    few = trials(DATA, 2)
    assert all(sum(t.data_set == name for t in few) <= 2 for name in {t.data_set for t in few})


@pytest.mark.slow
@pytest.mark.skipif(not (DATA / "crazypad").is_dir(), reason=f"no {DATA / 'crazypad'}")
def test_a_weight_near_a_rotor_is_answered_from_the_files():
    heavy = next(t for t in trials(DATA) if "W3 taped" in t.done)
    assert examine([heavy], DATA, 0, 0)["outcome"] in ("right", "set")

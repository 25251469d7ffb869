"""The score, of rows made by hand."""

import pytest

from tombo_benchmarks.diagnosis.score import score, score_of_flights


def row(kind="single", verdict="named", causes=("wind",), hidden=("wind",), size="large", **more):
    return {
        "kind": kind, "size": size, "verdict": verdict, "causes": list(causes), "set": [],
        "hidden": list(hidden), "formulation": "imu", "confidence": 0.97, "seconds": 2.0,
    } | more  # fmt: skip


TWO = ("wind", "mass")
SCORED = {
    "right causes are counted by size": (
        [row(), row(causes=("drag", "wind")), row(size="medium"),
         row(size="medium", verdict="none", causes=()), row(size="small", verdict="set")],
        {"cases": 5, "top1_large": 0.5, "top1_medium": 0.5, "top1_small": 1.0,
         "top1_large_cases": 2},
    ),
    "a name that was not hidden is wrong": (
        [row(), row(causes=("drag",)), row(causes=("wind", "drag")),
         row(kind="none", hidden=(), causes=("wind",)), row(verdict="set", causes=("drag",))],
        {"right_if_named": 0.25, "named_cases": 4},
    ),
    "the truth is looked for in what was answered": (
        [row(verdict="set", causes=("drag", "wind"), set=["drag", "wind"]),
         row(verdict="set", causes=("drag",), set=["drag", "bias", "mass"]),
         row(verdict="unknown", causes=())],
        {"truth_in_set": 0.5, "mean_set_size": 2.5},
    ),
    "unknown causes must get no name": (
        [row("unknown", verdict, causes, ("tether",)) for verdict, causes in (
            ("named", ("wind",)), ("set", ("wind", "drag")), ("unknown", ()), ("none", ()),
            ("partly_explained", ("wind",)))],
        {"unknown_wrongly_named": 0.4, "unknown_missed": 0.2, "unknown_partly_explained": 0.2},
    ),
    "pairs are found whole or in part": (
        [row("pair", causes=TWO, hidden=TWO), row("pair", causes=("wind",), hidden=TWO),
         row("pair", causes=("drag",), hidden=TWO), row("pair", "unknown", (), TWO)],
        {"pair_both": 0.25, "pair_one": 0.5, "pair_cases": 4},
    ),
    "errors of parameters and their coverage": (
        [row(parameters={"gusts": {"error": 0.5, "covered": [True]}}),
         *(row(parameters={"wind": {"error": e, "covered": [e < 0.05]}})
           for e in (0.01, 0.02, 0.03, 0.04, 0.10))],
        {"parameter_error_median": 0.03, "parameter_error_p90": 0.076,
         "parameter_error_chance_median": 0.5, "coverage_95": 5 / 6},
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", SCORED)
def test_rows_are_scored(what):
    rows, expected = SCORED[what]
    said = score(rows)
    assert {key: said[key] for key in expected} == pytest.approx(expected)


def test_false_alarms_have_an_upper_bound():
    rows = [row("none", "none", (), ()) for _ in range(99)] + [row("none", "unknown", (), ())]
    said = score(rows)
    assert said["false_alarm"] == pytest.approx(0.01) and said["healthy_cases"] == 100
    assert said["false_alarm_upper"] == pytest.approx(0.0545, abs=1e-3)
    assert score(rows[:1])["false_alarm_upper"] == pytest.approx(0.975, abs=1e-3)
    assert score(rows[-1:])["false_alarm_upper"] == 1.0


def test_without_rows_nothing_is_claimed():
    said = score([])
    assert said["cases"] == 0
    assert all(said[k] is None for k in ("top1_large", "false_alarm", "coverage_95",
                                         "right_if_named", "truth_in_set"))  # fmt: skip


def test_mocap_alone_is_scored_apart_and_what_did_not_fly_not_at_all():
    rows = [
        row(), row(formulation="mocap", causes=("drag",)), row(formulation="imu_rpm"),
        {"kind": "single", "size": "large", "formulation": "imu", "hidden": ["wind"],
         "verdict": "not flown", "why": "crashed"},
    ]  # fmt: skip
    said = score_of_flights(rows)
    assert said["cases"] == 2 and said["top1_large"] == 1.0
    assert said["mocap_only"]["cases"] == 1 and said["mocap_only"]["top1_large"] == 0.0
    assert said["not_flown"] == 1


def test_stated_confidence_is_held_against_what_is_right():
    rows = [row(confidence=0.99), row(confidence=0.99, causes=("drag",)),
            row(confidence=0.6, verdict="unknown", causes=())]  # fmt: skip
    table = score(rows)["calibration"]
    assert [(bin["cases"], bin["right"]) for bin in table] == [(1, 0.0), (2, 0.5)]
    full = score([row(confidence=1.0), row(confidence=0.0)])["calibration"]
    assert sum(bin["cases"] for bin in full) == 2

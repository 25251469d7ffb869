"""The score, of rows made by hand."""

import pytest

from tombo_diagnosis.benchmark.score import score, score_of_flights


def row(kind="single", verdict="named", causes=("wind",), hidden=("wind",), size="large", **more):
    return {
        "kind": kind, "size": size, "verdict": verdict, "causes": list(causes), "set": [],
        "hidden": list(hidden), "formulation": "imu", "confidence": 0.97, "seconds": 2.0,
    } | more  # fmt: skip


def test_right_causes_are_counted_by_size():
    rows = [
        row(), row(causes=("drag", "wind")), row(size="medium"),
        row(size="medium", verdict="none", causes=()), row(size="small", verdict="set"),
    ]  # fmt: skip
    said = score(rows)
    assert said["cases"] == 5
    assert (said["top1_large"], said["top1_medium"], said["top1_small"]) == (0.5, 0.5, 1.0)
    assert said["top1_large_cases"] == 2


def test_a_name_that_was_not_hidden_is_wrong():
    rows = [
        row(), row(causes=("drag",)), row(causes=("wind", "drag")),
        row(kind="none", hidden=(), causes=("wind",)), row(verdict="set", causes=("drag",)),
    ]  # fmt: skip
    assert score(rows)["right_if_named"] == pytest.approx(1 / 4)
    assert score(rows)["named_cases"] == 4


def test_the_truth_is_looked_for_in_what_was_answered():
    rows = [
        row(verdict="set", causes=("drag", "wind"), set=["drag", "wind"]),
        row(verdict="set", causes=("drag",), set=["drag", "bias", "mass"]),
        row(verdict="unknown", causes=()),
    ]
    said = score(rows)
    assert said["truth_in_set"] == 0.5
    assert said["mean_set_size"] == pytest.approx(2.5)


def test_false_alarms_have_an_upper_bound():
    rows = [row("none", "none", (), ()) for _ in range(99)] + [row("none", "unknown", (), ())]
    said = score(rows)
    assert said["false_alarm"] == pytest.approx(0.01) and said["healthy_cases"] == 100
    assert said["false_alarm_upper"] == pytest.approx(0.0545, abs=1e-3)
    assert score(rows[:1])["false_alarm_upper"] == pytest.approx(0.975, abs=1e-3)
    assert score(rows[-1:])["false_alarm_upper"] == 1.0


def test_unknown_causes_must_get_no_name():
    rows = [
        row("unknown", verdict, causes, ("tether",))
        for verdict, causes in (
            ("named", ("wind",)), ("set", ("wind", "drag")), ("unknown", ()), ("none", ()),
            ("partly_explained", ("wind",)),
        )
    ]  # fmt: skip
    said = score(rows)
    assert said["unknown_wrongly_named"] == pytest.approx(0.4)
    assert said["unknown_missed"] == said["unknown_partly_explained"] == pytest.approx(0.2)


def test_pairs_are_found_whole_or_in_part():
    rows = [
        row("pair", causes=("wind", "mass"), hidden=("wind", "mass")),
        row("pair", causes=("wind",), hidden=("wind", "mass")),
        row("pair", causes=("drag",), hidden=("wind", "mass")),
        row("pair", "unknown", (), ("wind", "mass")),
    ]
    said = score(rows)
    assert said["pair_both"] == 0.25 and said["pair_one"] == 0.5 and said["pair_cases"] == 4


def test_errors_of_parameters_and_their_coverage():
    rows = [
        row(parameters={"wind": {"error": e, "covered": [e < 0.05]}})
        for e in (0.01, 0.02, 0.03, 0.04, 0.10)
    ]
    rows.append(row(parameters={"gusts": {"error": 0.5, "covered": [True]}}))
    said = score(rows)
    assert said["parameter_error_median"] == pytest.approx(0.03)
    assert said["parameter_error_p90"] == pytest.approx(0.076)
    assert said["parameter_error_chance_median"] == pytest.approx(0.5)
    assert said["coverage_95"] == pytest.approx(5 / 6)


def test_an_error_of_nothing_counts():
    said = score([row(parameters={"wind": {"error": e, "covered": []}}) for e in (0.0, 0.0, 0.3)])
    assert said["parameter_error_median"] == 0.0


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

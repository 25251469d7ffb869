"""The page of a diagnosis: whole, self-contained, small, and it says what was found."""

import math
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_samples import EXPERIMENT, sample
from matplotlib.colors import to_hex
from page_reader import PageReader, blank_html, loads_nothing

from tombo_bag.flight import Finding
from tombo_diagnosis.diagnosis import VERDICTS, Detectable, Diagnosis, Residual
from tombo_diagnosis.report.figures import LOG_FAULT, draw_channel
from tombo_diagnosis.report.page import check_items, diagnosis_page
from tombo_diagnosis.report.residual_data import by_channel
from tombo_flight.report.page import page_html


def diagnosis_html(diagnosis: Diagnosis, folder: str = "") -> str:
    return page_html(diagnosis_page(diagnosis, folder))


def html_of(diagnosis: Diagnosis, folder: str = "") -> str:
    """The page with blank pictures."""
    return blank_html(diagnosis_page(diagnosis, folder))


def text_of(diagnosis: Diagnosis, folder: str = "") -> str:
    return PageReader(html_of(diagnosis, folder)).text


@pytest.fixture(scope="module")
def html() -> str:
    return diagnosis_html(sample(), "runs/mine")


@pytest.mark.slow
def test_the_page_loads_nothing_and_runs_nothing(html):
    page = PageReader(html)
    loads_nothing(html, page)
    assert not [name for _, a in page.elements for name in a if name.startswith("on")]
    assert "script" not in {tag for tag, _ in page.elements}


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        ("named", ["The cause is linear rotor drag", "cause named"]),
        ("set", ["mass error or thrust coefficient error", "these flights can’t tell"]),
        ("none", ["The simulation agrees with these flights"]),
        ("unknown", ["Something is wrong that no known effect explains"]),
        ("partly_explained", ["Linear rotor drag is part of it; something else is left"]),
    ],
)
def test_every_verdict_has_its_words(verdict, words):
    assert verdict in VERDICTS
    text = text_of(sample(verdict))
    for expected in words:
        assert expected in text
    extended = verdict in ("named", "partly_explained")
    assert ("--model" in text) == extended
    assert (" less)" in text) == extended
    assert (EXPERIMENT.text in text) == (verdict == "set")
    assert ("held out from selection and fit" in text) == extended


@pytest.mark.slow
def test_a_crash_is_shown_with_its_time_and_marked_in_the_pictures(html):
    page = PageReader(html)
    assert "25.00–28.50" in page.text
    shown = sample()
    drawn = [draw_channel(shown, group) for group in by_channel(shown.residuals).values()]
    patches = [patch for picture in drawn for patch in picture.axes[0].patches]
    assert LOG_FAULT.lower() in {to_hex(patch.get_facecolor()) for patch in patches}


@pytest.mark.parametrize(
    "empty",
    [
        Diagnosis("unknown", (), (), None, (), (), (), (), (), math.nan, ""),
        Diagnosis(
            "unknown", (), (), None, (), (), (), (),
            (Residual("a", "x", "m", *(np.ones(1),) * 3, 0.0, {"v": np.ones(1)}),), 0.9, "One.",
        ),
    ],
)  # fmt: skip
def test_a_diagnosis_of_nearly_nothing_is_a_page(empty):
    assert empty.summary in text_of(empty)


@pytest.mark.slow
def test_the_page_of_many_flights_stays_small():
    assert len(diagnosis_html(sample(flights=20, seconds=100.0)).encode()) < 1_500_000


def test_candidates_say_from_which_size_on_they_would_have_been_seen():
    none = sample("none")
    least = {"mass_error": Detectable("fraction", "1", 0.0123), "motor_lag": None}
    scores = [replace(s, detectable=least.get(s.effect)) for s in none.candidates]
    text = text_of(replace(none, candidates=tuple(scores)))
    assert "would show from" in text and "fraction 1.2 %" in text


def test_what_several_flights_have_alike_is_one_line():
    flights = [f"circle_{k}" for k in range(1, 6)]
    alike = [Finding("gap", "warning", name, "position: silent") for name in flights]
    apart = Finding("crash", "fault", "circle_2", "accel: 2.5 g", 25.0, 28.5)
    info = Finding("stamps", "info", "circle_1", "stamps repeat")
    table, remarks = check_items([*alike, info, apart], "flight")
    assert [row[1].text for row in table.rows] == [
        "circle_2", "circle_1, circle_2, circle_3, 2 others",
    ]  # fmt: skip
    assert [row[2] for row in table.rows] == ["25.00–28.50 s", ""]
    assert remarks.title == "1 remark"
    assert table.rows[1][1].tooltip == ", ".join(flights)

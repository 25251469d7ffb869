"""YAML is read with its numbers, or refused in one line."""

import pytest

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.yaml_text import LARGEST, parse_yaml, read_yaml


def nine_levels(width=9):
    """Aliases that expand to 9^9 values."""
    rows = ["a0: &a0 [" + ", ".join(["x"] * width) + "]"]
    rows += [f"a{i}: &a{i} [" + ", ".join([f"*a{i - 1}"] * width) + "]" for i in range(1, 9)]
    return "\n".join(rows)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a: " + "[" * 100_000, "nested more than 40 deep"),
        (nine_levels(), "more than 200000 values"),
        ("a: &a [*a]", r"\*a stands within itself"),
        ("a: " + "9" * 5000, "a number of 5000 characters"),
        ("a: 1\nb: 2\na: 3", "line 3: key 'a' twice"),
        ("a: !!timestamp x", "does not fit its tag"),
        ("a: 2020-13-45", "does not fit its tag"),
        ("a: !!python/object/apply:os.system [id]", "could not determine a constructor"),
        ("a: \ud800", "surrogates"),
        ("a: 1\n--- \nb: 2", "expected a single document"),
        ("{a: 1", "line 1|line 2"),
        ("x" * (LARGEST + 1), "too large"),
    ],
    ids=lambda value: value[:20],
)
def test_bad_yaml_is_refused_in_one_line(text, why):
    with pytest.raises(InputError, match=why) as caught:
        parse_yaml(text, "file")
    assert len(str(caught.value)) < 300
    assert "\n" not in str(caught.value)


def test_good_yaml_is_read_as_ever():
    text = "a: 6e-05\nb: &b {x: 1, y: 1:30}\nc: {<<: *b, x: 2}\nd: *b\ne: 0x10\nf: 2026-01-01"
    read = parse_yaml(text, "file")
    assert read["a"] == 6e-5
    assert read["c"] == {"x": 2, "y": 90}
    assert read["d"] == {"x": 1, "y": 90}
    assert read["e"] == 16
    assert parse_yaml("", "file") is None
    assert parse_yaml("a: 1.50\nb: yes", "file", as_text=True) == {"a": "1.50", "b": "yes"}


def test_a_file_that_is_no_text_or_too_large_is_refused(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_bytes(b"\xff\xfe\x00a")
    with pytest.raises(InputError, match="is not text"):
        read_yaml(path, "x")
    path.write_bytes(b"a" * (LARGEST + 1))
    with pytest.raises(InputError, match="too large"):
        read_yaml(path, "x")
    with pytest.raises(InputError, match="can't be read"):
        read_yaml(tmp_path, "x")


def test_an_error_is_short_whatever_it_is_about():
    assert shown({"a": [1, 2.5], "b": None}) == "{'a': [1, 2.5], 'b': None}"
    assert len(shown("z" * 10**7)) <= 60
    assert len(str(unknown_name("key", "k" * 10**7, ["a" * 10**6, "b"] * 1000))) < 5000

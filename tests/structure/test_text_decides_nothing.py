"""No code reads the text of a message or a finding to decide: it has fields for that.

Found are comparisons of prose: a text with a space in it, looked for in another one, or any look
into the text of an error. Texts from outside, as PX4's status texts, are exempt.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

SRC = Path(__file__).parents[2] / "tombo_ws" / "src"
FROM_OUTSIDE = {
    # a benchmark that asks whether the message names the mistake
    "tombo_benchmarks/px4/wrong_axes.py",
    # play the person who reads a page and a terminal
    "tombo_benchmarks/px4/driver_node.py",
    # reads the texts of PX4
    "tombo_bringup/first_flight/checks.py",
    # the command line's own parser has no other sign
    "tombo_bringup/cli/errors.py",
}
METHODS = {"startswith", "endswith", "find", "index", "count"}
WRITTEN = {"text", "texts", "message", "messages"}
PROSE = re.compile(r"^ [a-z]|[A-Za-z]\S* +\S*[a-z]{2}")


def is_prose(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and bool(PROSE.search(str(node.value)))


def is_error_text(node: ast.AST) -> bool:
    """Whether a node is str(error)."""
    return (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "str"
        and any(isinstance(a, ast.Name) and a.id in ("error", "exc", "e") for a in node.args)
    )


def is_written(node: ast.AST) -> bool:
    """Whether a node is the text of a record: finding.message, sign.text."""
    return isinstance(node, ast.Attribute) and node.attr in WRITTEN


def decisions(tree: ast.AST) -> list[int]:
    """Return the lines on which text is read to decide."""
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            for op, right in zip(node.ops, node.comparators, strict=True):
                inside = isinstance(op, ast.In | ast.NotIn)
                if inside and (is_error_text(right) or is_prose(node.left)):
                    lines.append(node.lineno)
                elif inside and is_written(right):
                    lines += [] if isinstance(node.left, ast.Attribute) else [node.lineno]
                elif is_written(node.left) and is_prose(right):
                    lines.append(node.lineno)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            read = node.func.value
            if node.func.attr in METHODS and (
                is_error_text(read) or any(is_prose(a) for a in node.args)
            ):
                lines.append(node.lineno)
    return lines


def test_no_text_of_ours_is_read_to_decide():
    found = {
        str(path.relative_to(SRC)): lines
        for path in sorted(SRC.rglob("*.py"))
        if "test" not in path.parts and "/".join(path.parts[-3:]) not in FROM_OUTSIDE
        if (lines := decisions(ast.parse(path.read_text(encoding="utf-8"))))
    }
    assert not found


def test_what_reads_a_text_is_seen():
    for code in (
        "all(' reads 0' in text for text in texts)",
        '[line for line in findings if "can\'t be replayed" in line]',
        "any(name in str(error) for name in CHANNELS)",
        "[f for f in log.findings if name in f.message]",
        "text.startswith('it does not')",
    ):
        assert decisions(ast.parse(code)), code
    assert not decisions(ast.parse("'gyro' in series or text.startswith('#')"))

"""Does the steps of a first flight one after the other, and writes down what came of each."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tombo_bringup.first_flight.checks import Outcome, Session
from tombo_bringup.first_flight.steps import STEPS, Step
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.yaml_text import parse_yaml, read_text
from tombo_flight.yaml_file import check_keys, mapping_of, write_yaml, yaml_of

FILE = "first_flight.yaml"
_YES = "yes"
_ANSWERS = {True: _YES, False: "no"}
"""YAML reads yes and no as truth values."""


class Answers:
    """The answers of a person: those of a file, the others by a prompt."""

    def __init__(
        self, given: Mapping[str, Any], prompt: Callable[[str], str] | None = None
    ) -> None:
        """Take answers: step → answer, or a list of them for a step that asks more than once.

        Raises:
            InputError: there is no such step.
        """
        check_keys(given, [step.key for step in STEPS], "the answers")
        self._given = {
            key: list(value) if isinstance(value, list) else [value]
            for key, value in given.items()
        }
        self._prompt = prompt

    def ask(self, key: str, question: str) -> str:
        """Return the next answer of a step.

        Raises:
            InputError: there is neither an answer nor a terminal.
        """
        if self._given.get(key):
            answer = self._given[key].pop(0)
            return _ANSWERS.get(answer, str(answer)) if isinstance(answer, bool) else str(answer)
        if self._prompt is None:
            raise InputError(
                f"step {key}: no answer to '{question}'; accepted: --answers FILE with {key}, or a"
                " terminal"
            )
        return self._prompt(f"{key}: {question}")


def read_record(path: Path) -> dict[str, Any]:
    """Return key → entry of the steps that a file says are done; empty without a file.

    Raises:
        InputError: it is no such file.
    """
    if not path.exists():
        return {}
    label = f"'{path}'"
    values = mapping_of(parse_yaml(read_text(path, label), label), label)
    return dict(mapping_of(values.get("steps", {}), f"{label}: steps"))


def steps_to_do(record: Mapping[str, Mapping[str, Any]], first: str | None) -> list[Step]:
    """Return the steps from one on, or from the first that is not passed.

    Earlier steps are repeated if their result may have changed since.

    Raises:
        InputError: there is no such step, or one before it is not passed.
    """
    keys = [step.key for step in STEPS]
    if first is not None and first not in keys:
        raise unknown_name("step", first, keys)
    lacking = [key for key in keys if not record.get(key, {}).get("passed")]
    if not lacking and first is None:
        return []
    begin = keys.index(first or lacking[0])
    if lacking and keys.index(lacking[0]) < begin:
        raise InputError(f"--from {first}: step {lacking[0]} is not passed; accepted: --from it")
    before = [step for step in STEPS[:begin] if step.again]
    return [*before, *STEPS[begin:]]


def do_steps(session: Session, steps: Sequence[Step], record: dict[str, Any]) -> bool:
    """Do steps until one fails, and write each into the file; return whether all are passed.

    Raises:
        InputError: a question has no answer, or the vehicle is not there.
    """
    for number, step in enumerate(steps, 1):
        session.say(f"[{number}/{len(steps)}] {step.key}: {step.does or step.question}")
        outcome, answer = _do(step, session)
        record[step.key] = {
            "passed": not outcome.failure,
            "at": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
            "answer": answer,
            "said": outcome.failure or outcome.observation,
            "figures": dict(outcome.figures),
        }
        content = {"tombo_first_flight": 1, "lab": str(session.file), "steps": record}
        write_yaml(session.folder / FILE, yaml_of(content), f"'{session.folder / FILE}'")
        if outcome.failure:
            session.say(f"{step.key} FAILED: {outcome.failure}\nTo mend: {step.mend}")
            return False
        session.say(f"{step.key} passed: {outcome.observation or answer}")
    return True


def _do(step: Step, session: Session) -> tuple[Outcome, str]:
    """Do a step; return its outcome, and the answer to its question."""
    answer = session.ask(step.key, step.question) if step.question else ""
    if step.question and answer.strip().lower() not in (_YES, "y"):
        return Outcome(f"'{step.question}' was answered with '{answer}'"), answer
    return (Outcome("") if step.check is None else step.check(session)), answer

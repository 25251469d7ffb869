"""The tables of docs/safety.md (the controller's states, transitions) and docs/faults.md."""

from __future__ import annotations

from tombo_benchmarks.faults.fault_model import FAULT_TEXTS
from tombo_control.safety.state_machine import TABLE, SafetyState


def safety_tables() -> dict[str, str]:
    """Return the tables by the names of their markers."""
    return {"states": _states(), "transitions": _transitions(), "faults": _faults()}


def _states() -> str:
    lines = ["| state | what the controller commands |", "|---|---|"]
    lines += [f"| `{state.name.lower()}` | {state.command} |" for state in SafetyState]
    return "\n".join(lines) + "\n"


def _transitions() -> str:
    lines = ["| state | if | then |", "|---|---|---|"]
    for row in TABLE:
        state, then = row.state.name.lower(), row.then.name.lower()
        lines.append(
            f"| `{state}` | `{row.condition.name.lower()}`: {row.condition.text} | `{then}` |"
        )
    return "\n".join(lines) + "\n"


def _faults() -> str:
    lines = ["| fault | what happens |", "|---|---|"]
    lines += [f"| `{fault.name.lower()}` | {text} |" for fault, text in FAULT_TEXTS.items()]
    return "\n".join(lines) + "\n"

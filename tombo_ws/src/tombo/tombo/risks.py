"""The probability of a crash when settings are uncertain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tombo.flights import texts_of


def risk(
    scenario: str,
    given: Sequence[str] = (),
    flights: int = 4000,
    *,
    method: str = "adaptive",
    seed: int = 0,
    reaction: str | None = None,
    settings: Mapping[str, Any] | None = None,
    model: str | None = None,
    vehicle: str | None = None,
    workers: int | None = None,
    output: str | Path | None = None,
    progress: Callable[[int, float | None], None] | None = None,
) -> dict[str, Any]:
    """Say how probable a crash is when settings are uncertain: what `tombo risk` does.

    Args:
        scenario: a name of `tombo scenarios`, or a YAML file.
        given: uncertain settings, as "vehicle.mass~Normal(1.3,0.02)"; a key alone has its usual
            tolerance.
        flights: those of the search included.
        method: adaptive or monte-carlo.
        seed: all draws follow from it.
        reaction: name of the reaction to collisions, in place of the scenario's.
        settings: values of the scenario that are the same in all flights.
        model: a model.yaml, whose effects are laid over those of the scenario.
        vehicle: a name of `tombo vehicle list`, or a vehicle file.
        workers: processes; all cores if None.
        output: folder of risk.html, risk.json and flights.parquet; a study that was interrupted in
            it goes on. None: nothing is left on disk.
        progress: called with the number of flights done and the time left [s].

    Returns:
        probability (None: no crash was found), low, high, flights, and more (docs/risk.md).

    Raises:
        InputError: bad input, a package that is not installed, or another study in the folder.
    """
    from tombo_flight.risk.run import fly_risk, open_risk
    from tombo_flight.risk.study import new_risk

    fixed = [f"reaction={{name: {reaction}}}"] if reaction else []
    fixed += texts_of(dict(settings or {}))
    study = new_risk(scenario, given, flights, method, seed, fixed, model, vehicle)
    with ExitStack() as stack:
        folder = Path(output or stack.enter_context(TemporaryDirectory(prefix="tombo-")))
        opened = stack.enter_context(open_risk(folder, study))
        page = fly_risk(opened, workers=workers, progress=progress)
    assert page is not None  # nothing asks it to stop
    return dict(page.data)

"""Compiles and caches once what every command needs, so that the first flight starts at once.

`python -m tombo_bringup.warmup`; the set-up runs it whenever the compiled sources have changed.
"""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory


def warm_propeller() -> None:
    """Evaluate every law, of a soft and of the rigid propeller, and make the simulator's maps."""
    from tombo_dynamics.errors import InputError
    from tombo_dynamics.propeller import LAWS, configuration, evaluate, thrust_map, valid_speed

    for law in LAWS:
        for conf in (configuration(0), configuration(13)):
            evaluate(conf, [0.5 * valid_speed(conf, law)], law, outside="mask")
            thrust_map(conf, law=law)
        with suppress(InputError):  # the way to an error message is compiled code too
            evaluate(configuration(1), [1780.0], law)


def warm_flights() -> None:
    """Fly a moment with the whole autopilot, and go through the cores of all nodes."""
    from tombo_flight.flight_output import warm_up_flight
    from tombo_flight.run_wiring import warm_up_nodes
    from tombo_flight.scenario import load_scenario

    warm_up_flight(load_scenario())
    warm_up_nodes(load_scenario())


def warm_files() -> None:
    """Write the files of the default flight: reactions, message types, fonts, templates."""
    from tombo_flight.flight_output import fly_into
    from tombo_flight.process.output_folder import open_output
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_flight.scenario import load_scenario

    with TemporaryDirectory() as parent, open_output(Path(parent) / "o", replace=False) as folder:
        fly_into(folder, load_scenario(), 0, StopSignals())


def main() -> None:
    """Run all parts and print how long each takes."""
    for name, warm in (
        ("propeller model", warm_propeller),
        ("flight and nodes", warm_flights),
        ("recording, figure and report", warm_files),
    ):
        began = time.perf_counter()
        warm()
        print(f"{name}: {time.perf_counter() - began:.1f} s", flush=True)


if __name__ == "__main__":
    main()

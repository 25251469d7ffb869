"""Compiles and caches once what every command needs, so that the first flight starts at once.

`python -m tombo_bringup.warmup`; the set-up runs it whenever the compiled sources have changed.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory


def main() -> None:
    """Evaluate every law, of a soft and of the rigid propeller; go through the cores; fly once.

    The files of the flight are written, too: reactions, message types, fonts, templates.
    """
    from tombo_dynamics.errors import InputError
    from tombo_dynamics.propeller import LAWS, configuration, evaluate, thrust_map, valid_speed
    from tombo_flight.flight_output import fly_into, warm_up_flight
    from tombo_flight.process.output_folder import open_output
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_flight.run_wiring import warm_up_nodes
    from tombo_flight.scenario import load_scenario

    for law in LAWS:
        for conf in (configuration(0), configuration(13)):
            evaluate(conf, [0.5 * valid_speed(conf, law)], law, outside="mask")
            thrust_map(conf, law=law)
        with suppress(InputError):  # the way to an error message is compiled code too
            evaluate(configuration(1), [1780.0], law)
    scenario = load_scenario()
    warm_up_flight(scenario)
    warm_up_nodes(scenario)
    with TemporaryDirectory() as parent, open_output(Path(parent) / "o", replace=False) as folder:
        fly_into(folder, scenario, 0, StopSignals())


if __name__ == "__main__":
    main()

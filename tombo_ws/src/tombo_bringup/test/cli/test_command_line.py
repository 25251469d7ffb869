"""Printed command lines: in the shell's form, and that they can be run."""

import shlex

import pytest

from tombo_bringup.cli.main import application
from tombo_flight.command_line import command_line
from tombo_flight.scenario import load_scenario
from tombo_flight.sweep.design import SweepDesign, parse_axis
from tombo_flight.sweep.study import new_sweep


def parsed(line):
    """Return the values that the real parser reads from a command line."""
    import typer

    name, *words = shlex.split(line)
    assert name == "tombo"
    group = typer.main.get_command(application())
    command = group.commands[words[0]]
    return command.make_context(words[0], words[1:]).params


def test_every_value_comes_back_as_it_was():
    options = [("--seed", "3"), ("--model", "a b/model.yaml"), ("--vehicle", "fit's.yaml")]
    line = command_line(("fly", "my flight.yaml"), options, ["reaction={name: mine}"])
    values = parsed(line)
    assert (values["scenario"], values["seed"]) == ("my flight.yaml", 3)
    assert (values["model"], values["vehicle"]) == ("a b/model.yaml", "fit's.yaml")
    assert values["settings"] == ["reaction={name: mine}"]
    assert command_line(("fly",), [("--vehicle", ""), ("--model", None)]) == "tombo fly"


@pytest.mark.slow
def test_the_command_of_a_sweeps_flight_flies_its_scenario():
    axes = (parse_axis("vehicle.mass=1.2,1.3"), parse_axis("reaction.name=none,reflex"))
    study = new_sweep("collisions", SweepDesign(axes), range(2, 4), ("disturbances=true",))
    for flight in range(study.flights):
        values = parsed(study.command(flight))
        point, seed = study.place(flight)
        assert values["seed"] == seed
        flown = load_scenario(values["scenario"], values["settings"])
        assert flown == study.scenario_at(point)

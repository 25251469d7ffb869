"""What has been heard, or is to come: on any topic, and of a node's faults on /diagnostics."""

import time

from tombo_bag.topics import DIAGNOSTICS


def heard(world, spec, condition=lambda message: True, since=0, meanwhile=None, patience_s=60.0):
    """Return the first message on a topic, from the `since`th on, that meets a condition."""
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        world.hear()
        for message in world.heard[spec.name][since:]:
            if condition(message):
                return message
        if meanwhile is not None:
            meanwhile()
        time.sleep(0.002)
    raise AssertionError(f"no such message on {spec.name}")


def told(world, node, fault, since=0, meanwhile=None, text=""):
    """Return the first report of a node, from the `since`th on, with a fault and a text."""

    def texts(report):
        said = [s.message for s in report.status if s.name == node]
        return [s for s in said if f"{fault}:" in s and text in s]

    return texts(heard(world, DIAGNOSTICS, texts, since, meanwhile))[0]

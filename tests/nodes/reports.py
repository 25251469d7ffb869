"""Conditions on reports: on any topic, and of a node's faults on /diagnostics."""


def heard(world, spec, condition=lambda message: True, since=0, meanwhile=None):
    """Return the first message on a topic, from the `since`th on, that meets a condition."""
    return world.wait_for(spec, condition, meanwhile=meanwhile, since=since)


def finding(world, node, fault, since=0, meanwhile=None, text=""):
    """Return the first report of a node, from the `since`th on, with a fault and a text."""
    return world.wait_for_fault(node, fault, text, meanwhile=meanwhile, since=since)

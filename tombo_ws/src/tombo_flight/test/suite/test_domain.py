"""A private ROS_DOMAIN_ID, and DDS that stays on this machine."""

from __future__ import annotations

import pytest

from tombo_flight.suite.nodes import free_domain, local_discovery


def test_every_process_gets_one_from_1_to_101():
    assert {free_domain(pid, ()) for pid in range(500)} == set(range(1, 102))


def test_one_with_a_port_in_use_is_passed_over():
    wish = free_domain(40, ())
    assert free_domain(40, {7400 + 250 * wish + 11}) == wish + 1
    assert free_domain(40, {7400 + 250 * wish - 1, 53}) == wish
    every = {7400 + 250 * domain for domain in range(1, 102)}
    assert 1 <= free_domain(40, every) <= 101


RANGE, PROFILES = "ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTRTPS_DEFAULT_PROFILES_FILE"


@pytest.mark.parametrize(
    "given", [{}, {RANGE: "LOCALHOST"}, {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}]
)
def test_udp_on_the_loopback_interface_takes_the_place_of_shared_memory(given):
    chosen = local_discovery(given)
    assert chosen[RANGE] == "SUBNET" and chosen[PROFILES].endswith("loopback.xml")
    assert local_discovery({**given, **chosen}) == {}, "not stable"


def test_what_the_user_has_chosen_stays_and_never_leaves_the_machine_by_mistake():
    assert local_discovery({RANGE: "SUBNET"}) == {}
    assert local_discovery({RANGE: "OFF"}) == {}
    assert local_discovery({PROFILES: "/home/lab.xml"}) == {RANGE: "LOCALHOST"}
    assert local_discovery({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}) == {RANGE: "LOCALHOST"}

# SPDX-License-Identifier: Apache-2.0
"""A CAN channel that could leave a leg without commands is refused, with what to do."""

import pytest

from runtime.cli.fitness.buses import Link, check_channel, check_channels, check_kernel, check_loads, links
from runtime.cli.fitness.finding import Verdict

MEGABIT = 1_000_000
FIT = Link("can", True, "ERROR-ACTIVE", MEGABIT, 100, 128)


def described(**changes):
    """A channel as `ip -details -json link show` tells of it."""
    data = {
        "state": "ERROR-ACTIVE",
        "restart_ms": 100,
        "bittiming": {"bitrate": MEGABIT, "sample_point": 0.8},
    }
    return {
        "ifname": "can0",
        "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"],
        "operstate": "UP",
        "txqlen": 128,
        "link_type": "can",
        "linkinfo": {"info_kind": "can", "info_data": {**data, **changes}},
    }


def test_what_ip_tells_is_understood():
    loopback = {"ifname": "lo", "flags": ["LOOPBACK", "UP"], "txqlen": 1000, "link_type": "loopback"}
    found = links([loopback, described()])
    assert found == {"lo": Link("", True, queue_length=1000), "can0": FIT}


def test_a_controller_with_a_fixed_bit_rate_tells_it_elsewhere():
    one = described()
    del one["linkinfo"]["info_data"]["bittiming"]
    one["linkinfo"]["info_data"]["bittiming_bitrate"] = MEGABIT
    assert links([one]) == {"can0": FIT}


def test_a_channel_as_the_network_files_set_it_is_fit():
    finding = check_channel("can0", MEGABIT, FIT)
    assert (finding.verdict, finding.remedy) == (Verdict.OK, "")


@pytest.mark.parametrize(
    ("link", "verdict", "part"),
    [
        (None, Verdict.FAIL, "no such interface"),
        (FIT._replace(kind="ifb"), Verdict.FAIL, "not a CAN interface"),
        (FIT._replace(kind="vcan"), Verdict.WARN, "virtual"),
        (FIT._replace(bit_rate_hz=500_000), Verdict.FAIL, "500000"),
        (FIT._replace(up=False), Verdict.FAIL, "down"),
        (FIT._replace(up=False, bit_rate_hz=0), Verdict.FAIL, "0 bit/s"),
        (FIT._replace(state="BUS-OFF"), Verdict.FAIL, "off the bus"),
        (FIT._replace(restart_ms=0), Verdict.FAIL, "restart-ms"),
        (FIT._replace(queue_length=10), Verdict.WARN, "queues 10"),
        (FIT._replace(state="ERROR-PASSIVE"), Verdict.WARN, "ERROR-PASSIVE"),
    ],
)
def test_a_channel_that_is_not_fit_is_named_with_a_remedy(link, verdict, part):
    finding = check_channel("can3", MEGABIT, link)
    assert (finding.name, finding.verdict) == ("CAN can3", verdict)
    assert part in finding.sentence
    assert finding.remedy


def test_every_channel_is_looked_at():
    found = list(check_channels(["can0", "can1"], MEGABIT, {"can0": FIT}))
    assert [(finding.name, finding.verdict) for finding in found] == [
        ("CAN can0", Verdict.OK),
        ("CAN can1", Verdict.FAIL),
    ]


def test_without_ip_nothing_is_assumed():
    (finding,) = check_channels(["can0"], MEGABIT, None)
    assert (finding.verdict, finding.remedy) == (Verdict.FAIL, "install iproute2")


@pytest.mark.parametrize(("has_can", "verdict"), [(True, Verdict.OK), (False, Verdict.FAIL)])
def test_the_kernel_needs_can(has_can, verdict):
    assert check_kernel(has_can).verdict is verdict


@pytest.mark.parametrize(("load", "verdict"), [(0.85, Verdict.OK), (0.86, Verdict.FAIL)])
def test_the_fullest_bus_counts(load, verdict):
    assert check_loads([0.1, load, 0.2], 0.85).verdict is verdict

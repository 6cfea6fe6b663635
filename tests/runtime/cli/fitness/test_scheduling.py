# SPDX-License-Identifier: Apache-2.0
"""What keeps a loop from being woken on time is found, and said whose limit it is."""

import os

import pytest

from runtime.cli.fitness import scheduling
from runtime.cli.fitness.finding import Verdict
from runtime.cli.fitness.scheduling import Limits

ROOT, NOBODY = Limits("root", 99, -1), Limits("you", 0, 65536)
UNIT = Limits("ugv-control.service", 90, -1)


@pytest.mark.parametrize(
    ("refusal", "own", "unit", "verdict", "part"),
    [
        ("", ROOT, None, Verdict.OK, "granted to root"),
        ("refused", NOBODY, None, Verdict.FAIL, "refused to you"),
        ("refused", NOBODY, UNIT, Verdict.OK, "ugv-control.service may ask for priority 90"),
        ("", ROOT, UNIT._replace(priority=50), Verdict.FAIL, "ugv-control.service may ask for priority 50"),
        ("refused", ROOT, UNIT, Verdict.FAIL, "control group"),
        ("refused", Limits("you", 95, -1), None, Verdict.FAIL, "control group"),
    ],
)
def test_who_is_refused_priority_and_why(refusal, own, unit, verdict, part):
    finding = scheduling.check_priority(80, refusal, own, unit)
    assert finding.verdict is verdict
    assert part in finding.sentence
    assert bool(finding.remedy) == (verdict is not Verdict.OK)


@pytest.mark.parametrize(
    ("own", "unit", "verdict", "part"),
    [
        (ROOT, None, Verdict.OK, "root"),
        (NOBODY, None, Verdict.FAIL, "64 KiB"),
        (NOBODY, UNIT, Verdict.OK, "ugv-control.service"),
        (ROOT, UNIT._replace(locked_memory_bytes=8 << 20), Verdict.FAIL, "8192 KiB"),
    ],
)
def test_who_may_lock_memory(own, unit, verdict, part):
    finding = scheduling.check_memory(own, unit)
    assert finding.verdict is verdict
    assert part in finding.sentence


def test_the_limits_of_a_unit_are_read_as_systemctl_tells_them():
    told = {"LoadState": "loaded", "LimitRTPRIO": "90", "LimitMEMLOCK": "infinity"}
    assert scheduling.unit_limits(told) == UNIT
    assert scheduling.unit_limits({**told, "LoadState": "not-found"}) is None
    assert scheduling.unit_limits({}) is None


@pytest.mark.parametrize(
    ("runtime_us", "verdict"),
    [(-1, Verdict.OK), (950_000, Verdict.OK), (900_000, Verdict.OK), (500_000, Verdict.WARN), (0, Verdict.FAIL)],
)
def test_real_time_threads_need_most_of_the_time(runtime_us, verdict):
    assert scheduling.check_throttling(runtime_us, 1_000_000).verdict is verdict


@pytest.mark.parametrize(
    ("governors", "verdict"),
    [((), Verdict.OK), (("performance",), Verdict.OK), (("performance", "schedutil"), Verdict.WARN)],
)
def test_changing_clock_rates_are_a_warning(governors, verdict):
    assert scheduling.check_governors(governors).verdict is verdict


def test_who_may_keep_processors_awake(tmp_path):
    request = tmp_path / "cpu_dma_latency"
    assert scheduling.may_request(None, request) is None
    request.touch()
    assert scheduling.may_request(None, request)
    assert scheduling.may_request(UNIT, request) is False, "it belongs to another group"


@pytest.mark.parametrize(
    ("granted", "verdict", "part"),
    [
        (True, Verdict.OK, "ugv-control.service may keep them from sleeping deeply"),
        (False, Verdict.WARN, "ugv-control.service may not write to /dev/cpu_dma_latency"),
        (None, Verdict.OK, "takes no request"),
    ],
)
def test_processors_that_sleep_deeply_are_a_warning(granted, verdict, part):
    finding = scheduling.check_request(UNIT.whose, granted)
    assert finding.verdict is verdict
    assert part in finding.sentence
    assert bool(finding.remedy) == (verdict is Verdict.WARN)


@pytest.mark.parametrize(
    ("online", "wanted", "verdict"),
    [
        (range(8), (), Verdict.OK),
        (range(8), (2, 7), Verdict.OK),
        (range(2), (), Verdict.WARN),
        (range(8), (2, 8), Verdict.FAIL),
    ],
)
def test_configured_processors_have_to_exist(online, wanted, verdict):
    assert scheduling.check_processors(online, wanted).verdict is verdict


@pytest.mark.parametrize(("real_time", "verdict"), [(True, Verdict.OK), (False, Verdict.WARN)])
def test_another_kernel_than_a_real_time_one_is_a_warning(real_time, verdict):
    assert scheduling.check_preemption(real_time).verdict is verdict


def test_trying_a_priority_leaves_the_caller_as_it_was():

    assert scheduling.try_priority(1000).startswith("no SCHED_FIFO at priority 1000")
    scheduling.try_priority(1)
    assert os.sched_getscheduler(0) == os.SCHED_OTHER

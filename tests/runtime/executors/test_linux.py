# SPDX-License-Identifier: Apache-2.0
"""What Linux refuses is said in a sentence, and nobody is woken early."""

import os
import struct
import threading
import time

from runtime.executors.linux import Alarm, lock_memory, processors_awake, run_first, stay_on, unlock_memory


def in_a_thread(function, *arguments):
    """The answer of a call that changes its thread for good."""
    answers = []
    thread = threading.Thread(target=lambda: answers.append(function(*arguments)))
    thread.start()
    thread.join()
    return answers[0]


def test_nobody_is_woken_early():
    alarm = Alarm()
    for wait_ns in (-1_000_000_000, 0, 1, 1_000_000, 3_000_000):
        until_ns = time.monotonic_ns() + wait_ns
        alarm.sleep_until(until_ns)
        assert time.monotonic_ns() >= until_ns


def test_a_priority_that_does_not_exist_is_refused_in_a_sentence():
    assert in_a_thread(run_first, 1000).startswith(
        "no SCHED_FIFO at priority 1000, so threads run at normal priority ("
    )


def test_processors_that_do_not_exist_are_refused_in_a_sentence():
    assert in_a_thread(stay_on, {100_000}).startswith("no affinity to the processors [100000] (")
    assert in_a_thread(stay_on, os.sched_getaffinity(0)) == ""


def test_a_granted_priority_is_that_of_the_calling_thread_alone_and_a_refused_one_changes_nothing():
    refusal, policy = in_a_thread(lambda: (run_first(1), os.sched_getscheduler(0)))
    assert policy == (os.SCHED_OTHER if refusal else os.SCHED_FIFO)
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_memory_is_locked_or_the_refusal_is_said():
    try:
        refusal = lock_memory()
        assert not refusal or "page faults may delay a loop" in refusal
    finally:
        unlock_memory()


def test_processors_are_asked_to_wake_soon_and_the_request_is_a_number_as_the_kernel_wants_it(tmp_path):
    request = tmp_path / "cpu_dma_latency"
    request.touch()
    with processors_awake(20, request) as refusal:
        assert refusal == ""
    assert struct.unpack("=i", request.read_bytes()) == (20,)


def test_where_that_is_refused_it_is_said_and_the_loops_run_all_the_same(tmp_path):
    with processors_awake(0, tmp_path / "none") as refusal:
        assert refusal.startswith("processors may sleep deeply between ticks, and wake later for it (")

# SPDX-License-Identifier: Apache-2.0
"""Nothing that faces a wire is left out of the fuzzing, and a target that did nothing has not passed."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import campaign
import pytest
from fuzz_targets import TARGETS
from link_targets import message_seeds, receive, setup

from runtime.link import inputs, topics
from runtime.link.topic_input import FAULT, TopicInput
from runtime.robots.link_config import LinkConfig


def plain(decode):
    """The function that decodes, without what it is given besides the bytes."""
    return getattr(decode, "func", decode)


@pytest.mark.parametrize("localization_type", ["PoseStamped", "PoseWithCovarianceStamped"])
def test_every_decoder_that_the_link_subscribes_with_has_a_target(tmp_path, monkeypatch, localization_type):
    decoders = []

    class Noted(TopicInput):
        def __init__(self, topic, decode, *rest):
            decoders.append(plain(decode))
            super().__init__(topic, decode, *rest)

    monkeypatch.setattr(inputs, "TopicInput", Noted)
    config = LinkConfig(localization_type=localization_type)
    inputs.Inputs(config, inputs.records_of(setup().loops), tmp_path, 500.0).close()
    assert len(decoders) == 17
    assert set(decoders) <= {plain(target.decode) for target in TARGETS}


def test_the_seeds_of_the_whole_link_are_used_on_every_topic():
    told = [receive(seed) for seed in message_seeds()]
    assert [(topic, refused) for topic, refused in told if refused] == []
    assert {topic for topic, _ in told} == set(topics.TAKEN)


def test_a_message_over_which_the_link_stumbles_is_found(monkeypatch):
    (target,) = (target for target in TARGETS if target.name == "link")

    def stumble(self, *message):
        raise ZeroDivisionError

    monkeypatch.setattr(inputs.ImuUse, "__call__", stumble)
    with pytest.raises(AssertionError, match=f"{FAULT}: ZeroDivisionError"):
        target.decode(message_seeds()[0])


@pytest.mark.parametrize(
    ("told", "code", "result"),
    [
        ("stat::number_of_executed_units: 4711\n", 0, 0),
        ("stat::number_of_executed_units: 0\n", 0, 1),
        ("", 0, 1),
        ("stat::number_of_executed_units: 4711\n", 77, 1),
    ],
    ids=["passes", "no input", "no closing words", "a failure"],
)
def test_a_target_that_executed_nothing_fails(monkeypatch, capsys, tmp_path, told, code, result):
    monkeypatch.setattr("sys.argv", ["campaign.py", "bool", "--run", str(tmp_path)])
    monkeypatch.setattr(campaign, "sow", lambda *_: None)
    monkeypatch.setattr(campaign, "fuzz", lambda *_: subprocess.CompletedProcess([], code, told))
    assert campaign.main() == result
    assert ("failed: bool" in capsys.readouterr().out) == bool(result)


def test_the_memory_that_recording_takes_is_not_laid_to_the_fuzzers(monkeypatch):
    monkeypatch.setattr(campaign, "recorded", os.readlink)
    assert int(campaign.recorded_apart(Path("/proc/self"))) != os.getpid()

# SPDX-License-Identifier: Apache-2.0
"""A file is synced by somebody who may take his time; that it fails is told with the next request."""

import os
import threading
import time

import pytest

from runtime.recording.syncer import Syncer

PATIENCE_S = 60.0


def test_a_sync_that_fails_is_told_once():
    reading, writing = os.pipe()  # which cannot be synced
    try:
        syncer = Syncer(writing)
        deadline = time.monotonic() + PATIENCE_S
        with pytest.raises(OSError, match="Invalid argument"):
            while time.monotonic() < deadline:
                syncer.ask()
        syncer.close()
    finally:
        os.close(reading)
        os.close(writing)


def test_who_asks_does_not_wait_for_the_disk(tmp_path, monkeypatch):
    begun, go_on, done = threading.Event(), threading.Event(), []

    def slow(descriptor):
        begun.set()
        assert go_on.wait(PATIENCE_S)
        done.append(descriptor)

    monkeypatch.setattr(os, "fdatasync", slow)
    with open(tmp_path / "log", "wb") as file:
        syncer = Syncer(file.fileno())
        syncer.ask()
        assert begun.wait(PATIENCE_S)
        syncer.ask()
        assert not done
        go_on.set()
        syncer.close()
        assert done
        assert set(done) == {file.fileno()}


def test_a_failure_that_nobody_has_asked_for_is_told_at_the_end(monkeypatch):
    failed = threading.Event()

    def fail(descriptor):
        failed.set()
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fdatasync", fail)
    syncer = Syncer(0)
    syncer.ask()
    assert failed.wait(PATIENCE_S)
    failure = syncer.close()
    assert failure is not None
    assert failure.errno == 5
    assert syncer.close() is None

# SPDX-License-Identifier: Apache-2.0
"""The recorder in a process of its own: the same log, nothing lost, and its end is noticed."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from runtime.recording.bag import REALTIME
from runtime.recording.errors import LogError, RecordingError
from runtime.recording.log import Log
from runtime.recording.recorder import RecorderProcess


def bodies(run):
    return [(m.topic, m.sequence, bytes(m.body)) for m in Log(run).messages() if "/tick/" not in m.topic]


@pytest.mark.parametrize("options", [None, REALTIME])
def test_the_process_writes_what_the_sink_writes(toy, recorded, tmp_path, options):
    with RecorderProcess(tmp_path / "run", toy.setup(), *([options] if options else [])) as recorder:
        for datagram in toy.datagrams():
            recorder.write(datagram)
    assert recorder.path == tmp_path / "run" / "run_0.mcap"
    assert recorder.dropped == 0
    checksums_hold_wall_times = {"/ugv/checksum/fast", "/ugv/checksum/slow"}
    ours = [entry for entry in bodies(tmp_path / "run") if entry[0] not in checksums_hold_wall_times]
    assert ours == [entry for entry in bodies(recorded) if entry[0] not in checksums_hold_wall_times]
    assert (tmp_path / "run" / "metadata.yaml").exists()
    recorder.close()


def test_a_directory_that_cannot_be_written_is_named(toy, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match=r"cannot write a log in .*file/run: not a directory"):
        RecorderProcess(tmp_path / "file" / "run", toy.setup())


def send_until_refused(recorder, datagrams):
    """Send the same datagrams over and over until the recorder is found to have ended."""
    with pytest.raises(RecordingError) as caught:
        for _ in range(1000):
            for datagram in datagrams:
                recorder.write(datagram)
    return str(caught.value)


def test_after_a_kill_what_was_written_is_readable(toy, tmp_path):
    recorder = RecorderProcess(tmp_path / "run", toy.setup(), toy.small_chunks)
    datagrams = toy.datagrams()
    for datagram in datagrams:
        recorder.write(datagram)
    os.kill(recorder.pid, signal.SIGKILL)
    assert "run_0.mcap was killed by signal 9; the log holds what it had written" in send_until_refused(
        recorder, datagrams
    )
    with pytest.raises(RecordingError, match="killed by signal 9"):
        recorder.write(datagrams[0])
    recorder.close()


def test_a_killed_recorder_leaves_all_but_the_open_chunk(toy, tmp_path):
    recorder = RecorderProcess(tmp_path / "run", toy.setup(), toy.small_chunks)
    datagrams = toy.datagrams()
    for datagram in datagrams:
        recorder.write(datagram)
    written = 0
    while written < 200:
        with suppress(LogError):  # not yet one chunk
            written = len(Log(tmp_path / "run").read_signal("/ugv/tick/fast").values)
    os.kill(recorder.pid, signal.SIGKILL)
    send_until_refused(recorder, datagrams)
    log = Log(tmp_path / "run")
    assert log.truncated
    ticks = log.read_signal("/ugv/tick/fast").values["index"]
    assert np.array_equal(ticks, np.arange(len(ticks)))
    assert len(ticks) >= written


def test_a_write_error_ends_the_run_with_one_sentence(toy, tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    recorder = RecorderProcess(tmp_path / "run", toy.setup(), toy.small_chunks)
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (100_000, limits[1]))
    said = send_until_refused(recorder, toy.datagrams())
    assert said.startswith("cannot record any more in ")
    assert "run_0.mcap: file too large; the log is whole up to" in said
    log = Log(tmp_path / "run")
    assert len(log.read_signal("/ugv/tick/fast").values) > 20
    assert not log.damage


def test_the_log_is_closed_when_the_sender_dies(toy, tmp_path):
    script = tmp_path / "sender.py"
    script.write_text(
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from conftest import Toy\n"
        "from runtime.recording.recorder import RecorderProcess\n"
        "toy = Toy()\n"
        "recorder = RecorderProcess(Path(sys.argv[1]), toy.setup())\n"
        "for datagram in toy.datagrams():\n"
        "    recorder.write(datagram)\n"
        "print(recorder.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    environment = dict(os.environ, PYTHONPATH=":".join([*sys.path, str(Path(__file__).parent)]))
    sender = subprocess.Popen([sys.executable, script, tmp_path / "run"], stdout=subprocess.PIPE, env=environment)
    assert sender.stdout is not None
    with sender.stdout as output:
        assert int(output.readline()) > 0
        assert output.read() == b""
    assert sender.wait() == -signal.SIGKILL
    while not (tmp_path / "run" / "metadata.yaml").exists():
        os.sched_yield()
    log = Log(tmp_path / "run")
    assert not log.truncated
    assert len(log.read_signal("/ugv/tick/fast").values) == 250


def test_in_real_time_a_recorder_that_is_behind_costs_datagrams_not_time(toy, tmp_path):
    recorder = RecorderProcess(tmp_path / "run", toy.setup(), REALTIME, drop=True)
    os.kill(recorder.pid, signal.SIGSTOP)
    datagram = max(toy.datagrams(), key=len)
    sent = 0
    while not recorder.dropped:
        recorder.write(datagram)
        sent += 1
    os.kill(recorder.pid, signal.SIGCONT)
    recorder.close()
    assert recorder.dropped == 1
    assert len(Log(tmp_path / "run").read_signal("/ugv/tick/fast").values) == sent - 1

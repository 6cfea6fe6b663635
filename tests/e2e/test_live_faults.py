# SPDX-License-Identifier: Apache-2.0
"""Faults injected into a robot that walks in real time: on its wires, into its processes, beside them.

`make faults-live` tries all of them. How often this machine stalls is not ours to say: a trial beside a stall may show
nothing, and is not repeated here.
"""

import pytest

from runtime.robots import load_configuration
from sim_bridge.faults.live_judge import STALL_NS, judged, moved_unarmed
from sim_bridge.faults.live_logs import LiveLogs
from sim_bridge.faults.live_session import play
from sim_bridge.faults.live_table import LIVE_ROWS

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("realtime")]

TRIED = ("recorder killed", "malformed path", "link killed")


def test_faults_in_real_time_are_answered_as_the_table_says(tmp_path):
    rows = [next(row for row in LIVE_ROWS if row.name == name) for name in TRIED]
    told = []
    episodes = play(rows, 0, tmp_path, False, told.append)
    assert told == list(TRIED)
    logs = LiveLogs(tmp_path, {row.counted[0] for row in rows if row.counted}, STALL_NS)
    config = load_configuration("uslgo1")
    verdicts = [judged(episode, logs, config) for episode in episodes]
    assert [verdict for verdict in verdicts if verdict.flaws and not verdict.shows_nothing] == []
    assert moved_unarmed(logs) == []
    assert len(logs.bags) >= 2, "the recorder came back"

# SPDX-License-Identifier: Apache-2.0
"""Where no CAN interface can be made the buses are hubs, and the reason is told. With CAN: tests/guest."""

import pytest

from drivers.bus_socket import open_buses
from drivers.device_end import open_device_end
from drivers.opening import UNIX
from sim_bridge.live_buses import live_buses

BUSES = 4
REFUSING = "#!/bin/sh\necho 'RTNETLINK answers: Operation not permitted' >&2\nexit 2\n"


@pytest.fixture(params=["missing", "refusing"])
def reason(request, tmp_path, monkeypatch):
    """Why this machine cannot make an interface."""
    programs = tmp_path / "bin"
    programs.mkdir()
    monkeypatch.setenv("PATH", str(programs))
    if request.param == "missing":
        return "the program ip, of iproute2: no such file or directory"
    (programs / "ip").write_text(REFUSING)
    (programs / "ip").chmod(0o755)
    return "RTNETLINK answers: Operation not permitted"


def test_the_buses_are_hubs_and_the_note_says_why(reason, tmp_path):
    with live_buses(BUSES, tmp_path) as buses:
        assert buses.interface == UNIX
        assert buses.note == f"the buses are sockets, since here no CAN interface can be made ({reason})"
        far = open_device_end(buses.interface, buses.channels)
        near = open_buses(buses.interface, buses.channels)
        assert len(near) == BUSES
        for end in (*near, far):
            end.close()

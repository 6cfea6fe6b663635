# SPDX-License-Identifier: Apache-2.0
"""Opening buses: what cannot be opened is refused in one sentence, and a link that is down is waited for."""

from contextlib import closing

import pytest

from drivers import bus_socket
from drivers.bus_health import BusState
from drivers.bus_socket import RETRY_NS, BusSocket, open_buses
from drivers.can_frame import make_frames
from drivers.errors import DriverConfigError, LinkDownError
from drivers.opening import SOCKETCAN, UNIX, open_bus
from drivers.unix_hub import UnixHub


def test_if_one_bus_cannot_be_opened_none_is(tmp_path):
    hub = UnixHub(tmp_path / "can0")
    with pytest.raises(DriverConfigError, match="can1: no CAN hub at"):
        open_buses(UNIX, [str(hub.path), str(tmp_path / "can1")])
    assert hub.receive() == b""
    assert hub._ends == []
    hub.close()


def test_a_bus_whose_link_is_down_at_the_start_is_opened_when_it_is_up(tmp_path, monkeypatch):
    down = [LinkDownError("can0: is down")] * 2

    def opens_at_last(interface, channel):
        if down:
            raise down.pop()
        return open_bus(interface, channel)

    monkeypatch.setattr(bus_socket, "open_bus", opens_at_last)
    frame = make_frames([4], 8).tobytes()
    with closing(UnixHub(tmp_path / "can0")) as hub, closing(BusSocket(UNIX, str(hub.path))) as bus:
        assert (bus.health.state, bus.awaited) == (BusState.DOWN, "can0: is down")
        bus.send(frame, 0)
        assert bus.receive(8, RETRY_NS) == (b"", [])
        assert (bus.health.state, bus.health.failed) == (BusState.DOWN, 1)
        bus.receive(8, 2 * RETRY_NS)
        assert (bus.health.state, bus.awaited, bus.health.purged) == (BusState.UP, "", 0)
        bus.send(frame, 2 * RETRY_NS)
        assert hub.receive() == frame


def test_a_bus_that_never_came_up_is_left(monkeypatch):
    def down(interface, channel):
        raise LinkDownError("can0: is down")

    monkeypatch.setattr(bus_socket, "open_bus", down)
    BusSocket(UNIX, "can0").close()


def test_a_hub_that_hangs_does_not_hang_those_who_look_for_it(tmp_path):
    hub = UnixHub(tmp_path / "can0")
    opened = []
    with pytest.raises(DriverConfigError, match="can0: no CAN hub at"):
        for _ in range(100):
            opened += open_buses(UNIX, [str(hub.path)])
    for bus in opened:
        bus.close()
    hub.close()


@pytest.mark.parametrize("channel", ["nocan9", "a-name-longer-than-any-interface", "", "c\N{MICRO SIGN}n0"])
def test_an_interface_that_is_not_there_is_refused_in_one_sentence(channel):
    with pytest.raises(
        DriverConfigError, match=r"there is no such CAN interface|the kernel gives no CAN socket"
    ) as refused:
        open_buses(SOCKETCAN, [channel])
    assert "\n" not in str(refused.value)

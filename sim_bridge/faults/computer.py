# SPDX-License-Identifier: Apache-2.0
"""The robot's computer in virtual time: what is beside the control loops, for faults of processes, network and clocks.

Sensors and operator speak ROS over a network in memory to the link, whose code is that of the robot; control reads the
link's shared files; ticks go down streams that can be full, to link and recorder. All of it steps by the millisecond.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from drivers.bus_health import BusMonitor
from drivers.memory_bus import End
from drivers.memory_ports import MemoryReader, MemoryWriter
from runtime.configuration import dump
from runtime.executors.loop_run import InputPort
from runtime.executors.remembered_stop import RememberedStop
from runtime.executors.shared_ports import LatestPort
from runtime.executors.tick_stream import TickStreams
from runtime.link.loop import link_loop
from runtime.link.setup import link_setup
from runtime.recording.recorder_status import RecorderStatus
from runtime.recording.setup import recording_setup
from runtime.records import Record
from runtime.robots import topics
from runtime.robots.fresh_frames import FreshFrames
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.tasks import Loop
from sim_bridge.faults.ahead_bus import AheadBus
from sim_bridge.faults.virtual_clocks import VirtualClocks
from sim_bridge.faults.virtual_link import VirtualLink
from sim_bridge.faults.virtual_network import VirtualNetwork
from sim_bridge.faults.virtual_recorder import VirtualRecorder
from sim_bridge.faults.virtual_stream import VirtualStream
from sim_bridge.ros_messages import TYPES, RosMessages
from sim_bridge.run import Wired

STEP_NS = 1_000_000
CONTROL, LINK, RECORDER = "control", "link", "recorder"
SENSORS, OPERATOR = "ugv_sensors", "ugv_operator"
"""Sessions of the network beside the link's."""
_OF_OPERATOR = (topics.OPERATOR_EVENT, topics.PATH)
_OF_WIRES = (topics.CAN_RECEIVED, topics.BUS_STATUS, topics.TRUTH)


class Computer:
    """Advanced as the world of the control loops.

    Args:
        config: of the robot.
        wired: the robot and its world.
        seed: of the run, for the log.
        directory: the runtime directory.
        logs: directory for the bags.

    Attributes:
        clocks: of the computer.
        network: that sensors, operator and link are on.
        sources: ports of sensors and operator by topic, in the time of the world; what stands there can be broken.
        outputs: ports of the control loops.
        sink: takes their ticks.
        running: names of the processes that are there and do not stand still.
        recorders: what each recorder so far says of itself.
        written: datagrams that control and link made.
        dropped: datagrams that found no room on their way to the recorder.
        events: called with the time at every step, when the world has moved on and before anybody else does.
        watchers: called at every step of the world.
        held: what is let go when everything has ended.
    """

    def __init__(self, config: Uslgo1Config, wired: Wired, seed: int, directory: Path, logs: Path) -> None:
        self._world, self._directory, self.logs = wired.world, directory, logs
        self.clocks = VirtualClocks()
        self.network = VirtualNetwork(self.clocks)
        self.events: list[Callable[[int], None]] = []
        self.watchers: list[Callable[[], None]] = []
        self.held = ExitStack()
        self.running = {CONTROL}
        self._setup = link_setup(config)
        beside = link_loop(config.link, config.realtime.link_priority)
        self._recording = recording_setup(
            (*self._setup.loops, beside), config.robot, dump(config), seed, wired.robot.joint_names
        )
        self._ticks, self._link_ticks, self._to_link = VirtualStream(), VirtualStream(), VirtualStream()
        self.sink = TickStreams(self._ticks, self._to_link)
        self.recorders: list[RecorderStatus] = []
        self._recorder: VirtualRecorder | None = None
        self.link: VirtualLink | None = None
        self._told: RecorderStatus | None = None
        self._connect(config, wired)
        self.start_recorder()
        self.start_link()

    def _connect(self, config: Uslgo1Config, wired: Wired) -> None:
        self._bus = AheadBus(wired.bus, self.clocks)
        self.outputs = {topics.CAN_SENT: FreshFrames(MemoryWriter(self._bus), config.drives.command_age_max_ns)}
        self.sources = {topic: port for topic, port in wired.inputs.items() if topic not in _OF_WIRES}
        records = {record.topic: record for loop in wired.robot.loops for record in loop.port_inputs}
        self._said = [(topic, records[topic].like()) for topic in self.sources]
        self._messages = RosMessages(config.link)
        sessions = {name: self.network.join(name) for name in (SENSORS, OPERATOR)}
        self._publishers = {
            (name, topic): session.publisher(topic, type_name)
            for name, session in sessions.items()
            for topic, type_name in TYPES.items()
        }

    def control_inputs(self, loops: Sequence[Loop]) -> dict[str, InputPort]:
        """Ports of a control process that is being started; its sockets hold nothing that came before."""
        self._bus.receive(End.HOST, self.clocks.monotonic_ns)
        return {
            topics.CAN_RECEIVED: MemoryReader(self._bus),
            topics.BUS_STATUS: BusMonitor(self._bus.health),
            topics.TRUTH: self._world,
            **{topic: LatestPort(self._directory) for topic in self.sources},
            topics.OPERATOR_EVENT: RememberedStop(self._directory, loops, _refuse),
        }

    @property
    def written(self) -> int:
        """See above."""
        return self._ticks.written + self._link_ticks.written

    @property
    def dropped(self) -> int:
        """See above."""
        return self._ticks.dropped + self._link_ticks.dropped

    # -- time -----------------------------------------------------------------------------------------------------

    def advance(self, until_ns: int) -> None:
        """Let virtual time pass, for all but the control loops."""
        while self.clocks.monotonic_ns + STEP_NS <= until_ns:
            self.clocks.monotonic_ns += STEP_NS
            self._move_on()
            for event in self.events:
                event(self.clocks.monotonic_ns)
            self._speak()
            self._step(self.clocks.monotonic_ns)
        self._world.advance(until_ns + self.clocks.suspended_ns)

    def suspend(self, duration_ns: int) -> None:
        """Only the world goes on for a while; what sensors and operator say meanwhile, nobody hears."""
        for _ in range(duration_ns // STEP_NS):
            self.clocks.suspended_ns += STEP_NS
            self._move_on()
            self._heard()

    def _move_on(self) -> None:
        self._world.advance(self.clocks.world_ns)
        for watch in self.watchers:
            watch()

    def _heard(self) -> list[Record]:
        """What sensors and operator say now, in unix time."""
        heard = []
        for topic, record in self._said:
            if self.sources[topic].read(record, self.clocks.world_ns):
                record.stamp_ns = self.clocks.unix_ns(record.stamp_ns)  # type: ignore[attr-defined]
                heard.append(record)
        return heard

    def _speak(self) -> None:
        for record in self._heard():
            session = OPERATOR if record.topic in _OF_OPERATOR else SENSORS
            for topic, payload in self._messages.of(record):
                self._publishers[session, topic].put(payload)

    def _step(self, now_ns: int) -> None:
        if self.link is not None and LINK in self.running:
            self.link.step(now_ns)
        if self._recorder is not None and RECORDER in self.running:
            self._recorder.step(now_ns)
            self._told = self._recorder.told

    # -- processes ------------------------------------------------------------------------------------------------

    def start_link(self) -> None:
        """Start a link; control and recorder find it."""
        self._to_link.heard = True
        self.link = VirtualLink(
            self._setup, self.network, self._directory, self._to_link, self._link_ticks, lambda: self._told
        )
        self.running.add(LINK)

    def kill_link(self) -> None:
        """Kill it."""
        assert self.link is not None
        self.link.close()
        self.link = None
        self.running.discard(LINK)
        self._to_link.break_off()

    def start_recorder(self) -> None:
        """Start a recorder; control and link find it."""
        for stream in (self._ticks, self._link_ticks):
            stream.heard = True
        previous = "" if self._told is None else self._told.bag
        self._recorder = VirtualRecorder(self.logs, self._recording, self._received, self.clocks.read, previous)
        self.recorders.append(self._recorder.status)
        self.running.add(RECORDER)

    def kill_recorder(self) -> None:
        """Kill it."""
        assert self._recorder is not None
        self._recorder.kill()
        self._recorder = None
        self.running.discard(RECORDER)
        for stream in (self._ticks, self._link_ticks):
            stream.break_off()

    def _received(self) -> bytes | None:
        return self._ticks.take() or self._link_ticks.take()

    def stop(self, name: str) -> None:
        """Let a process stand still; what is sent to a link that does waits."""
        self.running.discard(name)
        if name == LINK:
            for session in (SENSORS, OPERATOR):
                self.network.cut(session)

    def go_on(self, name: str) -> None:
        """Let it go on."""
        self.running.add(name)
        if name == LINK:
            for session in (SENSORS, OPERATOR):
                self.network.mend(session)

    def close(self) -> None:
        """End everything in the order of the robot: control by now, then the link, then the recorder."""
        with self.held:
            if self.link is not None:
                self.link.close()
            if self._recorder is not None:
                self._recorder.close()


def _refuse(sentence: str) -> None:
    """What no control in virtual time may have to say."""
    raise AssertionError(sentence)

# SPDX-License-Identifier: Apache-2.0
"""The zenoh configurations for use over a network let through what they should, and nothing else."""

from __future__ import annotations

import json
import subprocess
import threading
from pathlib import Path

import pytest
import zenoh
import zenoh.ext

from runtime.messages import definitions
from runtime.messages.keys import TRANSIENT_LOCAL_QUALITY, data_key
from runtime.messages.session import RosSession, SessionError, session_config
from runtime.messages.standard import decode_string, encode_string
from sim_bridge.free_port import free_port

DEPLOY = Path(__file__).parents[2] / "deploy" / "zenoh"
TEXT = definitions.STRING
PATIENCE_S = 30.0
PASSWORDS = {"robot": "r0", "operator": "0p", "viewer": "v1"}


class Inbox:
    """What arrived on a topic."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self._news = threading.Condition()

    def receive(self, payload: bytes, attachment: bytes = b"") -> None:
        with self._news:
            self.texts.append(decode_string(payload))
            self._news.notify_all()

    def refuse(self, reason: str) -> None:
        raise AssertionError(reason)

    def wait_for(self, text: str, timeout_s: float = PATIENCE_S) -> bool:
        with self._news:
            return self._news.wait_for(lambda: text in self.texts, timeout_s)


def put_until(publisher, inbox: Inbox, text: str) -> None:
    """Send again and again, since a subscription takes its time to become known."""
    for _ in range(int(PATIENCE_S / 0.1)):
        publisher.put(encode_string(text))
        if inbox.wait_for(text, 0.1):
            return
    raise AssertionError(f"{text} did not arrive")


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """Certificates of the robot's authority, and of one that nobody knows."""
    directory = tmp_path_factory.mktemp("keys")
    for name in ("zenoh", "forged"):
        subprocess.run([DEPLOY / "make-certificates", directory / name, "localhost", "127.0.0.1"], check=True)
    users = "".join(f"{name}:{password}\n" for name, password in PASSWORDS.items())
    (directory / "zenoh" / "users.txt").write_text(users)
    return directory


class Site:
    """A robot with one of the shipped configurations, and those who come to it."""

    def __init__(self, keys: Path, directory: Path, kind: str) -> None:
        self.keys, self.directory, self.kind = keys, directory, kind
        self.loopback, self.network = free_port(), free_port()
        self.robot = RosSession("robot", 0, session_config([], [], self.file(f"robot-{kind}.json5")))
        self.commands, self.samples = Inbox(), Inbox()
        self.robot.subscribe("/operator/motion", TEXT, self.commands)
        self.robot.subscribe("/imu/data", TEXT, self.samples)
        self.tokens: list[str] = []
        self.robot.watch_publishers(lambda token, alive: self.tokens.append(token))
        self.state = self.robot.publisher("/ugv/state", TEXT)
        self.joints = self.robot.publisher("/joint_states", TEXT)
        self.robot.publisher("/robot_description", TEXT, TRANSIENT_LOCAL_QUALITY).put(encode_string("urdf"))

    def file(self, name: str, replacements: dict[str, str] | None = None) -> Path:
        """A shipped file with the paths and addresses of this test."""
        text = (DEPLOY / name).read_text()
        for before, after in {
            **(replacements or {}),
            "/etc/ugv/zenoh": str(self.keys / "zenoh"),
            "tcp/127.0.0.1:7447": f"tcp/127.0.0.1:{self.loopback}",
            "tls/0.0.0.0:7448": f"tls/127.0.0.1:{self.network}",
            "tls/robot.local:7448": f"tls/localhost:{self.network}",
        }.items():
            assert before in text or before.startswith("t"), f"{name} no longer says {before}"
            text = text.replace(before, after)
        path = self.directory / name
        path.write_text(text)
        return path

    def peer(self, name: str, authority: str = "zenoh", password: str | None = None) -> RosSession:
        """Somebody who comes by the network."""
        if self.kind == "tls":
            changes = {"/etc/ugv/zenoh/peer": str(self.keys / authority / name)}
        else:
            known = PASSWORDS.get(name, "") if password is None else password
            changes = {'user: "operator", password: "change-me"': f'user: "{name}", password: "{known}"'}
        return RosSession(name, 0, session_config([], [], self.file(f"peer-{self.kind}.json5", changes)))

    def sensor(self) -> RosSession:
        """Somebody on the robot itself."""
        config = session_config([], [f"tcp/127.0.0.1:{self.loopback}"])
        config.insert_json5("mode", json.dumps("client"))
        if self.kind == "users":
            config.insert_json5("transport/auth/usrpwd/user", json.dumps("robot"))
            config.insert_json5("transport/auth/usrpwd/password", json.dumps(PASSWORDS["robot"]))
        return RosSession("sensor", 0, config)


@pytest.fixture(params=["tls", "users"])
def site(request, keys, tmp_path):
    site = Site(keys, tmp_path, request.param)
    yield site
    site.robot.close()


@pytest.fixture
def tls_site(keys, tmp_path):
    site = Site(keys, tmp_path, "tls")
    yield site
    site.robot.close()


def test_an_operator_commands_and_sees_but_cannot_play_a_sensor(site):
    with site.peer("operator") as operator:
        seen = Inbox()
        operator.subscribe("/ugv/state", TEXT, seen)
        sensor, commands = operator.publisher("/imu/data", TEXT), operator.publisher("/operator/motion", TEXT)
        put_until(site.state, seen, "active")
        put_until(commands, site.commands, "walk")
        sensor.put(encode_string("forged"))
        put_until(commands, site.commands, "stand")
        assert site.samples.texts == []
        assert any("operator" in token for token in site.tokens), "it is part of the ROS graph"


def test_a_viewer_sees_but_commands_nothing(site):
    with site.peer("viewer") as viewer, site.peer("operator") as operator:
        seen = Inbox()
        viewer.subscribe("/ugv/state", TEXT, seen)
        put_until(site.state, seen, "active")
        viewer.publisher("/operator/motion", TEXT).put(encode_string("by the viewer"))
        put_until(operator.publisher("/operator/motion", TEXT), site.commands, "by the operator")
        put_until(site.state, seen, "still active")
        assert "by the viewer" not in site.commands.texts


def test_a_late_viewer_is_given_the_robot_s_description(site):
    with site.peer("viewer") as viewer:
        seen = Inbox()
        key = data_key(0, "/robot_description", TEXT)
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        subscriber = zenoh.ext.declare_advanced_subscriber(
            viewer._session, key, lambda sample: seen.receive(bytes(sample.payload)), history=history
        )
        assert seen.wait_for("urdf")
        subscriber.undeclare()


def test_sensors_on_the_robot_need_no_certificate(site):
    with site.sensor() as sensor:
        put_until(sensor.publisher("/imu/data", TEXT), site.samples, "sample")


def test_a_certificate_of_another_authority_is_refused(tls_site):
    with pytest.raises(SessionError, match="Unable to connect"):
        tls_site.peer("operator", authority="forged")


def test_without_a_certificate_nobody_comes_in(tls_site):
    text = tls_site.file("peer-tls.json5").read_text()
    lines = [line for line in text.splitlines() if "connect_certificate" not in line and "connect_private" not in line]
    path = tls_site.directory / "nameless.json5"
    path.write_text("\n".join(lines).replace("enable_mtls: true", "enable_mtls: false"))
    seen = Inbox()
    try:
        with RosSession("nameless", 0, session_config([], [], path)) as nameless:
            nameless.subscribe("/ugv/state", TEXT, seen)
            with tls_site.peer("viewer") as viewer:
                known = Inbox()
                viewer.subscribe("/ugv/state", TEXT, known)
                put_until(tls_site.state, known, "active")
    except SessionError:
        pass
    assert seen.texts == []


def test_a_wrong_password_is_refused(keys, tmp_path):
    site = Site(keys, tmp_path, "users")
    try:
        for name, password in (("operator", "wrong"), ("nobody", "0p"), ("viewer", PASSWORDS["operator"])):
            with pytest.raises(SessionError, match="Unable to connect"):
                site.peer(name, password=password)
    finally:
        site.robot.close()


def test_what_leaves_by_the_network_is_thinned_out(site):
    burst = 200
    with site.peer("viewer") as viewer, site.sensor() as local:
        far, near, far_state, near_state = Inbox(), Inbox(), Inbox(), Inbox()
        for session, joints, state in ((viewer, far, far_state), (local, near, near_state)):
            session.subscribe("/joint_states", TEXT, joints)
            session.subscribe("/ugv/state", TEXT, state)
        put_until(site.joints, far, "begin")
        put_until(site.joints, near, "begin")
        for _ in range(burst):
            site.joints.put(encode_string("burst"))
        put_until(site.state, far_state, "end")
        put_until(site.state, near_state, "end")
        assert far.texts.count("burst") < near.texts.count("burst") / 2


def test_the_script_keeps_what_is_there(keys):
    directory = keys / "zenoh"
    before = {path.name: path.read_bytes() for path in directory.glob("*.pem")}
    subprocess.run([DEPLOY / "make-certificates", directory, "localhost"], check=True)
    assert {path.name: path.read_bytes() for path in directory.glob("*.pem")} == before
    assert (directory / "robot.key").stat().st_mode & 0o077 == 0

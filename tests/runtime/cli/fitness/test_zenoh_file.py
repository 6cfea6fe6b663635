# SPDX-License-Identifier: Apache-2.0
"""A configuration of zenoh's own is judged by the rights of the units' user, and told apart from its passwords."""

import os
import pwd
import tempfile
from pathlib import Path

import pytest

from runtime.cli.fitness import zenoh_file
from runtime.cli.fitness.finding import Verdict
from runtime.cli.fitness.scheduling import Limits

UNIT = Limits("ugv-control.service", 90, -1)
SHIPPED = sorted((Path(__file__).parents[4] / "deploy" / "zenoh").glob("*.json5"))
USER, OTHERS, GROUP = 1234, 1235, 77


@pytest.fixture
def place():
    """A directory that everybody may enter."""
    with tempfile.TemporaryDirectory() as directory:
        Path(directory).chmod(0o755)
        yield Path(directory)


@pytest.mark.parametrize(
    ("mode", "owner", "group", "permitted"),
    [
        (0o400, USER, 0, True),
        (0o044, USER, GROUP, False),
        (0o040, OTHERS, GROUP, True),
        (0o404, OTHERS, GROUP, False),
        (0o004, OTHERS, 0, True),
        (0o640, OTHERS, 0, False),
    ],
)
def test_the_first_of_owner_group_and_others_that_is_meant_decides(mode, owner, group, permitted):
    status = os.stat_result((0o100000 | mode, 0, 0, 1, owner, group, 0, 0, 0, 0))
    assert zenoh_file.permits(status, USER, [GROUP], os.R_OK) is permitted


@pytest.mark.parametrize(("mode", "readable"), [(0o644, True), (0o600, False)])
def test_a_file_is_judged_by_the_units_user_whoever_asks(mode, readable, place, monkeypatch):
    file = place / "robot.json5"
    file.touch()
    file.chmod(mode)
    monkeypatch.setattr(zenoh_file, "USER", "nobody")
    assert zenoh_file.may_read(file, None), "the caller may read it"
    assert zenoh_file.may_read(file, UNIT) is readable


def test_a_directory_that_the_units_user_may_not_enter_hides_the_file(place, monkeypatch):
    file = place / "robot.json5"
    file.touch()
    file.chmod(0o644)
    monkeypatch.setattr(zenoh_file, "USER", "nobody")
    place.chmod(0o700)
    assert not zenoh_file.may_read(file, UNIT)


def test_nobody_reads_what_is_not_there_nor_a_user_who_is_not_there(place, monkeypatch):
    file = place / "robot.json5"
    monkeypatch.setattr(zenoh_file, "USER", pwd.getpwuid(os.getuid()).pw_name)
    assert not zenoh_file.may_read(file, UNIT)
    file.touch()
    monkeypatch.setattr(zenoh_file, "USER", "no-such-user")
    assert not zenoh_file.may_read(file, UNIT)


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.name)
def test_zenoh_takes_every_file_that_is_shipped(file):
    assert zenoh_file.read_refusal(file) == ""


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ('{ transport: { auth: { usrpwd: { user: "u" password: "secret" } } } }', ("line 1, column 40",)),
        ("{ transport: { auth: { usrpwd: { password: 5550123 } } } }", ("expected a string", "line 1")),
        ('{ transport: { auth: { usrpwd: "secret" } } }', ("expected struct", "line 1")),
        ('{\n mode: "secret" }', ("`peer`", "line 2")),
        ('{ transport: { auth: { usrpwd: { passwort: "secret" } } } }', ("`passwort`", "`password`", "line 1")),
        ('["secret"]', ("line 1, column 2",)),
        ("", ("Empty",)),
    ],
)
def test_what_zenoh_does_not_take_is_told_in_one_sentence_without_passwords(content, parts, place):
    file = place / "robot.json5"
    file.write_text(content)
    refusal = zenoh_file.read_refusal(file)
    assert all(part in refusal for part in (str(file), *parts)), refusal
    assert not any(word in refusal for word in ("secret", "5550123", "\n", ".rs")), refusal


@pytest.mark.parametrize(
    ("unit", "readable", "refusal", "opens", "verdict", "part"),
    [
        (UNIT, True, "", False, Verdict.OK, "is configured by"),
        (UNIT, False, "", False, Verdict.FAIL, "ugv-link.service, whose user is ugv"),
        (None, False, None, False, Verdict.FAIL, "by you"),
        (UNIT, True, None, False, Verdict.WARN, "not known"),
        (UNIT, True, "robot-tls.json5: not valid", False, Verdict.FAIL, "not valid"),
        (UNIT, True, "", True, Verdict.FAIL, "whoever does commands the robot"),
    ],
)
def test_a_configuration_of_zenoh_has_to_be_readable_and_zenohs_and_not_open(
    unit, readable, refusal, opens, verdict, part
):
    finding = zenoh_file.check_file(Path("/etc/ugv/zenoh/robot-tls.json5"), unit, readable, refusal, opens)
    assert (finding.verdict, bool(finding.remedy)) == (verdict, verdict is not Verdict.OK)
    assert all(word in finding.sentence for word in ("robot-tls.json5", part))


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.name)
def test_no_file_that_is_shipped_lets_everybody_in(file):
    assert not zenoh_file.is_open(file)


@pytest.mark.parametrize(
    ("listen", "access", "opens"),
    [
        ('["tcp/0.0.0.0:7447"]', "{}", True),
        ('["tcp/127.0.0.1:7447", "tls/[::]:7448"]', "{}", True),
        ('["tcp/127.0.0.1:7447", "tcp/[::1]:7448", "unixpipe//run/pipe"]', "{}", False),
        ('["tls/0.0.0.0:7448"]', '{ enabled: true, default_permission: "deny" }', False),
        ('["tls/0.0.0.0:7448"]', '{ enabled: true, default_permission: "allow" }', True),
        ('["tls/0.0.0.0:7448"]', '{ enabled: false, default_permission: "deny" }', True),
        ('{ peer: [], router: ["tcp/0.0.0.0:7447"] }', "{}", False),
        ('{ peer: ["tcp/robot.local:7447"] }', "{}", True),
    ],
)
def test_a_file_is_open_if_it_lets_other_hosts_in_and_denies_nothing(listen, access, opens, place):
    file = place / "robot.json5"
    file.write_text(f'{{ mode: "peer", listen: {{ endpoints: {listen} }}, access_control: {access} }}')
    assert zenoh_file.read_refusal(file) == ""
    assert zenoh_file.is_open(file) == opens

# SPDX-License-Identifier: Apache-2.0
"""Clocks, directories, endpoints and packages: what is wrong is told from what is only worse."""

import socket
import sys
from pathlib import Path

import pytest

from runtime.cli.fitness import clocks, endpoints, files, software
from runtime.cli.fitness.files import GIGABYTE, Directory
from runtime.cli.fitness.finding import Verdict

LOOPBACK = "tcp/127.0.0.1:7447"


@pytest.mark.parametrize(
    ("source", "resolution_s", "verdict"),
    [
        ("tsc", 1e-9, Verdict.OK),
        ("arch_sys_counter", 1e-9, Verdict.OK),
        ("acpi_pm", 1e-9, Verdict.WARN),
        ("", 1e-9, Verdict.WARN),
        ("jiffies", 4e-3, Verdict.FAIL),
    ],
)
def test_loops_sleep_by_a_fine_clock(source, resolution_s, verdict):
    assert clocks.check_source(source, resolution_s).verdict is verdict


@pytest.mark.parametrize(("synchronised", "verdict"), [(True, Verdict.OK), (False, Verdict.WARN)])
def test_a_date_that_nothing_keeps_right_is_a_warning(synchronised, verdict):
    assert clocks.check_date(synchronised).verdict is verdict


@pytest.mark.parametrize(
    ("free_bytes", "verdict"),
    [(100 * GIGABYTE, Verdict.OK), (5 * GIGABYTE, Verdict.WARN), (GIGABYTE - 1, Verdict.FAIL)],
)
def test_logs_need_room(free_bytes, verdict):
    assert files.check_room(Directory(Path("logs"), True, free_bytes)).verdict is verdict


@pytest.mark.parametrize(("writable", "verdict"), [(True, Verdict.OK), (False, Verdict.FAIL)])
def test_a_directory_has_to_be_writable(writable, verdict):
    finding = files.check_writable("log directory", Directory(Path("/logs"), writable, 0), "--log-dir")
    assert finding.verdict is verdict
    assert "/logs" in finding.sentence


def test_a_directory_that_would_be_made_is_judged_by_the_one_above_it_and_not_made(tmp_path):
    wanted = tmp_path / "a" / "b"
    found = files.read_directory(wanted)
    assert found.writable
    assert found.free_bytes > 0
    assert list(tmp_path.iterdir()) == []


def test_nothing_can_be_written_below_a_file(tmp_path):
    (tmp_path / "file").touch()
    assert not files.read_directory(tmp_path / "file" / "logs").writable


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        (LOOPBACK, "127.0.0.1", 7447),
        ("tls/robot.local:7447", "robot.local", 7447),
        ("tcp/[::]:7447#iface=eth0", "::", 7447),
        ("quic/0.0.0.0:1?a=b", "0.0.0.0", 1),
    ],
)
def test_endpoints_are_understood(text, host, port):
    assert endpoints.endpoint(text) == endpoints.Endpoint(host, port)


def test_what_is_no_port_is_no_endpoint():
    assert endpoints.endpoint("unixsock-stream//run/ugv/zenoh.sock") is None
    assert endpoints.endpoint("tcp/127.0.0.1") is None


@pytest.mark.parametrize(
    ("host", "loopback"),
    [
        ("127.0.0.1", True),
        ("127.1.2.3", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("robot", False),
    ],
)
def test_loopback_is_told_from_the_network(host, loopback):
    assert endpoints.is_loopback(host) is loopback


@pytest.mark.parametrize(
    ("text", "free", "running", "verdict"),
    [
        (LOOPBACK, True, False, Verdict.OK),
        (LOOPBACK, False, True, Verdict.OK),
        (LOOPBACK, False, False, Verdict.FAIL),
        ("tcp/0.0.0.0:7447", True, False, Verdict.FAIL),
        ("unixsock-stream//run/ugv/zenoh.sock", False, False, Verdict.OK),
    ],
)
def test_a_port_is_free_or_ours_and_not_open_to_everybody(text, free, running, verdict):
    (finding,) = endpoints.check_endpoints([text], [free], running)
    assert (finding.name, finding.verdict) == (f"zenoh {text}", verdict)


def test_a_port_that_is_listened_on_is_not_free():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        text = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        assert not endpoints.is_free(text)
    assert endpoints.is_free(text)


def test_pins_are_those_of_this_python():
    minor = sys.version_info.minor
    text = f'# versions\na==1.0\nb==1; python_version < "3.{minor}"\nb==2; python_version >= "3.{minor}"\n'
    assert software.pins(text) == {"a": "1.0", "b": "2"}


def test_the_pins_of_the_project_name_what_is_installed():
    pinned, installed = software.pins(software.read_constraints()), software.read_installed()
    assert set(software.read_required()) <= set(pinned) & set(installed)


@pytest.mark.parametrize(
    ("installed", "pinned", "verdict", "part"),
    [
        ({"a": "1"}, {"a": "1", "unused": "3"}, Verdict.OK, "2 versions"),
        ({"a": "2"}, {"a": "1"}, Verdict.WARN, "a 2 (tested: 1)"),
        ({"a": "1"}, {}, Verdict.WARN, "constraints.txt"),
        ({}, {"a": "1"}, Verdict.FAIL, "missing: a"),
    ],
)
def test_packages_are_there_in_the_versions_that_were_tested(installed, pinned, verdict, part):
    finding = software.check_packages(["a"], pinned, installed)
    assert finding.verdict is verdict
    assert part in finding.sentence


@pytest.mark.parametrize(("compiled", "verdict"), [(7, Verdict.OK), (0, Verdict.WARN), (None, Verdict.WARN)])
def test_loops_that_are_not_compiled_are_a_warning(compiled, verdict):
    assert software.check_kernels(compiled, 9, Path("kernels")).verdict is verdict


def test_kernels_of_an_empty_directory_are_not_compiled(tmp_path):
    compiled, sources = software.read_kernels(tmp_path)
    assert compiled == 0
    assert sources > 20

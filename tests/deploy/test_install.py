# SPDX-License-Identifier: Apache-2.0
"""The installer keeps what a person has edited, changes nothing the second time, and is undone by the uninstaller."""

import os
import re
import shutil
import stat
import subprocess
from pathlib import Path

import pytest

from runtime.robots import ROBOTS, configuration_file, load_configuration

ROOT = Path(__file__).parents[2]
CONFIGURATION, UNIT = "etc/ugv/uslgo1.toml", "etc/systemd/system/ugv-link.service"


class Staging:
    """A directory that is installed into, and a copy of the sources to install from."""

    def __init__(self, directory: Path) -> None:
        self.root, self.sources = directory / "root", directory / "sources"
        for part in ("deploy", "runtime/robots"):
            shutil.copytree(ROOT / part, self.sources / part)
        shutil.copy(ROOT / "constraints.txt", self.sources)

    def _run(self, script: Path, *options: str, code: int = 0, umask: int = 0o022) -> str:
        environment = {**os.environ, "DESTDIR": str(self.root)}
        done = subprocess.run(
            [script, *options], capture_output=True, text=True, check=False, env=environment, umask=umask
        )
        assert done.returncode == code, done.stderr
        return done.stdout + done.stderr

    def install(self, *options: str, code: int = 0, umask: int = 0o022) -> str:
        return self._run(self.sources / "deploy/install.sh", *options, code=code, umask=umask)

    def uninstall(self, *options: str) -> str:
        return self._run(self.root / "opt/ugv/uninstall.sh", *options)

    def tree(self) -> dict[str, tuple[int, bytes]]:
        """Mode and content of every file."""
        files = (path for path in self.root.rglob("*") if path.is_file())
        return {str(path.relative_to(self.root)): (path.stat().st_mode, path.read_bytes()) for path in files}


@pytest.fixture
def staging(tmp_path):
    return Staging(tmp_path)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_second_time_changes_nothing(staging, robot):
    staging.install("--robot", robot)
    once = staging.tree()
    told = staging.install()
    assert staging.tree() == once
    assert not any(word in told for word in ("new ", "updated", "kept", "removed"))


def test_uninstalling_leaves_nothing(staging):
    staging.install()
    staging.uninstall()
    assert staging.tree() == {}
    assert not (staging.root / "etc/ugv").exists()
    assert not (staging.root / "opt/ugv").exists()


@pytest.mark.parametrize("umask", [0o027, 0o077])
def test_the_units_user_reads_all_but_secrets_whatever_is_kept_from_others_by_who_installs(staging, umask):
    staging.install(umask=umask)
    closed = {path.name for path in staging.root.rglob("*") if not path.stat().st_mode & stat.S_IROTH}
    assert closed == {"peer-users.json5"}
    assert all(path.stat().st_mode & 0o777 == 0o755 for path in staging.root.rglob("*") if path.is_dir())


@pytest.mark.parametrize("path", [CONFIGURATION, UNIT])
def test_an_edited_file_is_kept_and_the_version_that_comes_is_put_beside_it(staging, path):
    staging.install()
    file = staging.root / path
    file.write_text("edited\n")
    assert f"kept     /{path}" in staging.install()
    assert not file.with_name(file.name + ".new").exists()
    source = next(staging.sources.glob(f"**/{file.name}"))
    source.write_text(source.read_text() + "# a later version\n")
    assert f"/{path}.new" in staging.install()
    assert (file.read_text(), file.with_name(file.name + ".new").read_bytes()) == ("edited\n", source.read_bytes())
    once = staging.tree()
    staging.install()
    assert staging.tree() == once


def test_a_file_that_nobody_edited_follows_the_sources(staging):
    staging.install()
    source = staging.sources / "deploy/systemd/ugv-link.service"
    source.write_text(source.read_text() + "# a later version\n")
    assert f"updated  /{UNIT}" in staging.install()
    assert (staging.root / UNIT).read_bytes() == source.read_bytes()


def test_what_is_no_longer_shipped_goes_unless_it_was_edited(staging):
    extra = staging.sources / "deploy/examples/extra.conf"
    extra.write_text("1\n")
    staging.install()
    installed = staging.root / "opt/ugv/examples/extra.conf"
    extra.unlink()
    staging.install()
    assert not installed.exists()
    extra.write_text("1\n")
    staging.install()
    installed.write_text("2\n")
    extra.unlink()
    staging.install()
    assert installed.read_text() == "2\n"


def test_uninstalling_keeps_what_was_edited_unless_told_to_purge(staging):
    staging.install()
    (staging.root / CONFIGURATION).write_text("edited\n")
    assert f"kept     /{CONFIGURATION}" in staging.uninstall()
    assert set(staging.tree()) == {CONFIGURATION}
    staging.install()
    assert (staging.root / CONFIGURATION).read_text() == "edited\n"
    staging.uninstall("--purge")
    assert staging.tree() == {}


def test_files_of_others_are_left_alone(staging):
    theirs = staging.root / "etc/systemd/system/ugv-link.service.d/lan.conf"
    theirs.parent.mkdir(parents=True)
    theirs.write_text("[Service]\n")
    staging.install()
    staging.uninstall("--purge")
    assert set(staging.tree()) == {"etc/systemd/system/ugv-link.service.d/lan.conf"}


def secrets(staging):
    """A key and passwords where a person puts them, as they come from `make-certificates` and an editor."""
    zenoh = staging.root / "etc/ugv/zenoh"
    for name, mode in (("robot.key", 0o600), ("users.txt", 0o644), ("robot.pem", 0o644), ("authority.pem", 0o644)):
        (zenoh / name).write_text("secret\n")
        (zenoh / name).chmod(mode)
    return zenoh


def test_keys_and_passwords_are_for_root_and_the_link_alone(staging):
    staging.install()
    zenoh = secrets(staging)
    staging.install()
    modes = {path.name: path.stat().st_mode & 0o777 for path in zenoh.iterdir()}
    assert {name for name, mode in modes.items() if mode == 0o640} == {"robot.key", "users.txt", "peer-users.json5"}
    assert not any(mode & 0o022 for mode in modes.values())


def test_what_is_said_of_keys_and_passwords_is_what_the_installer_does():
    for place in ("README.md", "zenoh/README.md", "zenoh/robot-users.json5", "zenoh/peer-users.json5"):
        text = (ROOT / "deploy" / place).read_text()
        assert "root:ugv" in text, place
        assert "0640" in text, place
    for place in ("README.md", "zenoh/README.md"):
        assert "users.txt" in (ROOT / "deploy" / place).read_text(), place


def test_purging_takes_keys_and_passwords_and_uninstalling_alone_does_not(staging):
    staging.install()
    zenoh = secrets(staging)
    assert "kept     /etc/ugv/zenoh/users.txt" in staging.uninstall()
    assert {path.name for path in zenoh.iterdir()} == {"robot.key", "users.txt", "robot.pem", "authority.pem"}
    staging.install()
    assert "removed  /etc/ugv/zenoh/robot.key" in staging.uninstall("--purge")
    assert staging.tree() == {}
    assert not zenoh.exists()


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_robot_can_be_installed(staging, robot):
    staging.install("--robot", robot)
    assert (staging.root / f"etc/ugv/{robot}.toml").read_bytes() == configuration_file(robot).read_bytes()
    assert f"UGV_ROBOT={robot}\n" in (staging.root / "etc/ugv/ugv.conf").read_text()


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_channels_have_the_bit_rate_of_the_robot(staging, robot):
    network = staging.root / "etc/systemd/network/60-ugv-can.network"
    staging.install("--robot", robot)
    bit_rate_hz = load_configuration(robot).drives.bit_rate_hz
    assert f"\nBitRate={bit_rate_hz}\n" in network.read_text()
    values = staging.root / f"etc/ugv/{robot}.toml"
    values.write_text(values.read_text().replace(f"bit_rate_hz = {bit_rate_hz}", "bit_rate_hz = 250_000  # slow"))
    staging.install()
    assert "\nBitRate=250000\n" in network.read_text()


def step_of_installer(name):
    """A function of the installer's, as text."""
    script = (ROOT / "deploy/install.sh").read_text()
    step = re.search(rf"^{name}\(\) \{{$.*?^\}}$", script, re.DOTALL | re.MULTILINE)
    assert step is not None
    return step[0]


def compile_loops(place, robot):
    """Run the installer's step that compiles, with a stand-in for what compiles; what it told."""
    stand_ins = """set -eu
        say() { printf '%s\\n' "$*"; }
        refuse() { exit 2; }
        install() { mkdir "$cache"; }
        setpriv() { for last; do :; done; printf 'compiled %s\\n' "$last"; }
        rehearsal=''
        """
    assignments = f"opt={place}/opt cache={place}/cache robot={robot}\n"
    command = ["sh", "-c", f"{stand_ins}{assignments}{step_of_installer('compile_loops')}\ncompile_loops"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_the_loops_are_compiled_once_for_each_robot_and_state(tmp_path):
    installed = tmp_path / "opt" / "venv" / ".installed"
    installed.parent.mkdir(parents=True)
    installed.write_text("one\n")
    assert "compiled uslgo1" in compile_loops(tmp_path, "uslgo1")
    assert compile_loops(tmp_path, "uslgo1") == ""
    assert "compiled 4ws4wd" in compile_loops(tmp_path, "4ws4wd")
    assert compile_loops(tmp_path, "4ws4wd") == ""
    installed.write_text("two\n")
    assert "compiled 4ws4wd" in compile_loops(tmp_path, "4ws4wd")


@pytest.mark.parametrize(
    ("states", "code"),
    [
        ("inactive inactive failed", 0),
        ("active active active", 2),
        ("activating inactive inactive", 2),
        ("inactive deactivating inactive", 2),
        ("inactive inactive reloading", 2),
        ("", 2),
    ],
)
def test_what_begins_ends_or_waits_to_be_started_again_runs(states, code):
    """As systemd tells the states of the three; it may also tell nothing."""
    stand_ins = """set -eu
        refuse() { exit 2; }
        systemctl() { for state in $states; do printf '%s\\n\\n' "$state"; done; [ -n "$states" ]; }
        """
    command = ["sh", "-c", f"{stand_ins}{step_of_installer('check_nothing_runs')}\ncheck_nothing_runs"]
    assert subprocess.run(command, env={**os.environ, "states": states}, check=False).returncode == code


def test_an_unknown_robot_and_an_unknown_option_are_refused(staging):
    assert "there is no robot uslgo2" in staging.install("--robot", "uslgo2", code=2)
    assert "usage:" in staging.install("--frobnicate", code=2)
    assert staging.tree() == {}

# SPDX-License-Identifier: Apache-2.0
"""The doctor looks at this host, changes nothing, and answers a program as well as a person."""

import json
from pathlib import Path

import pytest

from runtime.cli import doctor
from runtime.cli import main as cli
from runtime.cli.fitness.finding import Finding, Verdict, fail, ok, warn


def answer(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = cli.main(["doctor", *arguments])
    return code, capsys.readouterr().out


def test_findings_are_told_with_their_remedies() -> None:
    found = [ok("clock", "fine"), warn("disk", "full", "remove logs"), fail("kernel CAN", "none", "load it")]
    assert doctor.as_text(found, fit=False).splitlines() == [
        "ok    clock       fine",
        "warn  disk        full",
        "                  -> remove logs",
        "fail  kernel CAN  none",
        "                  -> load it",
        "this host is not fit to run",
    ]


@pytest.mark.parametrize(("verdict", "code"), [(Verdict.OK, 0), (Verdict.WARN, 0), (Verdict.FAIL, 2)])
def test_only_a_failure_forbids_to_run(
    verdict: Verdict, code: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "findings", lambda *arguments: iter([Finding("one", verdict, "is so", "do that")]))
    assert answer(capsys, "--json") == (
        code,
        json.dumps(
            {
                "fit": code == 0,
                "findings": [{"name": "one", "verdict": verdict.value, "sentence": "is so", "remedy": "do that"}],
            },
            indent=2,
        )
        + "\n",
    )


@pytest.mark.parametrize(
    ("robot", "channels"), [("uslgo1", {f"CAN can{bus}" for bus in range(4)}), ("4ws4wd", {"CAN can0"})]
)
def test_everything_is_looked_at_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], robot: str, channels: set[str]
) -> None:
    places = ["--runtime-dir", str(tmp_path / "run"), "--log-dir", str(tmp_path / "log")]
    code, told = answer(capsys, robot, "--json", *places)
    findings = {one["name"]: one for one in json.loads(told)["findings"]}
    assert {"real-time priority", "locked memory", "kernel CAN", "bus load", "disk"} <= set(findings)
    assert {name for name in findings if name.startswith("CAN ")} == channels
    assert all(bool(one["remedy"]) == (one["verdict"] != "ok") for one in findings.values())
    assert code == (2 if any(one["verdict"] == "fail" for one in findings.values()) else 0)
    assert list(tmp_path.iterdir()) == []


def test_without_a_robot_no_channel_is_missed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, told = answer(capsys, "--json", "--runtime-dir", str(tmp_path), "--log-dir", str(tmp_path))
    assert not any(one["name"].startswith(("CAN", "bus")) for one in json.loads(told)["findings"])


def test_buses_without_the_kernel_need_no_interfaces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = ["--runtime-dir", str(tmp_path), "--log-dir", str(tmp_path)]
    _, told = answer(capsys, "uslgo1", "--json", "--set", "drives.interface=ugv-unix", *places)
    names = [one["name"] for one in json.loads(told)["findings"]]
    assert "bus load" in names
    assert not any("CAN" in name for name in names)


def test_a_configuration_that_zenoh_does_not_take_forbids_to_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "robot.json5"
    file.write_text('{ mode: "secret" }')
    places = ["--runtime-dir", str(tmp_path), "--log-dir", str(tmp_path)]
    code, told = answer(capsys, "uslgo1", "--json", "--set", f"link.zenoh_config={file}", *places)
    (finding,) = [one for one in json.loads(told)["findings"] if one["name"] == "zenoh"]
    assert (code, finding["verdict"], "not a valid configuration of zenoh" in finding["sentence"]) == (2, "fail", True)
    assert "secret" not in told


def test_an_override_wants_something_to_override(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", "--set", "loops.wbc_hz=400"]) == 2
    assert "--set wants a robot" in capsys.readouterr().err

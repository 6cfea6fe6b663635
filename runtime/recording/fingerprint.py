# SPDX-License-Identifier: Apache-2.0
"""What must be alike for two machines to compute the same bits: processor features, numerical libraries, versions."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

_FEATURES = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512dq", "avx512vl", "asimd", "sve")
"""Instruction sets by which numerical libraries choose their kernels."""
_NUMERICAL = ("numpy", "pin", "eigenpy", "proxsuite", "daqp", "libpinocchio", "libcoal", "numba", "llvmlite")
_OTHERS = ("mujoco", "mcap", "rosbags", "msgspec", "python-can", "eclipse-zenoh", "ugv-runtime")


def _version(distribution: str) -> str | None:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def package_versions() -> dict[str, str]:
    """Versions of the packages that a run stands on, those that are installed."""
    versions = {"python": platform.python_version()}
    for name in (*_NUMERICAL, *_OTHERS):
        version = _version(name)
        if version is not None:
            versions[name] = version
    return versions


def _cpu_features() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return "unknown"
    for line in text.splitlines():
        if line.startswith(("flags", "Features")):
            present = set(line.partition(":")[2].split())
            return " ".join(name for name in _FEATURES if name in present)
    return "unknown"


def _blas() -> str:
    configuration: Any = np.show_config(mode="dicts")
    blas = configuration.get("Build Dependencies", {}).get("blas", {})
    return f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()


def fingerprint() -> dict[str, str]:
    """The fingerprint of this process."""
    marks = {
        "machine": platform.machine(),
        "cpu_features": _cpu_features(),
        "blas": _blas(),
        "libc": " ".join(platform.libc_ver()),
        "python": ".".join(str(part) for part in sys.version_info[:2]),
    }
    for name in _NUMERICAL:
        version = _version(name)
        if version is not None:
            marks[name] = version
    return marks


def differences(logged: Mapping[str, str], ours: Mapping[str, str]) -> list[str]:
    """One phrase for each mark that differs, as `numpy: 2.4.6 in the log, 2.2.6 here`."""
    return [
        f"{name}: {logged.get(name, 'absent')} in the log, {ours.get(name, 'absent')} here"
        for name in sorted({*logged, *ours})
        if logged.get(name) != ours.get(name)
    ]

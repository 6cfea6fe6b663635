# SPDX-License-Identifier: Apache-2.0
"""The file of zenoh's own that configures the link: may the link read it, does zenoh take it, whom does it let in."""

from __future__ import annotations

import json
import os
import pwd
from collections.abc import Collection
from pathlib import Path

from runtime.cli.fitness.endpoints import OPEN, UNIT, endpoint, is_loopback
from runtime.cli.fitness.finding import Finding, fail, ok, warn
from runtime.cli.fitness.scheduling import Limits

USER = "ugv"
"""Of the units."""
_NAME = "zenoh"


def permits(status: os.stat_result, user: int, groups: Collection[int], right: int) -> bool:
    """Whether the mode of a file gives a user who is in groups a right, such as `os.R_OK`."""
    shift = 6 if status.st_uid == user else 3 if status.st_gid in groups else 0
    return bool(status.st_mode >> shift & right)


def may_read(file: Path, unit: Limits | None) -> bool:
    """Whether the units' user, or without units the caller, may read a file and enter each directory above it."""
    if unit is None:
        return os.access(file, os.R_OK)
    try:
        account, real = pwd.getpwnam(USER), file.resolve(strict=True)
        groups = os.getgrouplist(USER, account.pw_gid)
        rights = [(real, os.R_OK), *((directory, os.X_OK) for directory in real.parents)]
        return all(permits(place.stat(), account.pw_uid, groups, right) for place, right in rights)
    except (KeyError, OSError):
        return False


def read_refusal(file: Path) -> str | None:
    """Why zenoh does not take a file, nothing if it does, None if the caller may not read it."""
    from runtime.messages.session import SessionError, session_config

    if not os.access(file, os.R_OK):
        return None
    try:
        session_config((), (), file)
    except SessionError as error:
        return str(error)
    return ""


def is_open(file: Path) -> bool:
    """Whether a file that zenoh takes lets other hosts in, and there do all that it does not forbid."""
    from runtime.messages.session import session_config

    config = session_config((), (), file)
    mode, access = json.loads(config.get_json("mode")), json.loads(config.get_json("access_control"))
    places = json.loads(config.get_json("listen/endpoints")) or []
    if isinstance(places, dict):
        places = places.get(mode) or []
    found = [endpoint(place) for place in places]
    reachable = any(place is not None and not is_loopback(place.host) for place in found)
    denies = access["enabled"] and access["default_permission"] == "deny"
    return reachable and not denies


def check_file(path: Path, unit: Limits | None, readable: bool, refusal: str | None, opens: bool) -> Finding:
    """The link can be configured by it.

    Args:
        path: of the file.
        unit: limits of the units, if they are installed.
        readable: by who runs the link.
        refusal: why zenoh does not take it, nothing if it does, None if that is not known.
        opens: whether anybody on another host may do anything.
    """
    if not readable:
        sentence = f"{path} cannot be read by {'you' if unit is None else f'{UNIT}, whose user is {USER}'}"
        return fail(_NAME, sentence, f"chown root:{USER} and chmod 640 it, or change link.zenoh_config")
    if refusal is None:
        sentence = f"whether zenoh takes {path} is not known, since you may not read it"
        return warn(_NAME, sentence, "run ugv doctor as root, or in the group ugv")
    if refusal:
        return fail(_NAME, refusal, "correct it; /etc/ugv/zenoh has files to begin with")
    if opens:
        remedy = "give it an access control that denies by default; /etc/ugv/zenoh has files to begin with"
        return fail(_NAME, f"by {path} {OPEN}", remedy)
    return ok(_NAME, f"is configured by {path}")

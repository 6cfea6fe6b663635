# SPDX-License-Identifier: Apache-2.0
"""Configurations: TOML text plus overrides in, a validated Struct out, or one sentence on what is wrong and where.

A schema is a `msgspec.Struct` whose fields carry their bounds (`Annotated[float, msgspec.Meta(gt=0, le=1000)]`) and, in
their names, their unit (`rate_hz`, `torque_nm`). A Struct may have a method `check()` that raises `ConfigError` where
values contradict each other; its message starts with the name of a field, which is completed to the full key here.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from runtime.configuration_flaws import find_flaw, one_line
from runtime.errors import ConfigError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

AnyConfig = TypeVar("AnyConfig", bound=msgspec.Struct)

OVERRIDE_PLACE = "--set"
"""What an override is called in a message, in the place of a file's name."""


def read(path: Path) -> str:
    """The text of a configuration file.

    Raises:
        ConfigError: if it cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path.name}: byte {error.start} is not UTF-8 text") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ConfigError(f"{one_line(str(path))}: cannot be read: {reason}") from None


def top_level(text: str, key: str, place: str) -> object:
    """The value of one key of a TOML text, None if it is missing."""
    return _parse(text, place).get(key)


def loads(text: str, schema: type[AnyConfig], *, place: str, overrides: Mapping[str, str] | None = None) -> AnyConfig:
    """Validate a configuration given as TOML text.

    The text has to be right by itself; then the overrides are applied, all of them, and the outcome is validated again.

    Args:
        text: TOML.
        schema: the Struct to make of it.
        place: what the text is called in messages.
        overrides: dotted keys and values as written on the command line; each replaces what the text says.

    Raises:
        ConfigError: one sentence with the place, the key, the value and the bound.
    """
    raw = _parse(text, place)
    config = _validated(raw, schema, place)
    if overrides:
        for key, value in overrides.items():
            _apply(raw, key, value)
        config = _validated(raw, schema, OVERRIDE_PLACE)
    return config


def dump(config: msgspec.Struct) -> str:
    """The configuration as TOML text, in the order of its declaration; `loads` makes an equal Struct of it."""
    import tomli_w

    return tomli_w.dumps(_without_none(msgspec.to_builtins(config)))


def parse_overrides(assignments: list[str]) -> dict[str, str]:
    """Split `KEY=VALUE` texts; the last one of a key counts.

    Raises:
        ConfigError: if one of them has no `=` or no key.
    """
    overrides = {}
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not equals or not key.strip():
            raise ConfigError(f"{OVERRIDE_PLACE} {one_line(assignment)!r}: wants KEY=VALUE")
        overrides[key.strip()] = value.strip()
    return overrides


def _parse(text: str, place: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ConfigError(f"{place}: is nested too deeply") from None
    except ValueError as error:
        where = re.search(r"\s*\(at (.*)\)$", str(error))
        reason = one_line(str(error)[: where.start()] if where else str(error))
        raise ConfigError(f"{place}: {where.group(1) + ': ' if where else ''}not valid TOML: {reason}") from None


def _validated(raw: dict[str, Any], schema: type[AnyConfig], place: str) -> AnyConfig:
    flaw = find_flaw(raw, schema)
    if flaw is not None:
        raise ConfigError(f"{place}: {one_line(flaw)}")
    try:
        config = msgspec.convert(raw, schema, strict=True)
    except (msgspec.ValidationError, OverflowError) as error:
        reason, _, at = str(error).partition(" - at `$")
        key = at.rstrip("`").strip(".").replace("[", ".").replace("]", "")
        raise ConfigError(f"{place}: {key + '.' if key else ''}{one_line(reason)}") from None
    _cross_check(config, place)
    return config


def _apply(raw: dict[str, Any], key: str, text: str) -> None:
    """Replace one value in place; tables that are missing on the way are created, so that they are found unknown."""
    *way, name = key.split(".")
    node: Any = raw
    for part in way:
        node = node.setdefault(part, {}) if isinstance(node, dict) else node[_index(node, part, key)]
    if isinstance(node, dict):
        node[name] = _value(text)
    else:
        node[_index(node, name, key)] = _value(text)


def _index(node: Any, part: str, key: str) -> int:
    """The place of an entry in a list."""
    if not isinstance(node, list):
        raise ConfigError(f"{OVERRIDE_PLACE}: {one_line(key)} is unknown; {one_line(repr(node))} has no {part!r}")
    if not (part.isascii() and part.isdigit() and len(part) < 10 and int(part) < len(node)):
        raise ConfigError(f"{OVERRIDE_PLACE}: {one_line(key)} is unknown; the list has {len(node)} entries, from 0")
    return int(part)


def _value(text: str) -> Any:
    """A value as TOML would read it; text that is no TOML value stands for itself."""
    if "\n" in text or "\r" in text:
        return text
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    value = parsed["value"]
    return value if isinstance(value, (bool, int, float, str, list, dict)) else text


def _cross_check(node: Any, place: str, key: tuple[str, ...] = ()) -> None:
    """Call `check()` of every Struct, innermost first."""
    for name, child in _children(node):
        _cross_check(child, place, (*key, name))
    check = getattr(node, "check", None) if isinstance(node, msgspec.Struct) else None
    if callable(check):
        try:
            check()
        except ConfigError as error:
            prefix = "".join(part + "." for part in key)
            raise ConfigError(f"{place}: {prefix}{one_line(str(error))}") from None


def _children(node: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(node, msgspec.Struct):
        for field in msgspec.structs.fields(node):
            yield field.encode_name, getattr(node, field.name)
    elif isinstance(node, Mapping):
        yield from ((str(name), child) for name, child in node.items())
    elif isinstance(node, (list, tuple)):
        yield from ((str(index), child) for index, child in enumerate(node))


def _without_none(node: Any) -> Any:
    """TOML has no null: what is None is left out, and is None again when read."""
    if isinstance(node, dict):
        return {key: _without_none(value) for key, value in node.items() if value is not None}
    if isinstance(node, (list, tuple)):
        return [_without_none(value) for value in node]
    return node

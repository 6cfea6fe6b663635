# SPDX-License-Identifier: Apache-2.0
"""Finds the first thing that is wrong with a configuration and says it in one sentence.

The walk goes through the schema in the order of its declaration, so the same text always gives the same sentence.
"""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect

UNITS = {
    "hz": "Hz", "khz": "kHz", "rad": "rad", "deg": "degrees", "radps": "rad/s", "degps": "degrees/s", "rpm": "rpm",
    "radps2": "rad/s^2", "m": "m", "mm": "mm", "cm": "cm", "km": "km", "mps": "m/s", "kmh": "km/h", "mps2": "m/s^2",
    "n": "N", "kn": "kN", "nm": "N.m", "ns": "ns", "us": "us", "ms": "ms", "s": "s", "min": "minutes", "degc": "degC",
    "k": "K", "v": "V", "mv": "mV", "a": "A", "ma": "mA", "w": "W", "kg": "kg", "g": "g", "kg_m2": "kg.m^2",
    "bps": "bit/s", "kbps": "kbit/s", "mbps": "Mbit/s", "pct": "%",
}  # fmt: skip
"""What the last part of a key's name says about its unit."""

_LONGEST_NUMBER = 1 << 63
_NUMBER_WITH_UNIT = re.compile(r"\s*[-+]?(\d[\d_]*\.?\d*|\.\d+)([eE][-+]?\d+)?\s*[^\d\s].*", re.ASCII)

_Key = tuple[str, ...]


def find_flaw(raw: dict[str, Any], schema: type[msgspec.Struct]) -> str | None:
    """The first flaw of a parsed configuration, as a sentence that starts with the key; None if there is none."""
    return next(_flaws(raw, inspect.type_info(schema), ()), None)


def one_line(text: str) -> str:
    """Text that someone gave, made fit for a message of one line."""
    clean = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    return clean if len(clean) <= 300 else clean[:297] + "..."


def unit_of(name: str) -> str:
    """The unit that a key's name carries as its suffix, or ''."""
    return UNITS.get(_split(name)[1], "")


def _flaws(value: Any, wanted: inspect.Type, key: _Key) -> Iterator[str]:
    if isinstance(wanted, inspect.Metadata):
        yield from _flaws(value, wanted.type, key)
    elif isinstance(wanted, inspect.UnionType):
        yield from _union_flaws(value, wanted, key)
    elif isinstance(wanted, inspect.StructType):
        yield from _struct_flaws(value, wanted, key)
    elif isinstance(wanted, inspect.DictType):
        if isinstance(value, dict):
            for name, entry in value.items():
                yield from _flaws(entry, wanted.value_type, (*key, name))
        else:
            yield f"{_dotted(key)} = {_shown(value)} is {_kind(value)}, wants a table"
    elif isinstance(wanted, (inspect.IntType, inspect.FloatType)):
        yield from _number_flaws(value, wanted, key)
    elif isinstance(wanted, (inspect.ListType, inspect.VarTupleType, inspect.TupleType)):
        yield from _list_flaws(value, wanted, key)
    else:
        yield from _other_flaws(value, wanted, key)


def _struct_flaws(value: Any, wanted: inspect.StructType, key: _Key) -> Iterator[str]:
    if not isinstance(value, dict):
        yield f"{_dotted(key)} = {_shown(value)} is {_kind(value)}, wants a table"
        return
    fields = {field.encode_name: field for field in wanted.fields}
    for name in value:
        if name not in fields and name != wanted.tag_field:
            yield f"{_dotted((*key, name))} is unknown" + _advice(name, list(fields), key)
    for name, field in fields.items():
        if name in value:
            yield from _flaws(value[name], field.type, (*key, name))
        elif field.required:
            yield f"{_dotted((*key, name))} is missing"


def _union_flaws(value: Any, wanted: inspect.UnionType, key: _Key) -> Iterator[str]:
    """A value has to suit one of the alternatives; the flaw that is told is that of the most promising one."""
    alternatives = [kind for kind in wanted.types if not isinstance(kind, inspect.NoneType)]
    found = [next(_flaws(value, kind, key), None) for kind in alternatives]
    flaws = [flaw for flaw in found if flaw is not None]
    if len(flaws) < len(found):
        return
    tagged = [
        flaw
        for flaw, kind in zip(flaws, alternatives, strict=True)
        if isinstance(kind, inspect.StructType) and isinstance(value, dict) and value.get(kind.tag_field) == kind.tag
    ]
    yield (tagged or flaws)[0]


def _number_flaws(value: Any, wanted: inspect.IntType | inspect.FloatType, key: _Key) -> Iterator[str]:
    whole = isinstance(wanted, inspect.IntType)
    noun = "a whole number" if whole else "a number"
    unit = unit_of(next((part for part in reversed(key) if not part.isdigit()), ""))
    said = f"{_dotted(key)} = {_shown(value)}"
    if isinstance(value, str) and _NUMBER_WITH_UNIT.fullmatch(value):
        yield f"{said} is text with a unit; write the number alone" + (f", in {unit}" if unit else "")
    elif isinstance(value, bool) or not isinstance(value, (int, float)):
        yield f"{said} is {_kind(value)}, wants {noun}" + (f" in {unit}" if unit else "")
    elif isinstance(value, float) and not math.isfinite(value):
        yield f"{said} is not finite"
    elif whole and isinstance(value, float) and not value.is_integer():
        yield f"{said} is not a whole number"
    elif abs(value) >= _LONGEST_NUMBER and isinstance(value, int):
        yield f"{said} is too large"
    else:
        yield from _bound_flaws(value, wanted, said)


def _bound_flaws(value: float, wanted: inspect.IntType | inspect.FloatType, said: str) -> Iterator[str]:
    if wanted.ge is not None and value < wanted.ge:
        yield f"{said} is below {_shown(wanted.ge)}"
    elif wanted.gt is not None and value <= wanted.gt:
        yield f"{said} is not above {_shown(wanted.gt)}"
    elif wanted.le is not None and value > wanted.le:
        yield f"{said} is above {_shown(wanted.le)}"
    elif wanted.lt is not None and value >= wanted.lt:
        yield f"{said} is not below {_shown(wanted.lt)}"
    elif wanted.multiple_of is not None and value % wanted.multiple_of != 0:
        yield f"{said} is not a multiple of {_shown(wanted.multiple_of)}"


def _list_flaws(
    value: Any, wanted: inspect.ListType | inspect.VarTupleType | inspect.TupleType, key: _Key
) -> Iterator[str]:
    said = f"{_dotted(key)} = {_shown(value)}"
    if not isinstance(value, list):
        yield f"{said} is {_kind(value)}, wants a list"
        return
    if isinstance(wanted, inspect.TupleType):
        kinds = wanted.item_types
        shortest = longest = len(kinds)
    else:
        kinds = (wanted.item_type,) * len(value)
        shortest = wanted.min_length or 0
        longest = len(value) if wanted.max_length is None else wanted.max_length
    if not shortest <= len(value) <= longest:
        wants = f"at least {shortest}" if len(value) < shortest else f"at most {longest}"
        yield f"{said} has {_entries(len(value))}, wants {longest if shortest == longest else wants}"
        return
    for index, (entry, kind) in enumerate(zip(value, kinds, strict=True)):
        yield from _flaws(entry, kind, (*key, str(index)))


def _other_flaws(value: Any, wanted: inspect.Type, key: _Key) -> Iterator[str]:
    """Text, truth values and choices."""
    said = f"{_dotted(key)} = {_shown(value)}"
    if isinstance(wanted, inspect.BoolType):
        if not isinstance(value, bool):
            yield f"{said} is {_kind(value)}, wants true or false"
    elif isinstance(wanted, (inspect.LiteralType, inspect.EnumType)):
        values = wanted.values if isinstance(wanted, inspect.LiteralType) else tuple(e.value for e in wanted.cls)
        if not any(value == choice and type(value) is type(choice) for choice in values):
            close = difflib.get_close_matches(str(value), [str(choice) for choice in values], 1)
            hint = f"; did you mean {close[0]}?" if close else ""
            yield f"{said} is not one of {', '.join(str(choice) for choice in values)}{hint}"
    elif isinstance(wanted, inspect.StrType):
        if not isinstance(value, str):
            yield f"{said} is {_kind(value)}, wants text in quotes"
        elif wanted.min_length is not None and len(value) < wanted.min_length:
            yield f"{said} is shorter than {wanted.min_length} characters"
        elif wanted.max_length is not None and len(value) > wanted.max_length:
            yield f"{said} is longer than {wanted.max_length} characters"
        elif wanted.pattern is not None and not re.search(wanted.pattern, value):
            yield f"{said} does not look like {wanted.pattern}"


def _split(name: str) -> tuple[str, str]:
    """A key's name without its unit, and the unit's suffix or ''."""
    parts = name.split("_")
    for length in (2, 1):
        suffix = "_".join(parts[-length:])
        if len(parts) > length and suffix in UNITS:
            return "_".join(parts[:-length]), suffix
    return name, ""


def _advice(name: str, known: list[str], key: _Key) -> str:
    """What may have been meant by an unknown key."""
    stem, suffix = _split(name)
    for other in known:
        other_stem, other_suffix = _split(other)
        if other_stem == stem and other_suffix:
            given = f", not {UNITS[suffix]}" if suffix else ""
            return f"; did you mean {_dotted((*key, other))}? It wants {UNITS[other_suffix]}{given}"
    close = difflib.get_close_matches(name, known, 1)
    if close:
        return f"; did you mean {_dotted((*key, close[0]))}?"
    return f"; known there: {', '.join(known)}" if known else ""


def _dotted(key: _Key) -> str:
    return ".".join(key) or "the configuration"


def _entries(count: int) -> str:
    return "1 entry" if count == 1 else f"{count} entries"


def _kind(value: Any) -> str:
    """What a TOML value is, in words."""
    if isinstance(value, bool):
        return "a truth value"
    for kind, words in ((dict, "a table"), (list, "a list"), (str, "text"), (int, "a number"), (float, "a number")):
        if isinstance(value, kind):
            return words
    return "a date or time"


def _shown(value: Any) -> str:
    """A value as TOML writes it, cut short."""
    if isinstance(value, int) and abs(value) >= _LONGEST_NUMBER:
        return f"{float(value):g}" if abs(value) < 10**300 else "a number of over 300 digits"
    if isinstance(value, float):
        return f"{value:.0f}" if value.is_integer() and abs(value) < 1e15 else repr(value)
    try:
        text = json.dumps(value, ensure_ascii=False)
    except (TypeError, ValueError, RecursionError):
        text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."

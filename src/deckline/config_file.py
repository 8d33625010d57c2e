"""Nested frozen dataclasses as TOML files: one table a dataclass, one key a field; and as JSON values."""

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from deckline.files import MOST_CONFIG_BYTES, parse_toml, read_regular

T = TypeVar("T")
NONE = "none"  # TOML has no null
LEAST_LIKENESS = 0.5  # of a wrong key and the key that its error names, 0..1; difflib's own default is 0.6


def read_config(cls: type[T], path: Path, base: T | None = None) -> T:
    """A configuration from a TOML file; keys that the file leaves out have the values of `base`.

    Args:
        cls: a dataclass. Its fields are float, int, str, bool, Path, tuples, Literals, dataclasses, or one of these or
            None; the text "none" is None.
        base: None: the defaults of `cls`.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is no TOML, or a key is unknown, missing, of a wrong type or out of its range; the message
            names file, key and value.
    """
    return config_from_table(cls, read_toml(path), base, str(path))


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is no TOML.
    """
    try:
        return parse_toml(read_regular(path, MOST_CONFIG_BYTES).decode())
    except ValueError as error:  # of TOML or of UTF-8
        raise ValueError(f"{path}: not a TOML file: {error}") from None


def config_from_table(
    cls: type[T], table: Mapping[str, Any], base: T | None = None, source: str = "config", prefix: str = ""
) -> T:
    """As `read_config`, from a table that is already parsed.

    Args:
        source: name of the table's origin in errors.
        prefix: of its keys in errors.
    """
    hints = get_type_hints(cls)
    known: dict[str, Field[Any]] = {item.name: item for item in fields(cls) if item.init}  # type: ignore[arg-type]
    values = {}
    for key, value in table.items():
        if key not in known:
            raise ValueError(f"{source}: unknown key {prefix}{key}{suggest_key(key, known)}")
        values[key] = _convert(hints[key], value, getattr(base, key, None), source, prefix + key)
    required = (name for name, item in known.items() if item.default is item.default_factory is MISSING)
    missing = [prefix + name for name in required if base is None and name not in values]
    if missing:
        raise ValueError(f"{source}: missing key {', '.join(missing)}")
    try:
        return cls(**values) if base is None else replace(base, **values)  # type: ignore[type-var]
    except ValueError as error:  # a value out of its range
        raise ValueError(f"{source}: {f'[{prefix[:-1]}] ' if prefix else ''}{error}") from None


def to_toml_text(config: Any) -> str:
    """Every field of a configuration as TOML that `read_config` reads back."""
    return "\n".join(_table_lines(config, "")).lstrip("\n") + "\n"


def settings_to_json(value: Any) -> Any:
    """Settings as JSON values: tuples as lists, numbers that are not finite as text."""
    if isinstance(value, Mapping):
        return {str(key): settings_to_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [settings_to_json(item) for item in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def settings_from_json(value: Any) -> Any:
    """What `settings_to_json` was given: text of infinities again numbers; settings without a value left out."""
    if isinstance(value, dict):
        return {key: settings_from_json(item) for key, item in value.items() if item is not None}
    if isinstance(value, list):
        return [settings_from_json(item) for item in value]
    return float(value) if value in ("inf", "-inf") else value


def suggest_key(key: str, known: Collection[str]) -> str:
    """The end of an error about an unknown key: the nearest known one, else all of them."""
    near = get_close_matches(key, known, 1, LEAST_LIKENESS)
    return f"; did you mean {near[0]}?" if near else f"; known keys: {', '.join(known)}"


def _convert(hint: Any, value: Any, base: Any, source: str, key: str) -> Any:
    """The value as its field holds it; `base` is the field's value so far."""
    if isinstance(value, dict):
        kinds: list[Any] = [kind for kind in _members(hint) if is_dataclass(kind)]
        if kinds:
            kind = type(base) if type(base) in kinds else kinds[0]
            return config_from_table(kind, value, base if isinstance(base, kind) else None, source, f"{key}.")
    if isinstance(value, list):
        for kind in _members(hint):
            items = get_args(kind)
            if get_origin(kind) is tuple and (items[-1] is ... or len(items) == len(value)):
                hints = [items[0]] * len(value) if items[-1] is ... else items
                pairs = enumerate(zip(hints, value, strict=True))
                return tuple(_convert(item, part, None, source, f"{key}[{k}]") for k, (item, part) in pairs)
    for kind in _members(hint):
        if kind is float and type(value) is int:
            return float(value)
        if kind is Path and isinstance(value, str) and value != NONE:
            return Path(value)
        if type(value) is kind or (get_origin(kind) is Literal and value in get_args(kind)):
            return None if value == NONE and NoneType in _members(hint) else value
    if value == NONE and NoneType in _members(hint):
        return None
    raise ValueError(f"{source}: {key} must be {_describe(hint)}, got {value!r}")


def _members(hint: Any) -> tuple[Any, ...]:
    """The alternatives of a union; any other hint by itself."""
    if get_origin(hint) is Annotated:
        return _members(get_args(hint)[0])
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _describe(hint: Any) -> str:
    texts = []
    for kind in _members(hint):
        if get_origin(kind) is Literal:
            texts.append(f"one of {', '.join(map(repr, get_args(kind)))}")
        elif get_origin(kind) is tuple:
            texts.append(f"a list [{', '.join('...' if item is ... else _describe(item) for item in get_args(kind))}]")
        elif is_dataclass(kind):
            texts.append("a table")
        else:
            texts.append(f'"{NONE}"' if kind is NoneType else "str" if kind is Path else kind.__name__)
    return " or ".join(texts)


def _table_lines(config: Any, name: str) -> list[str]:
    """Plain keys first, as TOML needs them, then the tables of nested dataclasses."""
    items = {item.name: getattr(config, item.name) for item in fields(config) if item.init}
    tables = {key: value for key, value in items.items() if is_dataclass(value)}
    lines = [f"{key} = {_value_text(value)}" for key, value in items.items() if key not in tables]
    if name and lines:
        lines = ["", f"[{name}]", *lines]
    for key, value in tables.items():
        lines += _table_lines(value, f"{name}.{key}" if name else key)
    return lines


def _value_text(value: Any) -> str:
    if is_dataclass(value):
        pairs = (f"{item.name} = {_value_text(getattr(value, item.name))}" for item in fields(value) if item.init)
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_value_text, value))}]"
    if value is None or isinstance(value, str | Path):
        text = NONE if value is None else str(value)
        text.encode()  # a ValueError for the name of a file that is no UTF-8: TOML cannot hold it
        return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    raise ValueError(f"TOML has no {type(value).__name__}, got {value!r}")

"""Conversion of dataclasses to JSON and arrays, and back, by the declared types of their fields.

Only the type annotations determine what is read: booleans, numbers, strings, literals, arrays, tuples, lists, None,
dataclasses of these, and classes with a JSON form of their own (``as_dict`` and ``from_dict``), such as calibrations.
Names of classes or functions are never read from a file.
"""

from __future__ import annotations

import math
import typing
from dataclasses import fields, is_dataclass
from functools import cache
from hashlib import sha256
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin

import numpy as np

from ospc.errors import FormatError, OspcError
from ospc.state.container import Array

T = TypeVar("T")

_LARGEST_INTEGER = 2**63 - 1
"""Largest integer that is read: arrays have 64 bits."""


def pack(value: object, name: str = "") -> tuple[Any, dict[str, Array]]:
    """Return the JSON-compatible content and the arrays of a dataclass, whose names begin with ``name``.

    TypeError if a value has a type that cannot be stored.
    """
    arrays: dict[str, Array] = {}
    return _packed(value, type(value), name, arrays), arrays


def unpack(kind: type[T], content: Any, arrays: typing.Mapping[str, Array], name: str) -> T:
    """Return the dataclass from the content and arrays of :func:`pack`.

    FormatError with the ``name`` of the file if they do not match its fields. The method ``check`` is called on all
    dataclasses in it that have one.
    """
    try:
        found: T = _unpacked(content, kind, arrays)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, OspcError) as error:
        raise FormatError(f"{name}: not readable as a state, its content is invalid ({error})") from None
    return found


def layout(kind: type) -> str:
    """Return a hash of the names and types of all fields of a dataclass and of the dataclasses in it."""
    return sha256(_described(kind).encode()).hexdigest()[:16]


def _is_dataclass(hint: Any) -> bool:
    return is_dataclass(hint)


def has_json_form(kind: Any) -> bool:
    """Return whether a class has a JSON form of its own, whose ``from_dict`` checks all values."""
    return hasattr(kind, "from_dict")


@cache
def _hints(kind: Any) -> dict[str, Any]:
    hints = typing.get_type_hints(kind)
    return {entry.name: hints[entry.name] for entry in fields(kind)}


@cache
def _is_array(hint: Any) -> bool:
    """Return whether a type is an array type, directly or, from NumPy 2.5, through the alias ``NDArray``."""
    origin = get_origin(hint)
    return (get_origin(getattr(origin, "__value__", None)) or origin) is np.ndarray


@cache
def _dtype(hint: Any) -> np.dtype[Any] | None:
    """Return the declared type of the values of an array; None if any is allowed."""
    declared = get_args(get_args(hint)[-1]) or get_args(hint)[-1:]
    return None if isinstance(declared[0], typing.TypeVar) or declared[0] is Any else np.dtype(declared[0])


@cache
def _described(hint: Any) -> str:
    if _is_array(hint):
        return f"array of {_dtype(hint) or 'numbers'}"
    if _is_dataclass(hint) and not has_json_form(hint):
        parts = (f"{name}:{_described(part)}" for name, part in _hints(hint).items())
        return "{" + ",".join(parts) + "}"
    if get_args(hint):
        return f"{get_origin(hint)}[{','.join(_described(part) for part in get_args(hint))}]"
    return str(hint)


@cache
def _is_column_wise(kind: Any) -> bool:
    """Return whether a list of these is packed as one column per field; thousands of small arrays would be slow."""
    return _is_dataclass(kind) and all(
        _is_array(hint) or hint in (bool, int, float) or _is_column_wise(hint) for hint in _hints(kind).values()
    )


@cache
def _without_none(hint: Any) -> Any:
    if get_origin(hint) in (UnionType, typing.Union):
        kinds = [part for part in get_args(hint) if part is not NoneType]
        if len(kinds) == 1:
            return kinds[0]
    return hint


def _packed(value: Any, hint: Any, place: str, arrays: dict[str, Array]) -> Any:
    hint = _without_none(hint)
    if value is None:
        return None
    if _is_dataclass(hint):
        return _packed_fields(value, hint, place, arrays)
    if _is_array(hint):
        arrays[place] = value
        return place
    if get_origin(hint) in (list, tuple):
        return _packed_sequence(list(value), get_args(hint)[0], place, arrays)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, bool | int | float | str | dict):
        return value
    raise TypeError(f"{place} of type {type(value).__name__} cannot be stored")


def _packed_fields(value: Any, kind: Any, place: str, arrays: dict[str, Array]) -> Any:
    if has_json_form(kind):
        return value.as_dict()
    return {
        name: _packed(getattr(value, name), part, f"{place}.{name}" if place else name, arrays)
        for name, part in _hints(kind).items()
    }


def _packed_sequence(values: list[Any], item: Any, place: str, arrays: dict[str, Array]) -> Any:
    if _is_array(item):
        if values:
            arrays[place] = np.concatenate(values) if len(values) > 1 else values[0]
        return {"name": place, "lengths": [len(value) for value in values]}
    if not _is_column_wise(item):
        return [_packed(value, item, f"{place}.{number}", arrays) for number, value in enumerate(values)]
    columns = {
        name: _packed_sequence([getattr(value, name) for value in values], part, f"{place}.{name}", arrays)
        for name, part in _hints(item).items()
    }
    return {"columns": columns}


def _unpacked(content: Any, hint: Any, arrays: typing.Mapping[str, Array]) -> Any:
    optional = _without_none(hint)
    if content is None and optional != hint:
        return None
    hint = optional
    if _is_dataclass(hint):
        return _unpacked_fields(content, hint, arrays)
    if _is_array(hint):
        return _array(arrays[content], hint)
    origin, items = get_origin(hint), get_args(hint)
    if origin is tuple and items[1:] != (Ellipsis,):
        return tuple(_unpacked(value, item, arrays) for value, item in zip(content, items, strict=True))
    if origin in (list, tuple):
        return origin(_unpacked_list(content, items[0], arrays))
    return _checked(content, _alternative(content, items) if origin in (UnionType, typing.Union) else origin or hint)


def _unpacked_fields(content: Any, kind: Any, arrays: typing.Mapping[str, Array]) -> Any:
    if has_json_form(kind):
        return kind.from_dict(content)
    hints = _hints(kind)
    _check_names(content, hints)
    return _made(kind, {name: _unpacked(content[name], part, arrays) for name, part in hints.items()})


def _alternative(content: Any, kinds: tuple[Any, ...]) -> Any:
    """Return the type of a value that has one of several types, or is one of the values of a Literal."""
    for kind in kinds:
        if content in get_args(kind) if get_origin(kind) is typing.Literal else type(content) is kind:
            return type(content)
    raise ValueError(f"{content!r} is none of {kinds}")


def _unpacked_list(content: Any, item: Any, arrays: typing.Mapping[str, Array]) -> list[Any]:
    if _is_array(item):
        return [_array(part, item) for part in _split(content, arrays)]
    if _is_column_wise(item):
        columns, hints = content["columns"], _hints(item)
        _check_names(columns, hints)
        parts = [_unpacked_list(columns[name], hint, arrays) for name, hint in hints.items()]
        return [_made(item, dict(zip(hints, row, strict=True))) for row in zip(*parts, strict=True)]
    return [_unpacked(value, item, arrays) for value in _checked(content, list)]


def _check_names(content: Any, hints: dict[str, Any]) -> None:
    if set(content) != set(hints):
        raise ValueError(f"{sorted(set(content) ^ set(hints))} missing or unknown")


def _made(kind: Any, values: dict[str, Any]) -> Any:
    """Return a dataclass after calling its method ``check`` if it has one."""
    value = kind(**values)
    if hasattr(value, "check"):
        value.check()
    return value


def _split(content: dict[str, Any], arrays: typing.Mapping[str, Array]) -> list[Array]:
    lengths = [_checked(length, int) for length in content["lengths"]]
    if not lengths:
        return []
    whole = arrays[content["name"]]
    if min(lengths) < 0 or sum(lengths) != len(whole):
        raise ValueError("the lengths of parts do not add up")
    return np.split(whole, np.cumsum(lengths)[:-1])


def _array(array: Array, hint: Any) -> Array:
    """Return the array after checking its type."""
    wanted = _dtype(hint)
    if wanted is not None and array.dtype != wanted:
        raise ValueError(f"an array has type {array.dtype} instead of {wanted}")
    return array


def _checked(content: Any, kind: Any) -> Any:
    if kind is float:
        if isinstance(content, bool) or not isinstance(content, int | float | str):
            raise ValueError(f"{content!r} is not a number")
        return float(content)
    if kind is Any:
        return content
    if kind is int and type(content) is int and not -_LARGEST_INTEGER <= content <= _LARGEST_INTEGER:
        raise ValueError("an integer has more than 64 bits")
    if type(content) is not kind:
        raise ValueError(f"{content!r} is not of type {kind.__name__}")
    return content

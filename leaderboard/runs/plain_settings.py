"""Settings as JSON values that are compared exactly: nothing is abbreviated, and nothing is replaced by its text."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

LONGEST = 1000  # numbers of an array that stand in a file in full; of longer ones their SHA-256 does
LARGEST = 10**300  # integers below fit a float, and so any reader of JSON
DOUBLE = 8  # bytes of JSON's floats
PLAIN = "numbers, strings, lists, dictionaries, dataclasses, paths and numpy arrays"


def plain_settings(settings: Any) -> dict[str, Any]:
    """A dataclass of settings as it comes back from a JSON file.

    Paths become strings and tuples lists. A numpy array becomes its dtype, its shape, and its values or, from LONGEST
    on, their SHA-256.

    Raises:
        TypeError: it is no dataclass, or holds what no file can hold exactly, such as a function; it names the field.
        ValueError: a number that is not finite or has too many digits, text that is no UTF-8, or endless nesting.
    """
    if not is_dataclass(settings) or isinstance(settings, type):
        raise TypeError(f"{_kind(settings)}, expected a dataclass of {PLAIN}")
    try:
        return dict(_fields(settings, ""))
    except RecursionError:
        raise ValueError("settings that hold themselves, or are nested too deeply") from None


def _plain(value: Any, where: str) -> Any:
    """One value, and where it stands, for errors."""
    if isinstance(value, np.ndarray):
        return _array(value, where)
    if isinstance(value, np.generic):
        return _plain(_item(value, where), where)
    if value is None or isinstance(value, bool | int | float | str):
        return _scalar(value, where)
    if isinstance(value, PurePath):
        return _scalar(str(value), where)
    if is_dataclass(value) and not isinstance(value, type):
        return _fields(value, f"{where}.")
    if isinstance(value, Mapping):
        return {_key(key, value, where): _plain(item, f"{where}[{key!r}]") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{i}]") for i, item in enumerate(value)]
    raise TypeError(f"{where} is {_kind(value)}, expected {PLAIN}")


def _fields(settings: Any, start: str) -> dict[str, Any]:
    return {field.name: _plain(getattr(settings, field.name), start + field.name) for field in fields(settings)}


def _key(key: Any, among: Mapping[Any, Any], where: str) -> str:
    """The key of a dictionary: strings, or integers, but not both, of which "1" and 1 would become one."""
    if not (all(isinstance(other, str) for other in among) or all(type(other) is int for other in among)):
        raise TypeError(f"{where} is a dictionary with the key {key!r}, expected strings alone, or integers alone")
    return str(_scalar(key, where))


def _scalar(value: Any, where: str) -> Any:
    """As JSON has it: of a class of its own, such as an enumeration's, the value."""
    if isinstance(value, str):
        try:
            return value.encode().decode()
        except UnicodeEncodeError:
            raise ValueError(f"{where} is {value!r}, expected text that is UTF-8") from None
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{where} is {float(value)}, expected a finite number")
    if isinstance(value, int) and not -LARGEST < value < LARGEST:
        raise ValueError(f"{where} is an integer of more than 300 digits")
    return json.loads(json.dumps(value))


def _item(value: np.generic, where: str) -> Any:
    """A numpy scalar as Python's; those that Python has no plain type for are refused."""
    if not _is_plain(value.dtype):
        raise TypeError(f"{where} is {_kind(value)}, expected {PLAIN}")
    return value.item()


def _array(array: NDArray[Any], where: str) -> dict[str, Any]:
    """An array in full, or a long one's digest, the same for any layout in memory."""
    if not _is_plain(array.dtype) or isinstance(array, np.ma.MaskedArray):
        raise TypeError(f"{where} is an array of {array.dtype}, expected an array of numbers or strings")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise ValueError(f"{where} is an array with numbers that are not finite")
    said = {"dtype": array.dtype.newbyteorder("=").name, "shape": list(array.shape)}
    if array.size > LONGEST:
        values = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
        return {**said, "sha256": hashlib.sha256(values.tobytes()).hexdigest()}
    return {**said, "values": _plain(array.tolist(), where)}


def _is_plain(dtype: np.dtype[Any]) -> bool:
    """Whether JSON can hold such values: no objects, dates or complex numbers, and no floats longer than its own."""
    return dtype.kind in "biuU" or (dtype.kind == "f" and dtype.itemsize <= DOUBLE)


def _kind(value: Any) -> str:
    """The type of a value in words, without its text: that may hold an address, or be endless."""
    return f"{type(value).__module__}.{type(value).__qualname__}".removeprefix("builtins.")

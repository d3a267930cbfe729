"""Settings that differ are recorded differently, those that are the same the same, and others are refused."""

import json
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from leaderboard.runs.plain_settings import LONGEST, plain_settings


class Kind(StrEnum):
    COARSE = "coarse"


class Numbered(Enum):
    ONE = 1


class Schedule:
    """Without a text of its own."""


@dataclass(frozen=True)
class Inner:
    value: Any = None


@dataclass(frozen=True)
class Settings:
    value: Any
    inner: Inner = field(default_factory=Inner)


def recorded(value: Any) -> Any:
    """A value as a file gives it back."""
    settings = plain_settings(Settings(1, Inner(value)))
    assert json.loads(json.dumps(settings)) == settings
    return settings["inner"]["value"]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (None, None),
        (True, True),
        (3, 3),
        (0.1, 0.1),
        ("Müller", "Müller"),
        (Kind.COARSE, "coarse"),
        (Path("a") / "b", "a/b"),
        ((1, (2.5, "x")), [1, [2.5, "x"]]),
        ({"a": (1,)}, {"a": [1]}),
        ({1000: 0.1, 2000: 0.2}, {"1000": 0.1, "2000": 0.2}),
        (MappingProxyType({"a": 1}), {"a": 1}),
        (np.float32(0.5), 0.5),
        (np.int64(7), 7),
        (np.bool_(True), True),
        (np.array([1, 2], np.int32), {"dtype": "int32", "shape": [2], "values": [1, 2]}),
        (np.array(["a", "b"]), {"dtype": "str32", "shape": [2], "values": ["a", "b"]}),
    ],
)
def test_plain_values_are_recorded_in_full(value, expected):
    found = recorded(value)
    assert found == expected
    assert type(found) is type(expected)


def changed(at: int) -> np.ndarray:
    """A long array of zeros but for one number."""
    weights = np.zeros(5 * LONGEST)
    weights[at] = 1
    return weights


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (np.zeros(5 * LONGEST), changed(2 * LONGEST)),
        (changed(7), changed(8)),
        (np.zeros((LONGEST, 6)), np.zeros((6, LONGEST))),
        (np.zeros(LONGEST + 1), np.zeros(LONGEST + 1, np.float32)),
        (np.zeros((0, 3)), np.zeros((3, 0))),
        (np.array([0.1]), np.array([np.nextafter(0.1, 1)])),
        (0.1, np.float32(0.1)),
        ([0] * 2 * LONGEST, [0] * LONGEST + [1] + [0] * (LONGEST - 1)),
        ({"a": np.zeros(2 * LONGEST)}, {"a": np.ones(2 * LONGEST)}),
    ],
)
def test_what_differs_is_recorded_differently(one, other):
    assert recorded(one) != recorded(other)


@pytest.mark.parametrize("size", [4, 2 * LONGEST])
def test_the_same_numbers_are_the_same_in_any_layout(size):
    numbers = np.arange(2.0 * size).reshape(size, 2)
    assert recorded(numbers) == recorded(np.asfortranarray(numbers)) == recorded(numbers.astype(">f8"))
    assert recorded(numbers) == recorded(np.repeat(numbers, 2, axis=1)[:, ::2])


ENDLESS: list[Any] = []
ENDLESS.append(ENDLESS)


@pytest.mark.parametrize(
    ("value", "what"),
    [
        (Schedule(), r"inner\.value is .*Schedule"),
        ([1, Schedule()], r"inner\.value\[1\] is .*Schedule"),
        ({"rate": lambda step: step}, r"inner\.value\['rate'\] is function"),
        ({1, 2}, r"inner\.value is set"),
        (b"bytes", r"inner\.value is bytes"),
        (1j, r"inner\.value is complex"),
        (Fraction(1, 3), r"inner\.value is fractions\.Fraction"),
        (Numbered.ONE, r"inner\.value is .*Numbered"),
        (Inner, r"inner\.value is type"),
        ({(1, 2): 3}, r"inner\.value is a dictionary with the key \(1, 2\)"),
        ({1: "a", "1": "b"}, r"inner\.value is a dictionary with the key 1"),
        (np.array([Schedule()]), r"inner\.value is an array of object"),
        (np.ma.masked_equal([1, 2], 2), r"inner\.value is an array of int"),
        (np.datetime64("2020-01-01"), r"inner\.value is numpy\.datetime64"),
        (float("nan"), r"inner\.value is nan"),
        (np.float32("inf"), r"inner\.value is inf"),
        (np.array([0.0, np.nan]), r"inner\.value is an array with numbers that are not finite"),
        (10**400, r"inner\.value is an integer of more than 300 digits"),
        ("\ud800", r"inner\.value is '\\ud800'"),
        (ENDLESS, "hold themselves"),
    ],
)
def test_what_no_file_can_hold_is_refused_by_its_field(value, what):
    with pytest.raises((TypeError, ValueError), match=what) as refused:
        recorded(value)
    assert " at 0x" not in str(refused.value)


@pytest.mark.parametrize("settings", [{"photographs": 5}, Settings, 3])
def test_settings_are_a_dataclass(settings):
    with pytest.raises(TypeError, match="expected a dataclass"):
        plain_settings(settings)

"""Checks of numeric settings: finite, not negative, counts at least 1."""

import math
from dataclasses import fields
from typing import Any

from hydroviews.errors import InputError

COUNTS = ("steps", "batch", "patch", "crops", "removal_every", "validate_every")


def require_numbers(settings: Any) -> None:
    """Refuse numbers that no training can have; for `__post_init__` of a dataclass of settings.

    Raises:
        InputError: a number is negative or not finite, or one that counts is less than 1.
    """
    for field in fields(settings):
        value, least = getattr(settings, field.name), 1 if field.name in COUNTS else 0
        if isinstance(value, int | float) and not (math.isfinite(value) and value >= least):
            option = field.name.replace("_", "-")
            raise InputError(f"--{option} {value}: impossible", expected=f"a number of at least {least}")

"""The page that lists what the rain model takes for granted has the values that the code has."""

import re
from fractions import Fraction
from operator import attrgetter
from pathlib import Path

import pytest

from deraings.rain_model.config import RainConfig

PAGE = Path(__file__).parents[2] / "docs/methods/rain-model.md"
SETTING = re.compile(r"`([a-z_]+\.[a-z_]+)`")
RAIN = RainConfig()


def listed() -> list[tuple[str, float]]:
    """Settings and values of the page's rows: as many values as settings, or one for all."""
    pairs: list[tuple[str, float]] = []
    for row in PAGE.read_text().splitlines():
        settings, values = (cell.strip() for cell in [*row.split("|"), "", "", ""][1:3])
        names = SETTING.findall(settings)
        if names:
            numbers = [float(Fraction(value)) for value in values.split(", ")]
            pairs += zip(names, numbers if len(numbers) > 1 else numbers * len(names), strict=True)
    return pairs


@pytest.mark.parametrize(("setting", "value"), listed())
def test_the_page_has_the_value_that_the_code_has(setting, value):
    assert attrgetter(setting)(RAIN) == pytest.approx(value)


def test_the_page_has_all_settings_that_say_what_rain_is():
    """Settings that are not listed say how rain is learned, or how much work that is."""
    how = {"mist": {"rate", "colour_rate"}, "drops": {"long_side", "every", "noise"}, "rainfall": {"brightness"}}
    for part, named in how.items():
        there = {setting.partition(".")[2] for setting, _ in listed() if setting.startswith(f"{part}.")}
        assert there.isdisjoint(named)
        assert there | named == set(vars(getattr(RAIN, part)))

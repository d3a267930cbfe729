"""Every name that can be misspelt is answered with the nearest there is."""

from pathlib import Path

import pytest

from hydroviews.captures.download.captures import download_captures
from hydroviews.dataset.sources import find_capture
from hydroviews.dataset.suites import read_suite
from hydroviews.errors import InputError
from hydroviews.profiles import find_profile
from hydroviews.rain.registry import choose_patterns
from leaderboard.records import check_track

NOWHERE = Path("/nowhere")


@pytest.mark.parametrize(
    ("find", "name", "meant"),
    [
        (find_profile, "standart", "standard"),
        (check_track, "sparse-view", "sparse-views"),
        (read_suite, "papers", "paper"),
        (lambda name: find_capture(name, NOWHERE, 1, 8, NOWHERE), "courtyrd", "courtyard"),
        (lambda name: choose_patterns([name], ()), "streak", "streak-0 or streak-1 or streak-2"),
        (lambda name: list(download_captures(name, NOWHERE, None)), "mipnerf360/gardn", "mipnerf360/garden"),
    ],
)
def test_a_misspelt_name_suggests_the_nearest(find, name, meant):
    with pytest.raises(InputError, match=f"{name}: no such") as error:
        find(name)
    assert f"what to do: did you mean {meant}?" in str(error.value)


def test_an_error_is_printable_whatever_it_is_about():
    error = InputError("a\x1b[2J.png", found="one\n\ttwo", fix="\ud800")
    assert str(error) == "a\\x1b[2J.png\n  found: one\n\\ttwo\n  what to do: \\ud800"
    assert str(InputError("Brücke.png: naïve")) == "Brücke.png: naïve"

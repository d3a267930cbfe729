"""Where tests find real captures: $HYDROVIEWS_CAPTURES, or ../shared/data beside the checkout; a walk through one."""

import os
from pathlib import Path

import pytest

from hydroviews.formats.read import read_scene
from hydroviews.rain.streaks.recipe import StreakPattern, composite, streak_layer
from hydroviews.scene.images import Image, read_image, resize_area
from hydroviews.scene.seeds import generator

RAIN = StreakPattern(n=40, length=30, angle=85.0, width=3)
WALK = (0, 4, 8, 12, 16, 20, 24, 28, 32)  # views of the flower, each sharing most with the next
ROOT = Path(os.environ.get("HYDROVIEWS_CAPTURES") or Path(__file__).parents[4] / "shared" / "data")


def capture(name: str) -> Path:
    """The folder of a real capture; skips the test where it is missing."""
    folder = ROOT / name
    if not folder.is_dir():
        pytest.skip(f"real capture {name} is not in {ROOT}; set HYDROVIEWS_CAPTURES to a folder that holds it")
    return folder


def flower_walk() -> list[tuple[str, Image]]:
    """Names and pictures of nine photographs of the flower, at half size."""
    views = read_scene(capture("llff_flower")).views
    return [(views[i].name, resize_area(read_image(views[i].path), 400, 300)) for i in WALK]


def rained_on(image: Image, label: int) -> Image:
    """Streaks on a picture [300, 400, 3], others for every label."""
    return composite(image, streak_layer(RAIN, 400, 300, generator(label, "film")), 0.8)

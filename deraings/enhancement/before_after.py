"""Photographs before and after enhancement, side by side, to look at."""

from collections.abc import Sequence
from pathlib import Path

from baselines.training.images import evenly_spread
from hydroviews.scene.images import Image
from hydroviews.scene.picture_grid import Canvas, Row, Tile, draw_sheet

WIDTH = 1600  # pixels of the sheet
PAIRS = 2  # in a row
SHOWN = 12  # photographs, at most


def on_sheet(files: Sequence[Path]) -> list[Path]:
    """The photographs that are drawn of many: evenly spread, so that nobody has chosen them by their looks."""
    return [files[index] for index in evenly_spread(len(files), SHOWN)]


def before_and_after(title: str, remark: str, pictures: Sequence[tuple[str, Image, Image]]) -> Canvas:
    """A sheet of photographs, each beside its enhanced picture.

    Args:
        title: above everything.
        remark: beside it.
        pictures: name, photograph and enhanced picture [H, W, 3] of at least one.

    Returns:
        [H, W, 3], 8-bit.
    """
    tiles = [tile for name, before, after in pictures for tile in (Tile(before, name), Tile(after, "enhanced"))]
    rows = [Row("", "", tiles[i : i + 2 * PAIRS]) for i in range(0, len(tiles), 2 * PAIRS)]
    return draw_sheet(title, remark, rows, WIDTH)

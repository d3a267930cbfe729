"""A grid of captioned pictures on white: rows of tiles under headings."""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import to_uint8

Canvas = NDArray[np.uint8]  # [H, W, 3]

PAPER, INK, GREY = 255, 34, 118
MARGIN, GAP = 20, 6  # pixels around the sheet, between tiles
TITLE, HEADING, CAPTION = 26, 18, 13  # pixels of a capital letter with what hangs below the line
FINE = 4  # letters are drawn this much larger and averaged down
FONT = cv2.FONT_HERSHEY_SIMPLEX
LINE = 1.9  # distance of lines, in heights of letters


@dataclass(frozen=True)
class Tile:
    """One picture, [H, W, 3] in [0, 1] or 8-bit, and a few words below it."""

    image: NDArray
    caption: str = ""


@dataclass(frozen=True)
class Row:
    """Tiles side by side under a heading, with a remark beside the heading."""

    heading: str
    remark: str
    tiles: Sequence[Tile]


def draw_sheet(title: str, remark: str, rows: Sequence[Row], width: int) -> Canvas:
    """All rows one below the other.

    Args:
        title: above everything.
        remark: beside it.
        rows: of any number of tiles; all tiles get the width that the longest row leaves them, none is enlarged.
        width: of the sheet in pixels, at most.

    Returns:
        [H, W, 3], 8-bit.
    """
    columns = max(len(row.tiles) for row in rows)
    images = [tile.image for row in rows for tile in row.tiles]
    side = min((width - 2 * MARGIN + GAP) // columns - GAP, max(image.shape[1] for image in images))
    inner = columns * (side + GAP) - GAP
    bands = [_band(title, remark, TITLE, inner)] + [_draw_row(row, side, inner) for row in rows]
    page = np.concatenate(bands)
    return np.pad(page, ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0)), constant_values=PAPER)


def _draw_row(row: Row, side: int, inner: int) -> Canvas:
    pictures = [_fitted(tile.image, side) for tile in row.tiles]
    height = max(picture.shape[0] for picture in pictures)
    captions = any(tile.caption for tile in row.tiles)
    below = round(LINE * CAPTION) if captions else 0
    band = np.full((height + below, inner, 3), PAPER, np.uint8)
    for i, (tile, picture) in enumerate(zip(row.tiles, pictures, strict=True)):
        x = i * (side + GAP)
        band[: picture.shape[0], x : x + side] = picture
        write(band, tile.caption, x, height + below // 2, CAPTION, GREY, limit=side)
    return np.concatenate([_band(row.heading, row.remark, HEADING, inner), band])


def _fitted(image: NDArray, side: int) -> Canvas:
    """The picture `side` pixels wide: shrunk by averaging, or set on paper where it is smaller."""
    pixels = image if image.dtype == np.uint8 else to_uint8(image)
    height, width = pixels.shape[:2]
    if width > side:
        size = (side, max(1, round(height * side / width)))
        return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    return np.pad(pixels, ((0, 0), (0, side - width), (0, 0)), constant_values=PAPER)


def _band(heading: str, remark: str, size: int, inner: int) -> Canvas:
    """A line of text: the heading dark, the remark grey after it."""
    band = np.full((round(LINE * size), inner, 3), PAPER, np.uint8)
    end = write(band, heading, 0, len(band) // 2, size, INK, limit=inner, weight=2)
    write(band, remark, end + size, len(band) // 2, round(0.85 * size), GREY, limit=inner - end - size)
    return band


def write(canvas: Canvas, text: str, x: int, middle: int, size: int, grey: int, *, limit: int, weight: int = 1) -> int:
    """Write one line into a canvas, smaller where it would be longer than `limit` pixels.

    Args:
        canvas: changed in place.
        text: letters lose their marks, since the font has ASCII alone; other characters become question marks.
        x: where it begins.
        middle: the row that the letters are centred on.
        size: height of the letters in pixels.
        grey: 0 black to 255 white.
        limit: pixels.
        weight: 1 for plain, 2 for bold letters.

    Returns:
        Where it ends.
    """
    if not text or limit < size:
        return x
    plain = _ascii(text)
    scale, thick = FINE * size / 30, max(1, round(FINE * size * weight / 18))
    (long, tall), base = cv2.getTextSize(plain, FONT, scale, thick)
    drawn = np.full((tall + base + 2 * thick, long + 2 * thick), PAPER, np.uint8)
    cv2.putText(drawn, plain, (thick, tall + thick), FONT, scale, (grey,), thick, cv2.LINE_AA)
    shrink = max(FINE, drawn.shape[1] / limit)
    wanted = (max(1, int(drawn.shape[1] / shrink)), max(1, int(drawn.shape[0] / shrink)))
    letters = cv2.resize(drawn, wanted, interpolation=cv2.INTER_AREA)
    top = max(0, middle - letters.shape[0] // 2)
    room = canvas[top : top + letters.shape[0], x : x + letters.shape[1]]
    np.minimum(room, letters[: room.shape[0], : room.shape[1], None], out=room)
    return x + letters.shape[1]


def _ascii(text: str) -> str:
    letters = (letter for letter in unicodedata.normalize("NFKD", text) if not unicodedata.combining(letter))
    return "".join(letters).replace("ß", "ss").encode("ascii", "replace").decode()

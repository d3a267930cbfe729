"""Falling rain as strokes in perspective, at a few distances, and a veil of what is too far to be seen singly."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.other_make.strokes import draw_strokes
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image

DISTANCES = np.array([1.0, 2.0, 4.0])  # of the layers; the nearest looks as long and wide as the pattern says
SHARES = np.array([1, 4, 16]) / 21  # of the strokes: as many as lie in front of a picture at that distance
SOFTNESS = np.array([1.0, 0.2, 0.0])  # of the pattern's focus blur
MOST = 9000.0  # strokes in a picture
MARGIN = 0.25  # sides around the picture in which they begin
NEAREST = 0.3  # share of its distance that a drop may come to the camera while the shutter is open
SKY_ROWS, SKY_SHARE = 0.4, 0.2  # of the picture, from its top, and of the pixels there, the brightest
GUST = 0.15  # standard deviation of the logarithm of a view's number of strokes


@dataclass(frozen=True)
class RainfallPattern:
    """What all views share. A side is the geometric mean of the picture's width and height."""

    strokes: float  # in a picture, in the mean
    length: float  # median at the nearest distance, in sides
    length_spread: float  # standard deviation of the logarithm
    width: float  # standard deviation of the profile there, median, in sides
    focus_blur: float  # the same of the blur of the nearest, in sides
    opacity: float  # mean cover in the middle of a stroke
    bend: float  # standard deviation of the middle's way off the line, in lengths
    lean: float  # speed of the wind over that of the fall
    wind: float  # direction of the wind, radians
    swirl: float  # standard deviation of directions, radians
    veil: float  # cover by the veil where it is densest
    veil_rise: float  # share of it that is missing at the picture's foot
    screen: bool  # screen blend instead of alpha


def draw_pattern(rng: np.random.Generator) -> RainfallPattern:
    """Draw what the grade does not set; strokes and veil are set later, by the grade."""
    return RainfallPattern(
        strokes=0.0,
        length=float(rng.uniform(0.12, 0.3)),
        length_spread=float(rng.uniform(0.25, 0.5)),
        width=float(rng.uniform(0.0016, 0.003)),
        focus_blur=float(rng.uniform(0.001, 0.004)),
        opacity=float(rng.uniform(0.3, 0.5)),
        bend=float(rng.uniform(0.0, 0.02)),
        lean=float(np.tan(np.radians(rng.uniform(0, 25)))),
        wind=float(rng.uniform(0, 2 * np.pi)),
        swirl=float(np.radians(rng.uniform(1, 4))),
        veil=0.0,
        veil_rise=float(max(0.0, rng.uniform(-0.5, 0.9))),
        screen=bool(rng.uniform() < 0.5),
    )


def fall_direction(pattern: RainfallPattern, down: NDArray, ahead: NDArray) -> NDArray[np.float64]:
    """The unit vector [3] along which rain falls: down, and along the wind, which is horizontal.

    Args:
        pattern: its `lean` and `wind`, the latter from `ahead` to the right as seen from above.
        down: unit vector [3].
        ahead: any direction [3] that is not `down`.
    """
    level = ahead - (ahead @ down) * down
    level /= np.linalg.norm(level)
    wind = np.cos(pattern.wind) * level + np.sin(pattern.wind) * np.cross(down, level)
    fall = down + pattern.lean * wind
    return np.asarray(fall / np.linalg.norm(fall))


def draw_rainfall(
    pattern: RainfallPattern, camera: Camera, fall: NDArray, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Cover by streaks [H, W] of one view.

    Args:
        pattern: what all views share.
        camera: of the view.
        fall: unit vector [3] along which rain falls, in the camera's axes.
        rng: of the view; more strokes are added to those that there are.
    """
    return draw_strokes(_strokes(pattern, camera, fall, rng), camera.width, camera.height)


def _strokes(pattern: RainfallPattern, camera: Camera, fall: NDArray, rng: np.random.Generator) -> NDArray[np.float64]:
    """Strokes [N, 7] in pixels: a drop at distance m moves, while the shutter is open, as far as it looks long at 1.

    Distances are in focal lengths, so that a long lens shows rain that is farther away, and as large.
    """
    size = np.array([camera.width, camera.height], np.float64)
    side = np.sqrt(size.prod())
    area = float((1 + 2 * MARGIN * side / size).prod())
    gust = float(np.exp(GUST * rng.normal() - GUST**2 / 2))
    counts = [round(pattern.strokes * gust * area * share) for share in SHARES]
    layer = np.repeat(np.arange(len(counts)), counts)
    streams = [child.spawn(2) for child in rng.spawn(len(counts))]  # so that more strokes change none that there are
    uniform = np.concatenate([one.random((count, 3)) for count, (one, _) in zip(counts, streams, strict=True)])
    normal = np.concatenate([two.normal(size=(count, 6)) for count, (_, two) in zip(counts, streams, strict=True)])
    start = (uniform[:, :2] * (1 + 2 * MARGIN * side / size) - MARGIN * side / size) * size
    distance = DISTANCES[layer]
    focal = np.array([camera.fx, camera.fy]) / side
    length = pattern.length * np.exp(pattern.length_spread * normal[:, 0])
    heading = fall + pattern.swirl * normal[:, 1:4]
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    depth = distance * focal.mean()
    slope = (start - (camera.cx, camera.cy)) / side / focal
    position = np.column_stack([slope * depth[:, None], depth])
    moved = position + length[:, None] * heading
    near = np.maximum(moved[:, 2], NEAREST * depth)
    end = moved[:, :2] / near[:, None] * focal * side + (camera.cx, camera.cy)
    sharp = pattern.width * side / distance * np.exp(0.3 * normal[:, 4])
    sigma = np.hypot(sharp, SOFTNESS[layer] * pattern.focus_blur * side)
    alpha = np.clip(pattern.opacity * (0.4 + 1.2 * uniform[:, 2]), 0, 0.95) * sharp / sigma
    run = np.linalg.norm(end - start, axis=1)
    end = start + (end - start) * np.maximum(1, 2 * sigma / np.maximum(run, 1e-6))[:, None]  # drops seen head on
    bend = pattern.bend * normal[:, 5] * run
    return np.column_stack([start, end, bend, sigma, alpha])


def veil_cover(pattern: RainfallPattern, width: int, height: int) -> NDArray[np.float32]:
    """Cover by the veil [H, W]: even, or growing with the height in the picture, where one looks farther."""
    up = 1 - (np.arange(height) + 0.5) / height
    rows = pattern.veil * (1 - pattern.veil_rise * (1 - up))
    return np.repeat(rows[:, None], width, axis=1).astype(np.float32)


def sky_colour(clean: Image) -> NDArray[np.float32]:
    """Encoded colour [3] of the sky of a view [H, W, 3]: the mean of the brightest pixels of its upper part."""
    upper = clean[: max(1, round(SKY_ROWS * len(clean)))].reshape(-1, 3)
    brightness = upper.sum(axis=1)
    bright = upper[brightness >= np.quantile(brightness, 1 - SKY_SHARE)]
    return np.asarray(bright.mean(axis=0, dtype=np.float64), np.float32)


def rain_over(
    clean: Image, streaks: NDArray[np.float32], veil: NDArray[np.float32], screen: bool, sky: NDArray[np.float32]
) -> Image:
    """A view [H, W, 3] under a veil H and streaks A [H, W], all encoded.

    The veil is sky in front of everything, B' = (1 - H) B + H c; streaks are (1 - A) B' + A c, or by screen blend
    1 - (1 - B') (1 - A c).
    """
    veiled = clean + veil[..., None] * (sky - clean)
    reach = 1 - veiled if screen else 1
    added = streaks[..., None] * sky * reach if screen else streaks[..., None] * (sky - veiled)
    return np.clip(veiled + added, 0, 1)

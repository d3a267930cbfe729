"""Drops in front of one camera: what each pixel shows through them, and the blur of a lens focused on the scene."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.other_make.drops import Drops, LensPattern
from hydroviews.rain.other_make.refraction import dot, leave_drop, times
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image

Plane = NDArray[np.float32]  # [H, W]

FINER = 2  # a drawing has so many pixels a pixel, each way
SOFTER = 0.01  # standard deviation in sides: drops show the scene small, and so less of its detail
INNER = 0.35  # of the picture's mean: how bright a drop is where it reflects its own inside
GLINT = 0.12  # standard deviation of a normal around the brightest of a highlight
GLINT_TILT = 0.35  # of that normal, across over unit length
POINTS = 7  # along a pixel, odd, at which the aperture is looked at
FARTHEST = 3.0  # tangent of a ray, beyond which the scene is taken to look the same


@dataclass(frozen=True, eq=False)
class LensMap:
    """What a lens does to every picture behind it, [FINER H, FINER W], pixels where nothing is under water zero."""

    cover: Plane  # [0, 1]
    x: Plane  # place in the picture that is shown, in pixels of OpenCV: the centre of the first is 0
    y: Plane
    passing: Plane  # share of the light that comes from there
    highlight: Plane  # [0, 1]


def map_lens(pattern: LensPattern, drops: Drops, camera: Camera) -> LensMap:
    """Follow the ray of every pixel that a drop may cover; of drops that overlap the higher one is seen."""
    width, height = FINER * camera.width, FINER * camera.height
    fine = camera.resized(width, height)
    which, rows, columns = _boxes(drops, width, height)
    side, shape = np.sqrt(width * height), drops.bodies
    pixel = np.stack([columns, rows], axis=1).astype(np.float32) + np.float32(0.5)
    middle, radii = (drops.places * side + (width / 2, height / 2)).astype(np.float32), drops.radii * side
    place = times(shape.inverse[which], pixel - middle[which]) / radii.astype(np.float32)[which, None]
    rho = np.sqrt(dot(place, place))
    edge = np.clip(0.5 + (1 - rho) * radii[which], 0, 1)
    wet = edge > 0
    which, place, rho, edge, pixel = which[wet], place[wet], rho[wet], edge[wet], pixel[wet]
    flat = (rows * width + columns)[wet]
    ray = ((pixel - (fine.cx, fine.cy)) / (fine.fx, fine.fy)).astype(np.float32)
    out = leave_drop(place / np.maximum(rho, 1)[:, None], ray, shape.take(which))
    seen = np.nan_to_num(out.direction[:, :2] / np.maximum(out.direction[:, 2:], 1 / FARTHEST))
    seen = np.clip(seen, -FARTHEST, FARTHEST) * (camera.fx, camera.fy) + (camera.cx - 0.5, camera.cy - 0.5)
    aim = GLINT_TILT * np.array(pattern.glint_direction)
    off = out.normal[:, :2] - aim
    glint = np.exp(-dot(off, off) / (2 * GLINT**2))
    order = np.argsort(np.where(edge > 0.5, out.height * radii[which], -1), kind="stable")
    values = (seen[:, 0], seen[:, 1], out.passing, glint)
    planes = [_scatter(np.zeros(width * height, np.float32), flat[order], value[order]) for value in values]
    cover = np.zeros(width * height, np.float32)
    np.maximum.at(cover, flat, edge.astype(np.float32))
    return LensMap(*(plane.reshape(height, width) for plane in (cover, *planes)))


def _scatter(plane: Plane, places: NDArray, values: NDArray) -> Plane:
    """The plane [N] with values set; the last one counts where there are several."""
    plane[places] = values
    return plane


def _boxes(drops: Drops, width: int, height: int) -> tuple[NDArray[np.int64], ...]:
    """Drop, row and column of every pixel in the box around each drop."""
    side = np.sqrt(width * height)
    stretch = np.linalg.norm(np.linalg.inv(drops.bodies.inverse), axis=2)
    reach = drops.radii[:, None] * stretch * side + 1  # half widths and heights
    centre = drops.places * side + (width / 2, height / 2)
    low = np.clip(np.floor(centre - reach), 0, (width, height)).astype(np.int64)
    size = np.clip(np.ceil(centre + reach), 0, (width, height)).astype(np.int64) - low
    counts = size.prod(axis=1)
    which = np.repeat(np.arange(len(counts)), counts)
    index = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    return which, low[which, 1] + index // size[which, 0], low[which, 0] + index % size[which, 0]


def see_through(lens: LensMap, clean: Image, pattern: LensPattern) -> tuple[Plane, Image]:
    """Cover [H, W] by drops out of focus, and their encoded light [H, W, 3], times the cover."""
    height, width = clean.shape[:2]
    side = np.sqrt(width * height)
    if not lens.cover.any():
        return np.zeros((height, width), np.float32), np.zeros_like(clean)
    soft = cv2.GaussianBlur(clean, (0, 0), SOFTER * side, borderType=cv2.BORDER_REFLECT)
    shown = cv2.remap(soft, lens.x, lens.y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    inside = np.float32(INNER) * clean.mean(axis=(0, 1), dtype=np.float64).astype(np.float32)
    shown = inside + lens.passing[..., None] * (shown - inside)
    shown += (np.float32(pattern.glint) * lens.highlight)[..., None] * (1 - shown)
    drawn = np.concatenate([lens.cover[..., None] * shown, lens.cover[..., None]], axis=2)
    small = cv2.resize(drawn, (width, height), interpolation=cv2.INTER_AREA)
    blurred: Image = np.clip(cv2.filter2D(small, -1, aperture(pattern, side), borderType=cv2.BORDER_REFLECT), 0, 1)
    light: Image = blurred[..., :3]
    return blurred[..., 3], light


def aperture(pattern: LensPattern, side: float) -> Plane:
    """The picture [k, k] of a point that is out of focus, of sum 1: a polygon with soft edges, or a Gaussian."""
    radius = pattern.focus_blur * side / 2
    reach = int(np.ceil(radius * (1.5 if pattern.aperture_blades == 0 else 1))) + 1
    places = (np.arange((2 * reach + 1) * POINTS) + 0.5) / POINTS - reach - 0.5
    x, y = np.meshgrid(places, places)
    if pattern.aperture_blades == 0:
        kernel = np.exp(-(x**2 + y**2) / (2 * max(radius / 2, 0.2) ** 2))
    else:
        angles = pattern.aperture_turn + 2 * np.pi * np.arange(pattern.aperture_blades) / pattern.aperture_blades
        outermost = np.max([x * np.cos(angle) + y * np.sin(angle) for angle in angles], axis=0)
        kernel = np.clip(POINTS * (radius * np.cos(np.pi / pattern.aperture_blades) - outermost) + 0.5, 0, 1)
    kernel = kernel.reshape(2 * reach + 1, POINTS, 2 * reach + 1, POINTS).mean(axis=(1, 3))
    return np.asarray(kernel / kernel.sum(), np.float32)

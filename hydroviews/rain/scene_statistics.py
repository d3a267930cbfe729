"""What a pattern may know about the scene it rains on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.scene.depth import depth_path, view_depth
from hydroviews.scene.images import Image, luminance, resize_area, to_linear
from hydroviews.scene.scenes import Points, Scene, View

SAMPLED_VIEWS = 24  # spread evenly over the capture
SAMPLED_SIDE = 160  # pixels of a sample's longer side, at most
AIR = 0.1  # share of the pixels, the brightest, whose light is taken for the air's
TINT = 0.3  # share of their colour that the air has: they may be petals, and what falls on them is white
SAMPLED_POINTS = 4000
BEHIND = 0.03  # a point is hidden if it lies farther behind the surface than this share of its depth
FINE = 1.0  # standard deviation in pixels of the blur that separates fine detail

LensRenderer = Literal["disk", "aperture", "traced"]
Colour = tuple[float, float, float]  # linear light


@dataclass(frozen=True)
class Light:
    """How bright a scene is."""

    mean: Colour
    air: Colour  # as bright as the brightest tenth of the scene, nearly grey: what mist and distant rain scatter


@dataclass(frozen=True, eq=False)
class SceneStatistics:
    """A scene about to be rained on."""

    scene: str  # its name
    seed: int
    views: tuple[View, ...]  # clean, at the built size, in order of name: taken one after another
    points: Points
    mean_inverse_visibility: float  # mean over the scene's points of 1 / (number of training views that see it)
    samples: tuple[Image, ...]  # some clean views made small, [h, w, 3], sRGB-encoded
    detail: float  # mean squared fine detail of the clean views, encoded values: what is hardest to reconstruct
    light: Light
    clean_error: float | None = None  # of plain 3DGS on clean views, over `detail`, where it is known
    drops_cost: float = 1.0  # error that drops that stay leave in plain 3DGS, over what is predicted, if known
    metres_per_unit: float | None = None  # of the capture, where it is known
    lens_renderer: LensRenderer = "disk"  # of water on the lens

    @property
    def sampled_views(self) -> tuple[View, ...]:
        """The views that the samples show, with cameras of the samples' size."""
        sized = zip(_spread(self.views), self.samples, strict=True)
        return tuple(replace(view, camera=view.camera.resized(s.shape[1], s.shape[0])) for view, s in sized)


def survey(scene: Scene, seed: int, lens_renderer: LensRenderer = "disk") -> SceneStatistics:
    """Look at some of a scene's clean views, and say what rain may know.

    Raises:
        InputError: an unreadable picture.
    """
    samples, details = [], []
    for view in tqdm(_spread(scene.views), desc=f"{scene.name}: survey", unit="view", leave=False):
        image = view.image()
        details.append(fine_detail(image))
        samples.append(_small(image))
    return SceneStatistics(
        scene=scene.name,
        seed=seed,
        views=scene.views,
        points=scene.points,
        mean_inverse_visibility=_mean_inverse_visibility(scene),
        samples=tuple(samples),
        detail=float(np.mean(details)),
        light=measure_light(samples),
        clean_error=scene.clean_error,
        drops_cost=scene.drops_cost,
        metres_per_unit=scene.metres_per_unit,
        lens_renderer=lens_renderer,
    )


def fine_detail(image: Image) -> float:
    """Mean square of what a picture loses to a blur of about a pixel, in encoded values."""
    return float(np.mean((image - cv2.GaussianBlur(image, (0, 0), FINE)) ** 2, dtype=np.float64))


def _mean_inverse_visibility(scene: Scene) -> float:
    """Points are hidden where a depth map says so; without points every view is taken to see everything."""
    positions = scene.points.positions[:: -(-len(scene.points) // SAMPLED_POINTS) or 1]
    seen = np.zeros(len(positions), np.int64)
    for view in scene.train_views:
        pixels, depth = view.camera.project(positions)
        inside = (depth > 0) & np.all((pixels >= 0) & (pixels < (view.camera.width, view.camera.height)), axis=1)
        if inside.any() and depth_path(view).is_file():
            column, row = pixels[inside].astype(np.int64).T
            surface = view_depth(view, scene.points)[row, column]
            inside[inside] = depth[inside] < (1 + BEHIND) * surface
        seen += inside
    return float(np.mean(1 / seen[seen > 0])) if (seen > 0).any() else 1 / len(scene.split.train)


def _spread(views: tuple[View, ...]) -> tuple[View, ...]:
    return views[:: -(-len(views) // SAMPLED_VIEWS)]


def _small(image: Image) -> Image:
    height, width = image.shape[:2]
    scale = max(1.0, max(width, height) / SAMPLED_SIDE)
    return resize_area(image, max(1, round(width / scale)), max(1, round(height / scale)))


def measure_light(samples: Sequence[Image]) -> Light:
    """How bright the scene is that some views of it show, each [h, w, 3], sRGB-encoded."""
    linear: NDArray[np.float32] = np.concatenate([to_linear(sample).reshape(-1, 3) for sample in samples])
    brightest = np.argsort(luminance(linear), kind="stable")[-max(1, round(AIR * len(linear))) :]
    mean, bright = linear.mean(axis=0, dtype=np.float64), linear[brightest].mean(axis=0, dtype=np.float64)
    return Light(_colour(mean), _colour(TINT * bright + (1 - TINT) * luminance(bright)))


def _colour(linear: NDArray[np.float64]) -> Colour:
    red, green, blue = (round(float(value), 6) for value in linear)
    return red, green, blue

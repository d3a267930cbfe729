"""Held-out photographs in known rain, as hard as the benchmark's grades would make it, for networks to be judged on.

The rain is that of three effects in all grades, and any that the user names besides: rain that no network was trained
on tells what has been learned from what has been adapted to. Families of the recipes judge networks that were trained
without them. Each picture carries what is true of its rain: the cover
by drops and by streaks, and the mist.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from deraings.enhancement.clear_pixels import DROPS, STREAKS
from deraings.image_planes import Plane
from hydroviews.errors import InputError
from hydroviews.pairs.captures import Capture
from hydroviews.pairs.drawing import draw_rain
from hydroviews.pairs.exposure import air_light
from hydroviews.pairs.lens_pool import camera_of
from hydroviews.pairs.photographs import fit_frame, frame_of
from hydroviews.pairs.recipes.panes import Pane
from hydroviews.rain.compositing import Layers
from hydroviews.rain.effect import fall
from hydroviews.rain.patterns import GRADES, Pattern
from hydroviews.rain.registry import find_effect
from hydroviews.rain.scene_statistics import FINE, SAMPLED_SIDE, Light, SceneStatistics
from hydroviews.scene.images import Image, image_size, read_image, resize_area, to_linear, to_uint8
from hydroviews.scene.scenes import Points, View
from hydroviews.scene.seeds import generator

LONG_SIDE = 384  # pixels of the validation pictures
RARITY, DETAIL = 0.06, 0.0017  # medians of the benchmark's embedded scenes, LLFF flower and Mip-NeRF 360 bonsai
FAMILIES = "pane", "lines", "lines+pane"  # of the recipes, which need no lens
PATTERNS = tuple(Pattern(effect, index) for effect in ("streak", "raindrop", "window") for index in range(len(GRADES)))


@dataclass(frozen=True, eq=False)
class TrueMist:
    """The mist that a picture was drawn with, in linear light: V of the light is blocked, and V w is added."""

    cover: Plane  # V [H, W], [0, 1]
    light: NDArray[np.float32]  # w [3]

    def over(self, clean: Image) -> Image:
        """A picture behind this mist alone. The blur behind a window's mist is left out: no plane can undo blur.

        Args:
            clean: [H, W, 3], sRGB-encoded, [0, 1].

        Returns:
            The same shape and range.
        """
        if not self.cover.any():
            return clean  # without the rounding of light there and back
        return Pane(self.cover, self.light).over(clean)


@dataclass(frozen=True, eq=False)
class ValidationPicture:
    """A held-out photograph in known rain."""

    kind: str  # effect and grade, such as streak-medium; or clean
    rainy: Image  # [H, W, 3], sRGB-encoded, [0, 1]
    clean: Image  # the same without rain
    companions: NDArray[np.uint8]  # [K, H, W, 3], parts of other held-out photographs in the same rain
    drops: Plane | None = None  # true cover by drops [H, W], [0, 1]; None: no drops, or nobody knows
    streaks: Plane | None = None  # the same by streaks
    mist: TrueMist | None = None  # None: nobody knows


def validation_set(
    files: Sequence[Path],
    seed: int,
    folder: Path,
    companions: int = 0,
    patterns: Sequence[Pattern] = PATTERNS,
    families: Sequence[str] = (),
    long_side: int = LONG_SIDE,
) -> list[ValidationPicture]:
    """Every photograph in all patterns, in rain of all families, and clean.

    Args:
        files: held-out photographs.
        seed: of the rain.
        folder: keeps what Blender bakes.
        companions: how many parts of others come with each; none with families.
        patterns: effects and grades.
        families: of FAMILIES.
        long_side: of the pictures, in pixels.

    Raises:
        InputError: no such family, an unreadable photograph, or Blender failed.
    """
    if unknown := set(families) - set(FAMILIES):
        raise InputError(
            "families of rain", found=", ".join(sorted(unknown)), expected=f"some of {', '.join(FAMILIES)}"
        )
    found = []
    sources = [to_uint8(read_image(file)) for file in files] if companions else []
    for file in tqdm(files, desc="validation pictures", unit="picture"):
        image = fit_frame(read_image(file), frame_of(*image_size(file), long_side))
        capture, size = Capture(sources, False, np.ones(3, np.float32)), (image.shape[1], image.shape[0])
        others = capture.pictures(companions, size, size, generator(seed, "companions", file.stem))
        found.append(clean_picture(image, others))
        setting = setting_of(file, image, seed)
        for pattern in patterns:
            kept = folder / file.stem / f"{pattern.effect}-{pattern.index}"
            found.append(rainy_picture(image, others, pattern, setting, kept))
        found += [family_picture(image, family, generator(seed, family, file.stem)) for family in families]
    return found


def family_picture(image: Image, family: str, rng: np.random.Generator) -> ValidationPicture:
    """A photograph [H, W, 3] in rain by the recipes, without companions."""
    pair = draw_rain(to_uint8(image), family, (), rng)
    planes = (np.ascontiguousarray(pair.cover[..., channel]) for channel in (DROPS, STREAKS))
    drops, streaks = (plane if plane.any() else None for plane in planes)
    block, light = pair.mist[..., 0], pair.mist[..., 1:]
    known = bool(np.isfinite(block).all())
    mist = TrueMist(block, light.sum((0, 1)) / max(float(block.sum()), 1e-6)) if known else None
    alone = np.zeros((0, *image.shape), np.uint8)
    return ValidationPicture(family, pair.rainy, pair.clean, alone, drops, streaks, mist)


def clean_picture(image: Image, companions: NDArray[np.uint8]) -> ValidationPicture:
    """A photograph [H, W, 3] without rain, of which it is known that there is no mist."""
    none = TrueMist(np.zeros(image.shape[:2], np.float32), np.zeros(3, np.float32))
    return ValidationPicture("clean", image, image, companions, mist=none)


def rainy_picture(
    image: Image, companions: NDArray[np.uint8], pattern: Pattern, setting: SceneStatistics, folder: Path
) -> ValidationPicture:
    """A photograph, and others of its size that the same camera has taken, in a pattern of the benchmark.

    Args:
        image: [H, W, 3], sRGB-encoded, [0, 1].
        companions: [K, H, W, 3], any number; drops stay on the lens from one to the next, streaks are new in each.
        pattern: effect and grade.
        setting: from `setting_of`.
        folder: keeps what Blender bakes.

    Raises:
        InputError: Blender failed.
    """
    effect, view = find_effect(pattern.effect), setting.views[0]
    rain = effect.place(effect.draw(pattern, setting), pattern, setting)
    prepared = rain.prepare(view.camera, folder)
    layers = fall(prepared, image, view)
    seen = np.empty_like(companions)
    for index, other in enumerate(companions.astype(np.float32) / 255, start=1):
        shown = replace(view, name=f"{view.name} {index}") if effect.falling else view
        seen[index - 1] = to_uint8(effect.composite(rain.parameters, other, fall(prepared, other, shown)))
    covers = effect.covers(layers)
    return ValidationPicture(
        kind=f"{pattern.effect}-{pattern.grade}",
        rainy=effect.composite(rain.parameters, image, layers),
        clean=image,
        companions=seen,
        drops=covers.get("water"),
        streaks=covers.get("streaks"),
        mist=true_mist(rain.parameters, layers),
    )


def true_mist(parameters: Mapping[str, Any], layers: Layers) -> TrueMist | None:
    """The mist of an effect's parameters and layers: V, in the light of its air; None where these do not tell.

    Streaks have none that is known: dense ones act as mist, and no plane holds them.
    """
    if "V" not in layers or "air_light" not in parameters:
        return None
    return TrueMist(layers["V"], np.array(parameters["air_light"], np.float32))


def setting_of(photograph: Path, image: Image, seed: int) -> SceneStatistics:
    """A photograph as if it were a scene, for severity to grade rain by its detail, contrast and light.

    The visibility of places is that of the benchmark's scenes. The clean error is the one that the benchmark assumes of
    unknown captures. A smooth photograph gets the rain of a scene with more detail, since its own would be hardly
    visible.
    """
    height, width = image.shape[:2]
    scale = max(1.0, max(width, height) / SAMPLED_SIDE)
    small = resize_area(image, round(width / scale), round(height / scale))
    fine = image - cv2.GaussianBlur(image, (0, 0), FINE)
    linear = to_linear(image)
    mean, air = linear.mean(axis=(0, 1), dtype=np.float64), air_light(linear)
    return SceneStatistics(
        scene=photograph.stem,
        seed=seed,
        views=(View(photograph.stem, camera_of((width, height)), photograph),),
        points=Points(np.zeros((0, 3)), np.zeros((0, 3), np.uint8)),
        mean_inverse_visibility=RARITY,
        samples=(small,),
        detail=max(DETAIL, float(np.mean(fine**2, dtype=np.float64))),
        light=Light(tuple(mean.tolist()), tuple(air.tolist())),
    )

"""How much a network gains on held-out photographs, in rain as hard as the benchmark's grades would make it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.training.validation import measure_by_kind
from deraings.enhancement.enhance import enhance
from deraings.enhancement.lenses import lenses_of_capture
from deraings.enhancement.network import EnhancementNetwork
from deraings.enhancement.weights import Enhancer
from hydroviews.formats.markdown import markdown_table
from hydroviews.metrics import psnr
from hydroviews.pairs.captures import Capture
from hydroviews.pairs.drawing import air_light
from hydroviews.pairs.lens_pool import camera_of
from hydroviews.pairs.photographs import fit_frame, frame_of
from hydroviews.rain.effect import fall
from hydroviews.rain.patterns import GRADES, Pattern
from hydroviews.rain.registry import find_effect
from hydroviews.rain.scene_statistics import FINE, SAMPLED_SIDE, Light, SceneStatistics
from hydroviews.scene.images import Image, image_size, read_image, resize_area, to_linear, to_uint8
from hydroviews.scene.scenes import Points, View
from hydroviews.scene.seeds import generator

LONG_SIDE = 384  # pixels of the validation pictures
RARITY, DETAIL = 0.06, 0.0017  # medians of the benchmark's embedded scenes, LLFF flower and Mip-NeRF 360 bonsai
EFFECTS = ("streak", "raindrop")


@dataclass(frozen=True, eq=False)
class ValidationPicture:
    """A held-out photograph in known rain."""

    kind: str  # such as streak-medium; or clean
    rainy: Image
    clean: Image
    companions: NDArray[np.uint8]  # [K, H, W, 3], parts of other held-out photographs in the same rain


@dataclass(frozen=True)
class Score:
    """Means over the pictures of a kind; PSNR in dB, brightness in 1/255."""

    kind: str
    pictures: int
    before: float  # PSNR of the rainy pictures
    after: float  # and of the enhanced ones
    brightness: float  # mean over pictures of |mean(enhanced) - mean(clean)|


def setting_of(photograph: Path, image: Image, seed: int) -> SceneStatistics:
    """A photograph as if it were a scene, for severity to grade rain by its detail, contrast and light.

    How often places of a scene are seen is taken from the benchmark's scenes, how well it can be reconstructed is what
    the benchmark assumes of unknown captures, and a photograph with less detail than its scenes, such as a smooth or
    a softly focused one, gets the rain of one with as much: otherwise the graded rain would be hardly visible.
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


def validation_set(files: Sequence[Path], seed: int, folder: Path, companions: int = 0) -> list[ValidationPicture]:
    """Every photograph in light, medium and heavy streaks and raindrops, and clean.

    Args:
        files: held-out photographs.
        seed: of the rain.
        folder: keeps what Blender bakes.
        companions: how many parts of others come with each.

    Raises:
        InputError: an unreadable photograph, or Blender failed.
    """
    found = []
    sources = [to_uint8(read_image(file)) for file in files] if companions else []
    for file in tqdm(files, desc="validation pictures", unit="picture"):
        image = fit_frame(read_image(file), frame_of(*image_size(file), LONG_SIDE))
        capture, size = Capture(sources, False, np.ones(3, np.float32)), (image.shape[1], image.shape[0])
        others = capture.pictures(companions, size, size, generator(seed, "companions", file.stem))
        pictures = [image, *(other.astype(np.float32) / 255 for other in others)]
        found.append(ValidationPicture("clean", image, image, others))
        setting = setting_of(file, image, seed)
        for effect in EFFECTS:
            for index, grade in enumerate(GRADES):
                pattern = Pattern(effect, index)
                rained = rain_on(pictures, pattern, setting, folder / file.stem / f"{effect}-{index}")
                seen = np.stack([to_uint8(other) for other in rained[1:]]) if companions else others
                found.append(ValidationPicture(f"{effect}-{grade}", rained[0], image, seen))
    return found


def rain_on(images: Sequence[Image], pattern: Pattern, setting: SceneStatistics, folder: Path) -> list[Image]:
    """A photograph, and others of its size that the same camera has taken, in a pattern of the benchmark."""
    effect, view = find_effect(pattern.effect), setting.views[0]
    rain = effect.place(effect.draw(pattern, setting), pattern, setting)
    prepared = rain.prepare(view.camera, folder)
    # What falls is new in every view; a lens stays as it is.
    views = [replace(view, name=f"{view.name} {i}") if i and effect.falling else view for i in range(len(images))]
    return [
        effect.composite(rain.parameters, image, fall(prepared, image, seen))
        for image, seen in zip(images, views, strict=True)
    ]


def scores(network: EnhancementNetwork, pictures: Sequence[ValidationPicture], companions: int = 0) -> list[Score]:
    """How the network does with so many companions, a row a kind."""
    enhancer = Enhancer(network, {}, "being validated")

    def measure(picture: ValidationPicture) -> tuple[float, float, float]:
        together = [to_uint8(picture.rainy), *picture.companions[:companions]]
        (lens, *_) = lenses_of_capture(len(together), together.__getitem__, network)
        enhanced = enhance(picture.rainy, enhancer, lens=lens)
        brightness = 255 * abs(float(enhanced.mean(dtype=np.float64) - picture.clean.mean(dtype=np.float64)))
        return float(psnr(picture.rainy, picture.clean)), float(psnr(enhanced, picture.clean)), brightness

    rows = measure_by_kind(pictures, measure)
    return [Score(kind, len(row), *np.mean(row, axis=0).tolist()) for kind, row in rows.items()]


def as_columns(rows: Sequence[Score]) -> dict[str, float]:
    """For a row of a training curve: PSNR after, by kind."""
    return {row.kind: row.after for row in rows}


def table(rows: Sequence[Score]) -> str:
    """Markdown."""
    cells = []
    for row in rows:
        gain = f"{row.after - row.before:+.2f}" if np.isfinite(row.before) else ""
        before = f"{row.before:.2f}" if np.isfinite(row.before) else "the same"
        brightness = f"{row.brightness:.2f}/255"
        cells.append((row.kind, row.pictures, before, f"{row.after:.2f}", gain, brightness))
    head = ("rain", "pictures", "PSNR before", "after", "gain", "brightness error")
    return markdown_table(head, cells, keep_empty=True)

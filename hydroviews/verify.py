"""Checks that a built data set is what its manifest says, and that rain was added as its formula says."""

from pathlib import Path

import numpy as np
from tqdm import tqdm

from hydroviews.build_clean import CLEAN
from hydroviews.errors import InputError
from hydroviews.files import read_json, sha256
from hydroviews.images import list_images, read_image
from hydroviews.manifest import MANIFEST, read_manifest, scene_files
from hydroviews.rain.effects import composite
from hydroviews.rain.layers import read_layers

TOLERANCE = 1.01 / 255  # the rainy view is an 8-bit rounding of what its layers give


def verify(data: Path, every_view: bool = False) -> list[str]:
    """Recompute hashes and re-derive rainy views from clean views, layers and parameters.

    Args:
        data: a data folder with a manifest.
        every_view: re-derive all views of each variant, not the first alone.

    Returns:
        One sentence a problem; empty where all is well.

    Raises:
        InputError: there is no manifest.
    """
    if not (data / MANIFEST).is_file():
        raise InputError(
            f"{data}: no {MANIFEST}",
            expected="a folder that `hydroviews build` has finished",
            fix="run the build again",
        )
    scenes = read_manifest(data)["scenes"]
    unlisted = [p.parent for p in sorted(data.glob("*/request.json")) if p.parent.name not in scenes]
    problems = [f"{folder}: not finished; run its build again" for folder in unlisted]
    for scene, facts in scenes.items():
        problems += _check_hashes(data / scene, facts["files"])
        for pattern in facts["patterns"]:
            problems += _check_variant(data / scene, pattern, every_view)
    return problems


def _check_hashes(folder: Path, files: dict[str, str]) -> list[str]:
    problems = []
    for name, expected in tqdm(files.items(), desc=f"{folder.name}: checksums", unit="file", leave=False):
        path = folder / name
        if not path.is_file():
            problems.append(f"{path}: missing")
        elif sha256(path) != expected:
            problems.append(f"{path}: changed since it was built")
    for path in scene_files(folder):
        if path.relative_to(folder).as_posix() not in files:
            problems.append(f"{path}: not in the manifest")
    return problems


def _check_variant(folder: Path, pattern: str, every_view: bool) -> list[str]:
    variant = folder / pattern
    images = list_images(variant / "images") if (variant / "images").is_dir() else []
    problems = []
    for image in tqdm(images if every_view else images[:1], desc=f"{folder.name}: {pattern}", unit="view", leave=False):
        try:
            error = _composite_error(folder, variant, image)
        except (InputError, KeyError) as broken:
            problems.append(str(broken))
            continue
        if error > TOLERANCE:
            problems.append(f"{image}: differs by {error * 255:.1f}/255 from its clean view and layers")
    return problems


def _composite_error(folder: Path, variant: Path, image: Path) -> float:
    """Largest difference between a rainy view and what clean view, layers and parameters give."""
    facts = read_json(variant / "pattern.json")
    clean = read_image(folder / CLEAN / image.name)
    layers = read_layers(variant / "layers" / f"{image.stem}.exr")
    expected = composite(facts["effect"], facts["parameters"], clean, layers)
    rainy = read_image(image)
    if rainy.shape != expected.shape:
        raise InputError(f"{image}: another size than its clean view", found=rainy.shape, expected=expected.shape)
    return float(np.abs(rainy - expected).max())

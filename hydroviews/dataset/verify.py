"""Checks that a built data set is what its manifest says, and that rain was added as its formula says."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.manifest import MANIFEST, read_manifest, scene_files
from hydroviews.dataset.rainy_variant import SHARED
from hydroviews.dataset.request import drawn_otherwise
from hydroviews.dataset.statistics import NUMBERS, STATISTICS, ViewStatistics, measure_view, read_statistics
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, sha256
from hydroviews.rain.compositing import STREAKS, WATER
from hydroviews.rain.effect import Effect
from hydroviews.rain.layers import read_layers
from hydroviews.rain.registry import find_effect
from hydroviews.scene.images import Image, list_images, read_image, to_uint8

logger = logging.getLogger(__name__)

TOLERANCE = 1 / 255  # the rainy view is an 8-bit rounding of what its layers give


def verify(data: Path, every_view: bool = False) -> list[str]:
    """Recompute hashes, and derive rainy views and their statistics from clean views, layers and parameters again.

    A scene that was captured in rain has no clean views: only its hashes are checked.

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
        _tell_generator(data / scene, facts["patterns"])
        problems += _check_hashes(data / scene, facts["files"], facts["patterns"])
        for pattern in facts["patterns"]:
            problems += _check_variant(data / scene, pattern, every_view)
    return problems


def _tell_generator(folder: Path, patterns: Sequence[str]) -> None:
    """Another generator's scene is as good as ever, but today's code would draw it otherwise: no problem, a remark."""
    try:
        outdated = drawn_otherwise(folder, patterns)
    except InputError as error:  # a damaged file, which the other checks find
        logger.warning("%s", error)
        return
    if outdated:
        logger.warning("%s: %s: drawn by another generator than this one", folder, ", ".join(outdated))


def _check_hashes(folder: Path, files: dict[str, str], patterns: Sequence[str]) -> list[str]:
    problems = []
    for name, expected in tqdm(files.items(), desc=f"{folder.name}: checksums", unit="file", leave=False):
        path = folder / name
        if not path.is_file():
            problems.append(f"{path}: missing")
        elif sha256(path) != expected:
            problems.append(f"{path}: changed since it was built")
    for path in scene_files(folder):
        name = path.relative_to(folder)
        copied = len(name.parts) > 2 and name.parts[0] in patterns and name.parts[1] in SHARED
        if name.as_posix() not in files and not copied:  # copies of what was a link are compared with the scene's
            problems.append(f"{path}: not in the manifest")
    return problems


def _check_shared(folder: Path, variant: Path) -> list[str]:
    """Does a variant have the scene's cameras and masks, by links or as copies?"""
    problems = []
    for name in SHARED:
        ours, theirs = folder / name, variant / name
        if ours.is_dir() and theirs.resolve() != ours.resolve() and _contents(theirs) != _contents(ours):
            problems.append(f"{theirs}: not the scene's {name}; remove it and run the build again")
    return problems


def _contents(folder: Path) -> dict[str, str]:
    return {path.relative_to(folder).as_posix(): sha256(path) for path in folder.rglob("*") if path.is_file()}


def _check_variant(folder: Path, pattern: str, every_view: bool) -> list[str]:
    """Is the variant complete, and do its views follow from clean views, layers and parameters?"""
    variant = folder / pattern
    images = list_images(variant / "images") if (variant / "images").is_dir() else []
    problems = _check_shared(folder, variant) + ([] if images else [f"{variant}: no views"])
    if not (variant / STATISTICS).is_file():
        problems.append(f"{variant}: no {STATISTICS}; run the build again")
    for image in tqdm(images if every_view else images[:1], desc=f"{folder.name}: {pattern}", unit="view", leave=False):
        try:
            problems += _check_view(folder, variant, image)
        except InputError as error:
            problems.append(str(error))
    return problems


def _check_view(folder: Path, variant: Path, image: Path) -> list[str]:
    """Derive one rainy view and its statistics again.

    Raises:
        InputError: a file is missing, unreadable or no such file, or of another size than its clean view.
    """
    facts, name = _read_facts(variant / "pattern.json"), image.stem
    clean, rainy = read_image(folder / CLEAN / image.name), read_image(image)
    if rainy.shape != clean.shape:
        raise InputError(f"{image}: another size than its clean view", found=rainy.shape, expected=clean.shape)
    effect, layers = find_effect(facts["effect"]), read_layers(variant / "layers" / f"{name}.exr")
    problems = [f"{variant / 'layers' / name}.exr: {what}" for what in _odd_planes(effect, layers, clean.shape[:2])]
    if problems:
        return problems
    error = float(np.abs(rainy - expected_view(facts, clean, layers)).max())
    if error > TOLERANCE:
        problems.append(f"{image}: differs by {error * 255:.1f}/255 from its clean view and layers")
    if (variant / STATISTICS).is_file():
        measured = measure_view(name, to_uint8(clean), to_uint8(rainy), layers, facts)
        problems += _check_statistics(variant / STATISTICS, measured)
    return problems


def _read_facts(path: Path) -> dict[str, Any]:
    """A variant's `pattern.json` with what its views are derived from."""
    facts = read_json(path)
    parameters = facts.get("parameters") if isinstance(facts, dict) else None
    if not isinstance(parameters, dict) or "effect" not in facts:
        raise InputError(f"{path}: not a pattern", expected='{"effect", "parameters", ...}', fix="run the build again")
    absent = set(find_effect(facts["effect"]).needed) - set(parameters)
    if absent:
        raise InputError(f"{path}: not a pattern of {facts['effect']}", found=f"no {', '.join(sorted(absent))}")
    return facts


def _odd_planes(effect: Effect, layers: Mapping[str, NDArray], shape: tuple[int, ...]) -> list[str]:
    """What is wrong with the planes of a layer file: there must be the effect's."""
    if set(layers) != set(effect.planes):
        return [f"channels {', '.join(sorted(layers))}, expected {', '.join(sorted(effect.planes))}"]
    odd = []
    for name, plane in layers.items():
        high = effect.planes[name].most
        if plane.shape != shape:
            odd.append(f"{name} has another size than the clean view")
        elif not (np.isfinite(plane).all() and plane.min() >= 0 and plane.max() <= high):
            odd.append(f"{name} is outside 0 to {high:g}")
    return odd


def expected_view(facts: Mapping[str, Any], clean: Image, layers: Mapping[str, NDArray]) -> NDArray[np.float64]:
    """The rainy view by the paper's equations, in float64 and written out anew, not by the code that built it.

    Planes S are blended (Eq. 1), in encoded values: R = (1 - S) B + beta S. Planes M, V, R, G and B cover and add
    (Eq. 2), in linear light: R = (1 - Md) B + D with Md = 1 - (1 - M) (1 - V) and D = (R, G, B). An effect with other
    planes has an equation of its own, for which there is only its own word.

    Args:
        facts: the variant's `pattern.json`.
        clean: B [H, W, 3], sRGB-encoded, [0, 1].
        layers: planes [H, W].

    Returns:
        [H, W, 3], sRGB-encoded, [0, 1].
    """
    planes = {name: plane.astype(np.float64)[..., None] for name, plane in layers.items()}
    background = clean.astype(np.float64)
    if set(planes) == set(STREAKS):
        beta = float(facts["parameters"]["brightness"])
        return (1 - planes["S"]) * background + beta * planes["S"]
    if set(planes) != set(WATER):
        return find_effect(facts["effect"]).composite(facts["parameters"], clean, layers).astype(np.float64)
    cover = 1 - (1 - planes["M"]) * (1 - planes["V"])
    light = np.where(background <= 0.04045, background / 12.92, ((background + 0.055) / 1.055) ** 2.4)
    rainy = np.clip((1 - cover) * light + np.concatenate([planes[c] for c in "RGB"], axis=2), 0, 1)
    return np.where(rainy <= 0.0031308, 12.92 * rainy, 1.055 * rainy ** (1 / 2.4) - 0.055)


def _check_statistics(path: Path, measured: ViewStatistics) -> list[str]:
    """Compare a row of a variant's statistics with what is measured now."""
    table = read_statistics(path).set_index("view")
    if measured.view not in table.index:
        return [f"{path}: no row for {measured.view}"]
    problems = []
    row = table.loc[[measured.view], NUMBERS].to_numpy(np.float64)[0]
    for name, then in zip(NUMBERS, row, strict=True):
        now = getattr(measured, name)
        if not np.isclose(np.nan if now is None else now, then, rtol=1e-3, atol=1e-4, equal_nan=True):
            problems.append(f"{path}: {name} of {measured.view} is {now}, not {then}")
    return problems

"""Whether rainy views follow from clean views, layers and parameters, and their statistics from them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.statistics import NUMBERS, STATISTICS, ViewStatistics, measure_view, read_statistics
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.rain.compositing import STREAKS, WATER
from hydroviews.rain.effect import Effect
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import find_effect
from hydroviews.scene.images import Image, list_images, read_image, to_uint8

TOLERANCE = 1 / 255  # the rainy view is an 8-bit rounding of what its layers give
PLUGIN_ERRORS = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)  # of an effect with odd values


def check_rain(folder: Path, pattern: str, every_view: bool) -> list[str]:
    """Is the variant complete, and do its views follow from clean views, layers and parameters?"""
    variant = folder / pattern
    images = list_images(variant / "images") if (variant / "images").is_dir() else []
    problems = [] if images else [f"{variant}: no views"]
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
    facts, name = read_facts(variant / PATTERN_FILE), image.stem
    clean, rainy = read_image(folder / CLEAN / image.name), read_image(image)
    if rainy.shape != clean.shape:
        raise InputError(f"{image}: another size than its clean view", found=rainy.shape, expected=clean.shape)
    effect, layers = find_effect(facts["effect"]), read_layers(variant / "layers" / f"{name}.exr")
    problems = [f"{variant / 'layers' / name}.exr: {what}" for what in _odd_planes(effect, layers, clean.shape[:2])]
    if problems:
        return problems
    try:
        error = float(np.abs(rainy - expected_view(facts, clean, layers)).max())
        measured = measure_view(name, to_uint8(clean), to_uint8(rainy), layers, facts)
    except PLUGIN_ERRORS as what:
        raise InputError(f"{variant / 'pattern.json'}: parameters that {facts['effect']} has not", found=what) from what
    if not error <= TOLERANCE:
        problems.append(f"{image}: differs by {error * 255:.1f}/255 from its clean view and layers")
    if (variant / STATISTICS).is_file():
        problems += _check_statistics(variant / STATISTICS, measured)
    return problems


def read_facts(path: Path) -> dict[str, Any]:
    """A variant's `pattern.json` with what its views are drawn and derived from.

    Raises:
        InputError: it is not a pattern.
    """
    facts = read_json(path)
    parameters = facts.get("parameters") if isinstance(facts, dict) else None
    if not isinstance(parameters, dict) or not isinstance(facts.get("effect"), str):
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
        low, high = effect.planes[name].least, effect.planes[name].most
        if plane.shape != shape:
            odd.append(f"{name} has another size than the clean view")
        elif not (np.isfinite(plane).all() and plane.min() >= low and plane.max() <= high):
            odd.append(f"{name} is outside {low:g} to {high:g}")
    return odd


def expected_view(facts: Mapping[str, Any], clean: Image, layers: Mapping[str, NDArray]) -> NDArray[np.float64]:
    """The rainy view by the paper's equations, in float64 and written out anew, not by the code that built it.

    Planes S are blended (Eq. 1), in encoded values: R = (1 - S) B + beta S. Planes M, V, R, G and B cover and add
    (Eq. 2), in linear light: R = (1 - Md) B + D with Md = 1 - (1 - M) (1 - V) and D = (R, G, B). An effect with other
    planes, or one that blurs the scene, has an equation of its own, for which there is only its own word.

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
    blurred = facts["parameters"].get("focus") == "drops" or "mist_blur" in facts["parameters"]
    if set(planes) != set(WATER) or blurred:
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
    try:
        row = table.loc[[measured.view], NUMBERS].to_numpy(np.float64)[0]
    except ValueError as error:
        raise InputError(f"{path}: not a table of statistics", found=error) from None
    problems = []
    for name, then in zip(NUMBERS, row, strict=True):
        now = getattr(measured, name)
        if not np.isclose(np.nan if now is None else now, then, rtol=1e-3, atol=1e-4, equal_nan=True):
            problems.append(f"{path}: {name} of {measured.view} is {now}, not {then}")
    return problems

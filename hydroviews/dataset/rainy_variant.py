"""One rainy variant of a built scene: images, what was added, every parameter, cameras to open it with."""

import json
import math
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from hydroviews.dataset.drawing_code import VERSION, drawing_code
from hydroviews.dataset.statistics import STATISTICS, write_statistics
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import read_json, replacing, write_json
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.writers import write_nerfstudio
from hydroviews.rain.effect import Effect, PreparedRain, Rain, fall
from hydroviews.rain.layers import write_layers
from hydroviews.rain.patterns import PATTERN_FILE, Pattern
from hydroviews.rain.registry import find_effect
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import read_image, write_png
from hydroviews.scene.masks import MASKS
from hydroviews.scene.scenes import Scene, View

LENS = ".lens"  # keeps what was prepared, beside the views
SHARED = ("sparse", MASKS)  # of a scene: the same in all its variants
FOCAL_STEP = 1.1  # factor between focal lengths that are told apart by water on the lens
Optics = tuple[int, int, int] | None  # width, height and focal length that rain is prepared for; None: any


def write_variant(scene: Scene, folder: Path, pattern: Pattern, statistics: SceneStatistics) -> None:
    """Write the views of a scene in this rain, and their statistics.

    What is there is kept if it was made with the same parameters by the same code.
    """
    variant, effect = folder / pattern.name, find_effect(pattern.effect)
    rain = effect.place(effect.draw(pattern, statistics), pattern, statistics)
    facts = {"effect": pattern.effect, "index": pattern.index, "grade": pattern.grade, "seed": statistics.seed}
    made = {"generator": VERSION, "drawing_code": drawing_code(effect)}
    _take_variant(variant, {**facts, **made, "parameters": rain.parameters})
    _write_views(scene, variant, effect, rain)
    link_shared(variant)
    write_nerfstudio(scene, variant / "transforms.json", "images")
    write_statistics(folder, pattern.name)


def _write_views(scene: Scene, variant: Path, effect: Effect, rain: Rain) -> None:
    """Write the views, those of one size and focal length after those of another: what is prepared may be large."""
    with tqdm(total=len(scene.views), desc=f"{scene.name}: {variant.name}", unit="view") as bar:
        for views in by_optics(scene.views, effect):
            camera = views[0].camera
            lens = variant / LENS / f"{camera.width}x{camera.height}-{_focal(camera):.0f}px"
            prepared = rain.prepare(camera, lens)
            for view in views:
                _write_rainy(view, variant, effect, rain, prepared)
                bar.update()


def by_optics(views: Sequence[View], effect: Effect) -> list[list[View]]:
    """The views in groups for which rain is prepared once, with the camera of the first in each."""
    groups: dict[Optics, list[View]] = {}
    for view in views:
        groups.setdefault(_optics(view.camera) if effect.needs_optics else None, []).append(view)
    return list(groups.values())


def _optics(camera: Camera) -> Optics:
    return camera.width, camera.height, round(math.log(_focal(camera)) / math.log(FOCAL_STEP))


def _focal(camera: Camera) -> float:
    return math.sqrt(camera.fx * camera.fy)


def _take_variant(variant: Path, facts: Mapping[str, Any]) -> None:
    """Write `pattern.json` before any view, and drop the views that an interrupted build made with other parameters."""
    path = variant / PATTERN_FILE
    try:
        earlier = read_json(path) if path.is_file() else None
    except InputError:
        earlier = None
    if same_values(earlier, json.loads(json.dumps(facts))):
        return
    for name in ("images", "layers", LENS):
        ownership.clear(variant / name)
    ownership.remove(variant / STATISTICS)
    write_json(path, facts)


def same_values(one: Any, other: Any) -> bool:
    """Whether two JSON values are the same, but for what another machine's arithmetic rounds otherwise."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same_values(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same_values, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-6, abs_tol=1e-9)
    return bool(one == other)


def _write_rainy(view: View, variant: Path, effect: Effect, rain: Rain, prepared: PreparedRain) -> None:
    image, layer = variant / "images" / f"{view.name}.png", variant / "layers" / f"{view.name}.exr"
    if image.is_file() and layer.is_file():
        return
    clean = read_image(view.path)
    layers = fall(prepared, clean, view)
    write_layers(layer, layers)
    write_png(image, effect.composite(rain.parameters, clean, layers))


def write_captured(scene: Scene, folder: Path) -> None:
    """Make a project of the photographs on which it rained."""
    variant = folder / CAPTURED
    link_shared(variant)
    write_nerfstudio(scene, variant / "transforms.json", "images")
    effect, _, index = CAPTURED.rpartition("-")
    if not (variant / PATTERN_FILE).is_file():
        write_json(variant / PATTERN_FILE, {"effect": effect, "index": int(index), "generator": VERSION})


def link_shared(variant: Path) -> None:
    """Links to the scene's cameras and masks, or copies where links cannot be made."""
    for name in SHARED:
        link = variant / name
        if link.exists() or link.is_symlink() or not (variant.parent / name).is_dir():
            continue
        try:
            ownership.enter(link)
            os.symlink(os.path.join("..", name), link)
        except OSError:  # a file system without links
            with replacing(link) as temporary:
                shutil.rmtree(temporary, ignore_errors=True)
                shutil.copytree(variant.parent / name, temporary)

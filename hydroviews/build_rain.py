"""One rainy variant of a built scene: images, what was added, every parameter, cameras to open it with."""

import os
import shutil
from pathlib import Path

from tqdm import tqdm

from hydroviews.files import replacing, write_json
from hydroviews.images import read_image, write_png
from hydroviews.manifest import GENERATOR
from hydroviews.masks import MASKS
from hydroviews.provenance import CAPTURED
from hydroviews.rain import effects
from hydroviews.rain.layers import write_layers
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.setting import Setting
from hydroviews.scenes import Scene, View
from hydroviews.statistics import write_statistics
from hydroviews.writers import write_nerfstudio


def write_variant(scene: Scene, folder: Path, pattern: Pattern, setting: Setting) -> None:
    """Write the views of a scene in this rain, and their statistics; what is there is kept."""
    variant = folder / pattern.name
    drawn = effects.draw(pattern, setting)
    prepared: dict[tuple[int, int], effects.Effect] = {}
    for view in tqdm(scene.views, desc=f"{scene.name}: {pattern.name}", unit="view"):
        camera = view.camera
        size = (camera.width, camera.height)
        if size not in prepared:  # one lens for every image size of the capture
            lens = variant / ".lens" / f"{size[0]}x{size[1]}"
            prepared[size] = effects.prepare(pattern, drawn, setting, camera, lens)
        _write_rainy(view, variant, pattern.effect, prepared[size])
    _link_shared(variant)
    write_nerfstudio(scene, variant / "transforms.json", "images")
    facts = {"effect": pattern.effect, "index": pattern.index, "grade": pattern.grade, "seed": setting.seed}
    parameters = next(iter(prepared.values())).parameters
    write_json(variant / "pattern.json", {**facts, "generator": GENERATOR, "parameters": parameters})
    write_statistics(folder, pattern.name)


def _write_rainy(view: View, variant: Path, effect: str, prepared: effects.Effect) -> None:
    image, layer = variant / "images" / f"{view.name}.png", variant / "layers" / f"{view.name}.exr"
    if image.is_file() and layer.is_file():
        return
    clean = read_image(view.path)
    layers = effects.rain_on(prepared, clean, view)
    write_layers(layer, layers)
    write_png(image, effects.composite(effect, prepared.parameters, clean, layers))


def write_captured(scene: Scene, folder: Path) -> None:
    """Make a project of the photographs on which it rained, beside which there are no clean ones."""
    variant = folder / CAPTURED
    _link_shared(variant)
    write_nerfstudio(scene, variant / "transforms.json", "images")
    effect, _, index = CAPTURED.rpartition("-")
    write_json(variant / "pattern.json", {"effect": effect, "index": int(index), "generator": GENERATOR})


def _link_shared(variant: Path) -> None:
    """Links to the scene's cameras and masks, or copies where links cannot be made."""
    for name in ("sparse", MASKS):
        link = variant / name
        if link.exists() or link.is_symlink() or not (variant.parent / name).is_dir():
            continue
        try:
            os.symlink(os.path.join("..", name), link)
        except OSError:  # a file system without links
            with replacing(link) as temporary:
                shutil.rmtree(temporary, ignore_errors=True)
                shutil.copytree(variant.parent / name, temporary)

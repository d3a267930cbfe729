"""A capture and rain patterns become a data set on disk; an interrupted build goes on where it stopped.

    <out>/<scene>/clean/*.png                 the ground truth
    <out>/<scene>/sparse/0, transforms.json   cameras and points for COLMAP and nerfstudio readers
    <out>/<scene>/split.json                  training and held-out views
    <out>/<scene>/masks/*.png.png             hidden pixels, where the capture has masks
    <out>/<scene>/<pattern>/images/*.png      rainy views; layers/*.exr what was added; pattern.json every parameter
    <out>/manifest.json                       SHA-256 of every file of the finished scenes

A capture that was taken in rain has no clean views: its own photographs are the one variant, `captured-0`.
Every file is written whole or not at all, so a file that exists is finished. What a scene was asked to be is
kept in its `request.json`: another request for the same folder is refused.
"""

import hashlib
import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from hydroviews.errors import InputError
from hydroviews.files import read_json, remove_tree, replacing, write_json
from hydroviews.images import read_image, write_png
from hydroviews.manifest import GENERATOR, forget_scene, read_manifest, record_scene
from hydroviews.masks import MASKS, mask_name, write_ignored
from hydroviews.poses import triangulate
from hydroviews.provenance import CAPTURED
from hydroviews.rain import effects
from hydroviews.rain.layers import write_layers
from hydroviews.rain.patterns import Pattern, parse_pattern
from hydroviews.rain.setting import Setting, survey
from hydroviews.scenes import Scene, View
from hydroviews.writers import write_colmap, write_nerfstudio

CLEAN = "clean"
GLIMPSE = 65536  # bytes


@dataclass(frozen=True)
class Request:
    """What fixes the pixels of a built scene, beside the patterns."""

    source: str  # the name or folder it was built from, for people
    capture: str  # fingerprint of the capture's cameras
    long_side: int | None
    seed: int
    generator: str = GENERATOR


def build(
    scene: Scene,
    out: Path,
    *,
    patterns: Sequence[Pattern],
    long_side: int | None = None,
    seed: int = 0,
    source: str = "",
    overwrite: bool = False,
) -> Path:
    """Build a scene's clean views and rainy variants under `out`; what is finished is kept.

    Args:
        scene: the capture at its own size.
        out: the data folder; the scene goes to `out/<scene.name>`.
        patterns: which rains; none builds the clean views and cameras alone.
        long_side: pixels of the built views' longer side; never larger than the capture.
        seed: of everything that is drawn.
        source: what the user called the capture.
        overwrite: drop a scene that was built from another request.

    Returns:
        The scene's folder.

    Raises:
        InputError: the folder holds a scene built otherwise, an image is unreadable, or the disk is full.
    """
    if long_side is not None and long_side < 1:
        raise InputError(f"long side of {long_side} pixels", expected="at least 1")
    folder = out / scene.name
    _refuse_own_capture(scene, folder)
    if scene.captured_rainy and patterns:
        raise InputError(
            f"{scene.name}: taken in rain, there are no clean views to add {patterns[0].name} to",
            fix="build it without patterns (leave PATTERNS out)",
        )
    request = Request(source or scene.name, _fingerprint(scene), long_side, seed)
    _claim(out, folder, request, overwrite)
    entry = read_manifest(out)["scenes"].get(scene.name, {"patterns": [], "files": {}})
    built = set(entry["patterns"])
    if entry["files"] and {p.name for p in patterns} <= built and all((folder / f).is_file() for f in entry["files"]):
        return folder
    images = f"{CAPTURED}/images" if scene.captured_rainy else CLEAN
    clean = _write_views(scene.resized(long_side), folder, images)
    _write_cameras(clean, folder, scene, images)
    if scene.captured_rainy:
        _write_captured(clean, folder)
    rains = sorted({*patterns, *map(parse_pattern, built)})  # those of an earlier call too: a file may be missing
    if rains:
        setting = survey(scene.name, seed, clean.views, clean.points, len(clean.split.train))
        for pattern in rains:
            _write_variant(clean, folder, pattern, setting)
    names = [pattern.name for pattern in rains]
    facts = {"seed": seed, "long_side": long_side, "source": request.source, "views": len(clean.views)}
    record_scene(out, scene.name, {**facts, "notes": list(scene.notes), "patterns": names})
    return folder


def _refuse_own_capture(scene: Scene, folder: Path) -> None:
    """A build must not write into the capture that it reads."""
    target = folder.resolve()
    inside = [view.path for view in scene.views if target in view.path.resolve().parents]
    if inside:
        raise InputError(
            f"{folder}: the capture itself would be overwritten by what is built from it",
            found=f"its images, such as {inside[0]}",
            fix="choose another --out, outside the folder that holds the capture",
        )


def _fingerprint(scene: Scene) -> str:
    """Changes when the capture's views, cameras, points, split or image files do."""
    digest = hashlib.sha256(json.dumps(asdict(scene.split)).encode())
    digest.update(np.ascontiguousarray(scene.points.positions, np.float64).round(9).tobytes())
    digest.update(np.ascontiguousarray(scene.points.colours).tobytes())
    for view in scene.views:
        camera = view.camera
        pose = [round(x, 9) for x in camera.world_to_camera.ravel().tolist()]
        facts = [view.name, camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, pose]
        digest.update(json.dumps(facts).encode() + _glimpse(view.path))
        digest.update(_glimpse(view.mask) if view.mask else b"")
    return digest.hexdigest()[:16]


def _glimpse(path: Path) -> bytes:
    """Size, beginning and end of a file: enough to see that it is another one, cheap for large captures."""
    if not path.is_file():
        return b"missing"
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(GLIMPSE)
        file.seek(max(0, size - GLIMPSE))
        return str(size).encode() + start + file.read()


def _claim(out: Path, folder: Path, request: Request, overwrite: bool) -> None:
    """Take the folder for this request; what another request left there is refused, or dropped to overwrite it."""
    path = folder / "request.json"
    wanted = vars(request)
    if path.is_file():
        earlier = read_json(path)
        changed = {k: (earlier.get(k), v) for k, v in wanted.items() if k != "source" and earlier.get(k) != v}
        if not changed:
            return
        if not overwrite:
            raise InputError(
                f"{folder}: this scene was built from another request",
                found="; ".join(f"{key} {old}" for key, (old, _) in changed.items()),
                expected="; ".join(f"{key} {new}" for key, (_, new) in changed.items()),
                fix="choose another --out, or add --overwrite to build it anew",
            )
        forget_scene(out, folder.name)
        remove_tree(folder)
    elif folder.is_dir() and any(not p.name.startswith(".") for p in folder.iterdir()):
        raise InputError(
            f"{folder}: holds files that no build wrote",
            found=f"{len(list(folder.iterdir()))} files and no {path.name}",
            fix="choose another --out, or remove that folder",
        )
    write_json(path, wanted)


def _write_views(scene: Scene, folder: Path, images: str) -> Scene:
    """Write the views, and what masks hide of them, at their final size; returns the scene that reads from them."""
    views = []
    for view in tqdm(scene.views, desc=f"{scene.name}: {images.partition('/')[0]} views", unit="view"):
        path = folder / images / f"{view.name}.png"
        if not path.is_file():
            write_png(path, view.image())
        views.append(View(view.name, view.camera, path, mask=_write_mask(view, folder)))
    return replace(scene, views=tuple(views))


def _write_mask(view: View, folder: Path) -> Path | None:
    """Write what is hidden of a view, if anything may be; returns the file."""
    path = folder / MASKS / mask_name(f"{view.name}.png")
    ignored = None if path.is_file() else view.ignored()
    if ignored is not None:
        write_ignored(path, ignored)
    return path if view.mask else None


def _write_cameras(scene: Scene, folder: Path, capture: Scene, images: str) -> None:
    """Write cameras, points and split; a capture without points gets some from its full-size photographs."""
    if not (folder / "sparse" / "0").is_dir():
        points = scene.points if len(scene.points) else triangulate(capture, folder / ".triangulation")
        write_colmap(replace(scene, points=points), folder / "sparse" / "0")
    shutil.rmtree(folder / ".triangulation", ignore_errors=True)
    write_nerfstudio(scene, folder / "transforms.json", images)
    write_json(folder / "split.json", asdict(scene.split))


def _write_variant(scene: Scene, folder: Path, pattern: Pattern, setting: Setting) -> None:
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


def _write_rainy(view: View, variant: Path, effect: str, prepared: effects.Effect) -> None:
    image, layer = variant / "images" / f"{view.name}.png", variant / "layers" / f"{view.name}.exr"
    if image.is_file() and layer.is_file():
        return
    clean = read_image(view.path)
    layers = effects.rain_on(prepared, clean, view)
    write_layers(layer, layers)
    write_png(image, effects.composite(effect, prepared.parameters, clean, layers))


def _write_captured(scene: Scene, folder: Path) -> None:
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

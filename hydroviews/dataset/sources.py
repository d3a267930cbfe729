"""Captures by name or folder, built at a profile's size."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hydroviews.blender.embedded_scenes.captures import EMBEDDED, VERSION, read_embedded, render_embedded
from hydroviews.captures.catalogue.catalogue import (
    Capture,
    MissingCapture,
    NoCapture,
    all_captures,
    captures_root,
    find_captures,
    locate,
)
from hydroviews.captures.packed.archives import forget_unpacked, unpack
from hydroviews.dataset.build import build
from hydroviews.dataset.drop_masks import write_drop_masks
from hydroviews.dataset.manifest import MANIFEST
from hydroviews.dataset.request import REQUEST
from hydroviews.dataset.sharing.fetched import find_fetched, unfit
from hydroviews.errors import InputError, unknown_name
from hydroviews.files.atomic import is_there, read_json
from hydroviews.files.locks import BUSY, locked
from hydroviews.files.temporary import remove_leftovers
from hydroviews.formats.paired.pictures import find_pictures
from hydroviews.formats.photographs import FOLDERS, photographs_below
from hydroviews.formats.read import no_folder, read_scene
from hydroviews.profiles import Profile, require_long_side, require_seed
from hydroviews.rain.registry import choose_patterns
from hydroviews.rain.scene_statistics import LensRenderer
from hydroviews.scene.images import image_size
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)

RENDERED = "captures"  # embedded scenes as rendered, beside the built ones
RESERVED = (MANIFEST, RENDERED)  # what a data folder holds beside its scenes


def find_capture(
    source: str, rendered: Path, views: int, long_side: int, captures: Path | None = None, *, render: bool = False
) -> Scene:
    """The capture of that name, unpacked or rendered if it is an embedded scene, or the one in that folder.

    Args:
        source: an embedded scene (courtyard), a published one (mipnerf360/garden, or garden alone), or a folder with
            a COLMAP, nerfstudio, LLFF or NSVF capture, given by its path or its name in the captures' folder.
        rendered: where embedded scenes are rendered.
        views: number of views of an embedded scene.
        long_side: pixels of the longer side that is wanted, and an embedded scene's width.
        captures: the folder with published captures; see `catalogue.captures_root`.
        render: render an embedded scene even if the package has it as rendered.

    Raises:
        InputError: neither a name nor a folder, a capture that is not on this machine, or an unreadable one.
    """
    if source in EMBEDDED:
        width, height = long_side, max(1, long_side * 3 // 4)
        folder = rendered / f"{source}-{views}-{width}x{height}"
        with locked(folder, BUSY):
            remove_leftovers(folder)
            if render:
                forget_unpacked(folder)
            else:
                unpack(folder, VERSION)
            render_embedded(source, folder, views, width, height, seed=0)
        if Path(source).is_dir():
            logger.info("%s: the embedded scene; the folder of that name here is ./%s", source, source)
        return read_embedded(source, folder)
    if render:
        raise InputError(f"SCENE={source}: not rendered here", expected=f"with --render one of {', '.join(EMBEDDED)}")
    root = captures_root(captures)
    published = find_captures(source)
    if len(published) == 1:
        return _read_published(published[0], source, root, long_side)
    if published:
        names = ", ".join(capture.name for capture in published)
        raise InputError(f"SCENE={source}: several captures have this name", expected=f"one of {names}")
    for folder in (Path(source), root / source):
        if source and folder.is_dir():
            return read_scene(folder)
    if source and Path(source).is_file():
        raise no_folder(Path(source))
    known = (*EMBEDDED, *(capture.name for capture in all_captures()))
    if "/" in source and source.split("/")[0] not in {name.split("/")[0] for name in known}:  # meant as a path
        wanted = f"a folder with images and cameras, below {Path.cwd()} or {root}"
        raise NoCapture(f"SCENE={source}: no such folder", expected=wanted)
    otherwise = f"a folder with images and cameras, here or in {root}"
    raise NoCapture(unknown_name(f"SCENE={source}", source, "capture", known, otherwise))


def _read_published(capture: Capture, source: str, root: Path, long_side: int) -> Scene:
    """A published capture below `root`, or in the folder `source` where that is one too."""
    folder = locate(capture, root) or (Path(source) if Path(source).is_dir() else None)
    if folder is None:
        raise MissingCapture(capture, root)
    pictures = find_pictures(folder)
    images, notes = (None, []) if pictures and pictures.together else choose_images(folder, capture.images, long_side)
    scene = read_scene(folder, capture.folder_name, images)
    if Path(source).is_dir():
        logger.info("%s: read from %s", source, folder)  # no note: notes are handed on with the data
        notes.append(f"read as the published {capture.name}; a folder of your own is ./{source}")
    rainy = scene.captured_rainy or capture.captured_rainy
    return replace(scene, notes=(*scene.notes, *notes), captured_rainy=rainy)


def choose_images(folder: Path, published: str, long_side: int) -> tuple[str | None, list[str]]:
    """Which of a capture's folders of photographs to read: none larger than needed.

    Args:
        folder: the capture, which may hold the same photographs at several sizes.
        published: the folder that results at full size are published for.
        long_side: pixels that are wanted.

    Returns:
        The smallest folder with photographs of at least `long_side` pixels that is not larger than the published one,
        else the published one, else the smallest one larger than that; None where there is none of the usual names.
        And a note where it is not what results are published for.
    """
    sizes = {name: max(image_size(files[0])) for name in FOLDERS if (files := _photographs(folder / name))}
    if published not in sizes:
        enough = [name for name in sizes if sizes[name] >= long_side]
        chosen = min(enough, key=sizes.__getitem__) if enough else max(sizes, key=sizes.__getitem__, default=None)
        return chosen, [f"no {published}, for which results are published: views come from {chosen}"] if chosen else []
    fitting = [name for name in sizes if long_side <= sizes[name] <= sizes[published]]
    return min(fitting, key=sizes.__getitem__) if fitting else published, []


def _photographs(folder: Path) -> list[Path]:
    return photographs_below(folder) if folder.is_dir() else []


def build_source(
    source: str,
    out: Path,
    profile: Profile,
    *,
    patterns: Sequence[str] = (),
    all_patterns: bool = False,
    long_side: int | None = None,
    seed: int | None = None,
    lens_renderer: LensRenderer | None = None,
    overwrite: bool = False,
    repair: bool = False,
    captures: Path | None = None,
    render: bool = False,
) -> Path:
    """Build a capture and the named patterns under `out`; keeps what is there.

    Args:
        source: see `find_capture`.
        out: the data folder.
        profile: sizes and counts where nothing else is said.
        patterns: names such as raindrop-0; none builds the clean views alone.
        all_patterns: where none is named, the profile's patterns; a capture that was taken in rain gets none.
        long_side: pixels, instead of the profile's.
        seed: of the rain; a scene that is already there keeps its own if None.
        lens_renderer: "disk", "aperture" or "traced"; a scene that is already there keeps its own.
        overwrite: drop what was built from another request or drawn by other code.
        repair: make changed files of a finished scene again.
        captures: the folder with published captures.
        render: see `find_capture`.

    Returns:
        The built scene's folder.

    Raises:
        InputError: no such capture or pattern, a capture that cannot be read, settings that cannot be, or a scene
            that is there from another request.
    """
    require_long_side(long_side)
    require_seed(seed)
    long_side = profile.long_side if long_side is None else long_side
    named = choose_patterns(patterns, ())  # refuses a wrong name before anything is rendered
    usual = choose_patterns((), profile.patterns if all_patterns else ())
    fresh = overwrite or repair or render
    fetched = None if fresh else find_fetched(source, out, named, usual, long_side, seed, lens_renderer)
    if fetched:
        return fetched
    try:
        found = find_capture(source, out / RENDERED, profile.embedded_views, long_side, captures, render=render)
    except NoCapture as error:
        raise unfit(source, out) or error from error
    scene = _beside(RESERVED, found)
    for note in scene.notes:
        logger.info("%s: %s", scene.name, note)
    with locked(out / scene.name, BUSY):
        remove_leftovers(out / MANIFEST)
        built = _built_request(out / scene.name, overwrite)
        folder = build(
            scene,
            out,
            patterns=named or (() if scene.captured_rainy else usual),
            long_side=long_side,
            seed=built.get("seed", 0) if seed is None else seed,
            lens_renderer=lens_renderer or built.get("lens_renderer", "disk"),
            source=source,
            overwrite=overwrite,
            repair=repair,
        )
        if scene.captured_rainy:
            write_drop_masks(scene, folder, scene.resized(long_side).own_views)
    return folder


def _beside(reserved: Sequence[str], scene: Scene) -> Scene:
    """The scene, under another name and with a note where its own is one of those reserved."""
    if scene.name not in reserved:
        return scene
    name = f"{scene.name}-scene"
    note = f"built as {name}: a data folder has another thing called {scene.name}"
    return replace(scene, name=name, notes=(*scene.notes, note))


def _built_request(folder: Path, overwrite: bool) -> dict[str, Any]:
    """What a scene that is already there was asked to be; empty where none is, or one to overwrite that is damaged."""
    path = folder / REQUEST
    try:
        request = read_json(path, fix="add --overwrite to build the scene anew") if is_there(path) else {}
    except InputError:
        if not overwrite:
            raise
        request = {}
    return request if isinstance(request, dict) else {}

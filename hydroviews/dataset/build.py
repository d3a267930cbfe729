"""A capture and rain patterns become a data set on disk; an interrupted build goes on where it stopped.

    <out>/<scene>/clean/*.png                 the ground truth
    <out>/<scene>/sparse/0, transforms.json   cameras and points for COLMAP and nerfstudio readers
    <out>/<scene>/split.json                  training and held-out views
    <out>/<scene>/depth/*.exr                 z-depth, where the capture has it
    <out>/<scene>/masks/*.png.png             hidden pixels, where the capture has masks
    <out>/<scene>/<pattern>/images/*.png      rainy views; layers/*.exr what was added; pattern.json every parameter
    <out>/<scene>/**/statistics.csv           what rain did to every view; README.md says it in words
    <out>/manifest.json                       SHA-256 of every file of the finished scenes

Of a capture that was taken in rain its own photographs are the one variant, `captured-0`, and `clean` holds the clean
photographs that it may have beside them.
Every file is written whole or not at all, so a file that exists is finished. What a scene was asked to be is
kept in its `request.json`: another request for the same folder is refused. So is adding to a scene that other code drew
(see `drawing_code`), since its variants would differ by more than their rain; a scene with all that is wanted stays.
A finished scene is compared with the manifest before it is kept or added to (see `repair`), and made read-only.
"""

import logging
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hydroviews.blender.embedded_scenes.captures import EMBEDDED
from hydroviews.dataset.card.card import CARD, LICENCE, find_licence, keep_licence, stated_licence, write_card
from hydroviews.dataset.checks.repair import damaged_files, drop_or_refuse, require_request, unchanged
from hydroviews.dataset.clean_views import CLEAN, write_cameras, write_views
from hydroviews.dataset.drawing_code import VERSION, drawing_code
from hydroviews.dataset.manifest import forget_scene, read_manifest, record_files, record_scene
from hydroviews.dataset.rainy_variant import link_shared, write_captured, write_variant
from hydroviews.dataset.request import (
    REQUEST,
    WHOLE,
    BuildRequest,
    drawn_otherwise,
    make_request,
    refuse_own_capture,
    take_folder,
)
from hydroviews.dataset.statistics import write_statistics, write_summary
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.mask_files.hidden_share import scene_hidden_notes
from hydroviews.rain.patterns import PATTERN_FILE, Pattern
from hydroviews.rain.registry import parse_pattern
from hydroviews.rain.scene_statistics import LensRenderer, survey
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)

SAID = ("metres_per_unit", "clean_error", "drops_cost")  # by a capture of itself: rain is drawn with it


def build(
    scene: Scene,
    out: Path,
    *,
    patterns: Sequence[Pattern],
    long_side: int | None = None,
    seed: int = 0,
    lens_renderer: LensRenderer = "disk",
    source: str = "",
    overwrite: bool = False,
    repair: bool = False,
) -> Path:
    """Build a scene's clean views and rainy variants under `out`; what is finished is kept.

    Args:
        scene: the capture at its own size.
        out: the data folder; the scene goes to `out/<scene.name>`.
        patterns: which rains; none builds the clean views and cameras alone.
        long_side: pixels of the built views' longer side; never larger than the capture.
        seed: of everything that is drawn.
        lens_renderer: how water on the lens is drawn, fast ("disk"), accurate ("aperture") or traced.
        source: what the user called the capture.
        overwrite: drop what was built from another request or drawn by other code.
        repair: make files again that are no longer what the manifest says, instead of refusing the scene.

    Returns:
        The scene's folder.

    Raises:
        InputError: the folder holds a scene built otherwise, something is missing in a scene that other code drew, a
            licence in `capture.json` is none, a file has changed since it was built, an image is unreadable, masks
            hide everything, or the disk is full.
    """
    if long_side is not None and long_side < 1:
        raise InputError(f"long side of {long_side} pixels", expected="at least 1")
    folder = out / scene.name
    refuse_own_capture(scene, folder)
    if scene.captured_rainy and patterns:
        raise InputError(
            f"{scene.name}: taken in rain, and {patterns[0].name} is not added to that",
            fix="build it without patterns (leave PATTERNS out)",
        )
    request = make_request(scene, source, long_side, seed, lens_renderer)
    licence = None if request.source in EMBEDDED else stated_licence(scene)  # a wrong one is told before rain is drawn
    entry = _take_over(out, folder, request, overwrite)
    before = _before(folder, entry, {pattern.name for pattern in patterns}, overwrite, repair)
    if before.finished:
        if licence and licence != find_licence(folder):
            _take_licence(scene, folder, entry)
        return folder
    facts = _write(scene, folder, request, patterns, before)
    record_scene(out, scene.name, facts, unchanged(folder, entry, before.redrawn))
    return folder


class Before(NamedTuple):
    """What there is of a scene before it is built."""

    entry: Mapping[str, Any]  # what the manifest says of it
    outdated: Sequence[str]  # its variants, or WHOLE, that other code drew
    redrawn: Sequence[str]  # those of them that are to be drawn anew
    finished: bool  # whether all that is wanted is there


def _before(folder: Path, entry: Mapping[str, Any], wanted: set[str], overwrite: bool, repair: bool) -> Before:
    """Look at a scene's folder; what is damaged there is removed, to be made again, or refused."""
    for name in filter(lambda name: (folder / name).is_dir(), entry["patterns"]):
        link_shared(folder / name)
    damaged = damaged_files(folder, entry, wanted, described=repair)
    outdated = drawn_otherwise(folder, [n for n in entry["patterns"] if folder / n / PATTERN_FILE not in damaged])
    redrawn = outdated if overwrite else []
    damaged = [path for path in damaged if path.relative_to(folder).parts[0] not in redrawn]
    drop_or_refuse(folder, damaged, repair, repairable=not outdated)
    finished = wanted <= set(entry["patterns"]) and _are_there(folder, entry["files"])
    if outdated and not overwrite:
        _keep_or_refuse(folder, outdated, finished)
    return Before(entry, outdated, redrawn, finished and not redrawn)


def _write(
    scene: Scene, folder: Path, request: BuildRequest, patterns: Sequence[Pattern], before: Before
) -> dict[str, Any]:
    """Write what is missing of a scene, and its card; what the manifest is to say of it beside its files."""
    small = scene.resized(request.long_side)
    for note in scene_hidden_notes(small):
        logger.warning(note)
    images = f"{CAPTURED}/images" if scene.captured_rainy else CLEAN
    clean = write_cameras(write_views(small, folder, images), folder, scene, images)
    if scene.captured_rainy:
        write_captured(clean, folder)
    rains = sorted({*patterns, *map(parse_pattern, before.entry["patterns"])})  # those of an earlier call too
    _write_rain(clean, folder, rains, before, request)
    names = [pattern.name for pattern in rains]
    if request.source not in EMBEDDED:
        keep_licence(scene, folder)
    write_card(folder, [CAPTURED] if scene.captured_rainy else names, clean.notes)
    asked = {"seed": request.seed, "long_side": request.long_side, "source": request.source}
    made = {"views": len(clean.views), "generator": request.generator, "drawing_code": request.drawing_code}
    said = {name: getattr(scene, name) for name in SAID}
    return {**asked, **made, "capture": said, "notes": list(clean.notes), "patterns": names}


def _take_over(out: Path, folder: Path, request: BuildRequest, overwrite: bool) -> Mapping[str, Any]:
    """Take the scene's folder, and return what the manifest says of what is finished there."""
    begun = (folder / REQUEST).is_file()
    if not overwrite:
        require_request(folder)
    take_folder(out, folder, request, overwrite)
    if not begun:  # it was removed, to build it again
        forget_scene(out, folder.name)
    return read_manifest(out)["scenes"].get(folder.name, {"patterns": [], "files": {}})


def _take_licence(scene: Scene, folder: Path, entry: Mapping[str, Any]) -> None:
    """Keep the licence that a capture has stated since its scene was finished."""
    keep_licence(scene, folder)
    write_card(folder, [CAPTURED] if scene.captured_rainy else entry["patterns"], entry.get("notes", []))
    kept = [f"{LICENCE}/{file.name}" for file in (folder / LICENCE).glob("[!.]*")]
    record_files(folder.parent, folder.name, [CARD, *kept])
    logger.info("%s: the licence that the capture states now is kept", folder)


def _write_rain(clean: Scene, folder: Path, rains: Sequence[Pattern], before: Before, request: BuildRequest) -> None:
    """Write the variants that are outdated or, as the manifest's entry says, not finished; and statistics."""
    files = {rain: [name for name in before.entry["files"] if name.startswith(f"{rain.name}/")] for rain in rains}
    finished = set(before.entry["patterns"]) - set(before.outdated)
    missing = [rain for rain in rains if rain.name not in finished or not _are_there(folder, files[rain])]
    statistics = survey(clean, request.seed, request.lens_renderer) if missing else None
    for rain in rains:
        if statistics is not None and rain in missing:
            write_variant(clean, folder, rain, statistics)
        else:
            write_statistics(folder, rain.name)
    write_summary(folder)


def _keep_or_refuse(folder: Path, outdated: Sequence[str], finished: bool) -> None:
    """A finished scene that other code drew is used as it is; nothing is added to it."""
    what = ", ".join(outdated)
    if finished:
        logger.warning("%s: %s: drawn by another generator, kept; --overwrite builds anew", folder, what)
        return
    drawn = read_json(folder / (REQUEST if WHOLE in outdated else f"{outdated[0]}/pattern.json"))
    raise InputError(
        f"{folder}: {what}: drawn by another generator, and not all that is wanted is there",
        found=f"{drawn.get('generator')}, drawing code {drawn.get('drawing_code', 'not recorded')}",
        expected=f"{VERSION}, drawing code {drawing_code()}",
        fix="add --overwrite to build it anew, choose another --out, or evaluate only on the rain that is there",
    )


def _are_there(folder: Path, files: Collection[str]) -> bool:
    """Whether there are any, and each of them is a file in the folder."""
    return bool(files) and all((folder / name).is_file() for name in files)

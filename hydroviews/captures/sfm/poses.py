"""Structure from motion with pycolmap: cameras for photographs, and points for cameras without any."""

import logging
import shutil
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import pycolmap
from tqdm import tqdm

from hydroviews.captures.exif_orientation import common_turn
from hydroviews.captures.panoramas import cut_panoramas, is_panorama, perspective_sources
from hydroviews.captures.sfm import matching, pairs, rain
from hydroviews.captures.sfm.lens import without_lens
from hydroviews.captures.sfm.mapping import (
    MINIMUM,
    map_photographs,
    mapping_options,
    rainy_options,
    settled,
    warn_of_chance,
)
from hydroviews.captures.sfm.room import DATABASE, LEARNED, room_for
from hydroviews.captures.sfm.sequence import leave_out_contradictions
from hydroviews.captures.sfm.sources import (
    WORKING_FILES,
    forget_other_photographs,
    link_names,
    link_photographs,
    refuse_foreign,
    without_blanks,
)
from hydroviews.errors import InputError
from hydroviews.files.atomic import listing, read_json
from hydroviews.files.ownership import enter_all
from hydroviews.files.settings_guard import claim_folder
from hydroviews.formats.colmap import reliable
from hydroviews.formats.colmap_format import SparsePoints
from hydroviews.formats.photographs import photographs_below, unreadable_photographs
from hydroviews.formats.read import read_scene
from hydroviews.formats.writers import to_colmap_camera
from hydroviews.scene.images import SUFFIXES, image_size, write_png
from hydroviews.scene.masks import MASKS, mask_digest, mask_name
from hydroviews.scene.photograph_damage import require_whole
from hydroviews.scene.scenes import Points, Scene

logger = logging.getLogger(__name__)

Matcher = Literal["auto", "exhaustive", "sequential"]
FeatureKind = Literal["auto", "learned", "sift"]

SETTINGS, PERSPECTIVE = "poses.json", "perspective"
ADVICE = (
    "take more photographs, each sharing at least two thirds of what it shows with the next and taken from "
    "another place, beside and not behind the last one; blurred ones, bare walls and mirrors do not register"
)


def estimate_poses(
    images: Path,
    out: Path,
    camera_model: str = "SIMPLE_RADIAL",
    matcher: Matcher = "auto",
    seed: int = 0,
    masks: Path | None = None,
    advice: str = ADVICE,
    rainy: bool = False,
    enhance: rain.Enhance | None = None,
    features: FeatureKind = "auto",
) -> Scene:
    """Estimate a camera for each photograph in `images` and write the capture `out`.

    Features, matches, then incremental mapping, all on the CPU but for learned features where there is a GPU. Finished
    work is kept in `out`: the same call resumes after an interruption, and returns at once when all is done.
    Photographs may be mended and added until cameras are found.

    Args:
        images: folder of the photographs and of folders with more. Panoramas are cut into perspective photographs.
        out: gets `images`, `sparse/0` (the largest model, then the others), `database.db` and `poses.json`. `images`
            has links; it has copies where links cannot be made, and copies turned upright where Exif says so of all
            photographs alike and there are no masks. Links follow photographs that were moved. What is cut out of
            panoramas is in `perspective`.
        camera_model: COLMAP's name; photographs of one size and, as Exif says, of one lens at one zoom share a camera.
        matcher: "exhaustive" matches all pairs, "sequential" neighbours in the order of names, with loop closure;
            "auto" is exhaustive for up to `pairs.EXHAUSTIVE_LIMIT` photographs; with learned features, pairs are those
            that have most in common.
        seed: of the random sampling. After an interruption mapping resumes from a snapshot, which changes more than
            the last digits.
        masks: folder with a mask for every photograph, by COLMAP's names (see `hydroviews.scene.masks`); no features
            are detected in hidden pixels.
        advice: what to do if too few photographs register, for the error.
        rainy: of SIFT, leave out features that stay in one place of the lens, take less distinct matches and fewer of
            them for a view (see `rain`), and adjust the cameras again without what does not fit. Learned features are
            treated so in dry weather, too.
        enhance: takes the rain out of a picture of any size: float32 [H, W, 3], sRGB-encoded, [0, 1], to the same
            shape; only where it is `rainy`. Features are those of pictures enhanced so.
        features: "learned" (XFeat, matched by LighterGlue), which withstand rain, or "sift"; "auto" takes those that
            `out` was begun with, else learned ones where it is `rainy` and their weights can be had.

    Returns:
        The scene that `read_scene(out)` gives, with the number of registered photographs in its notes.

    Raises:
        TooFewRegistered: fewer than three.
        FullDisk: no room for features and matches.
        InputError: fewer than three photographs, one that is damaged or cannot be read, or `out` was made otherwise,
            lies among the photographs, or holds photographs, a database or a model of somebody else's; in rain, nothing
            but features that stay on the lens, or an enhanced picture of another size; no weights, but "learned".
        ValueError: to enhance, but not `rainy`.
    """
    if enhance and not rainy:
        raise ValueError("enhanced pictures are matched only where it is rainy")
    sources = photographs_below(images) if images.is_dir() else []
    if len(sources) < MINIMUM:
        other = unreadable_photographs(images) if images.is_dir() else "no such folder"
        raise InputError(
            f"{images}: {len(sources)} photographs",
            found=other or None,
            expected=f"at least {MINIMUM} ({', '.join(SUFFIXES)})",
            fix=ADVICE if images.is_dir() and not other else None,
        )
    if out.resolve().is_relative_to(images.resolve()):  # copies of photographs would be photographs the next time
        raise InputError(f"{out}: among the photographs", expected="a folder beside them", fix="choose another --out")
    around = [path for path in sources if is_panorama(path)]
    links = link_names(images, [path for path in sources if path not in set(around)])
    perspective = perspective_sources(around, out / PERSPECTIVE)
    links |= {target.name: target for target in perspective}
    learned = _use_learned(features, rainy, out / SETTINGS)
    exhaustive = _exhaustive(matcher, len(links), learned)
    settings = {"camera_model": camera_model, "exhaustive": exhaustive, "seed": seed, "images": sorted(links)}
    settings |= {"masks": mask_digest(masks) if masks else None, "rainy": rainy or None}  # None as where it lacks
    settings |= {"enhanced": enhance is not None or None, "features": "learned" if learned else None}
    settings |= {"files": listing(sources)}
    finished, pictures = (out / "sparse").is_dir(), out / "images"
    copied = [] if images.resolve() == pictures.resolve() else [pictures]  # frames of a video lie there themselves
    unfinished = [*(out / name for name in WORKING_FILES), *copied]
    refuse_foreign(out / SETTINGS, [*unfinished, out / "sparse"])
    forget_other_photographs(out / SETTINGS, settings, unfinished, finished)
    claim_folder(
        out / SETTINGS,
        settings,
        taken="holds poses that were estimated otherwise",
        foreign=None,
        fix="choose another folder, or remove this one",
    )
    if not finished:
        require_whole(sources, "looking for damage")
    cut_panoramas(perspective)
    if missing := {name: path for name, path in links.items() if not (pictures / name).exists()}:
        link_photographs(missing, pictures, turned=masks is None and common_turn(sources))
    if not finished:
        enter_all(WORKING_FILES, out)
        database, names = out / DATABASE, sorted(links)
        error = rain.tolerance(max(max(image_size(path)) for path in sources))
        with room_for(out, len(names)):
            matching.register(database, pictures, names, camera_model, shared=True, masks=masks)
            if learned:
                chosen = None if exhaustive is None else _pairs(exhaustive, len(names))
                _match_learned(out, names, chosen, seed, error, masks, enhance)
            elif rainy:
                rain.extract(database, pictures, names, camera_model, error, masks, enhance)
                rain.match(database, names, _pairs(bool(exhaustive), len(names)), seed, error)
            else:
                matching.extract(database, pictures, names, camera_model, masks)
                matching.match(database, names, _pairs(bool(exhaustive), len(names)), seed)
            if learned or rainy:
                leave_out_contradictions(database, names)
                map_photographs(out, len(names), rainy_options(seed, error), advice, partial(settled, error=error))
            else:
                map_photographs(out, len(names), mapping_options(seed), advice)
            shutil.rmtree(out / LEARNED, ignore_errors=True)
            rain.forget_parts(database)
            if learned or rainy:
                warn_of_chance(out, len(names), rainy_options(seed + 1, error))
    return read_scene(out)


def _use_learned(features: FeatureKind, rainy: bool, settings: Path) -> bool:
    """Whether features are learned ones: as given, as begun, or where it rains and there are weights."""
    from hydroviews.captures.sfm.learned.weights import require_weights

    if features != "auto":
        if features == "learned":
            require_weights()
        return features == "learned"
    if settings.is_file():
        begun = read_json(settings)
        return isinstance(begun, dict) and begun.get("features") == "learned"
    try:
        if rainy:
            require_weights()
        return rainy
    except InputError as error:
        logger.warning("SIFT features are used, which fail in much rain: there are no learned ones\n%s", error)
        return False


def _match_learned(
    out: Path,
    names: list[str],
    chosen: set[pairs.Pair] | None,
    seed: int,
    error: float,
    masks: Path | None,
    enhance: rain.Enhance | None,
) -> None:
    """Learned features of the pictures in `out`, and verified matches; chosen: see `_pairs`, None for ranked ones."""
    from hydroviews.captures.sfm.learned import extraction
    from hydroviews.captures.sfm.learned.matching import match

    pictures, folder = out / "images", out / LEARNED
    views = without_lens(pictures, extraction.extract(folder, pictures, names, masks, enhance), error)
    sizes = [image_size(pictures / name)[::-1] for name in names]
    match(out / DATABASE, folder, names, sizes, views, chosen, rain.verification_options(seed, error))


def _exhaustive(matcher: Matcher, count: int, learned: bool) -> bool | None:
    """Whether all pairs are matched, or else neighbours; None for those that have most in common."""
    if matcher == "auto" and learned:
        return None
    return matcher == "exhaustive" or (matcher == "auto" and count <= pairs.EXHAUSTIVE_LIMIT)


def _pairs(exhaustive: bool, count: int) -> set[pairs.Pair]:
    """All pairs of indices, or neighbours."""
    return pairs.all_pairs(count) if exhaustive else pairs.sequence_pairs(count)


def triangulate(scene: Scene, folder: Path, seed: int = 0) -> Points:
    """Triangulate points of a scene whose cameras are known, for captures without points.

    SIFT features of the undistorted photographs, outside masks, are matched between neighbouring views; poses and
    intrinsics stay. A call after an interruption resumes from `folder`.

    Args:
        scene: with correct cameras.
        folder: gets the undistorted photographs and the database; for one scene only.
        seed: of the verification's random sampling.

    Returns:
        Points seen by three views within two pixels; there may be none, if poses or photographs do not fit.

    Raises:
        FullDisk: no room for features and matches.
    """
    scene = scene.resized(matching.MAX_IMAGE_SIZE)
    # COLMAP's text forms have no blanks in names; the number tells "a b" from "a_b".
    names = [f"{i:05d}-{without_blanks(view.name)}.png" for i, view in enumerate(scene.views)]
    masks = folder / MASKS if any(view.mask for view in scene.views) else None
    chosen = pairs.pose_pairs(np.stack([view.camera.world_to_camera for view in scene.views]))
    database, pictures, points = (folder / name for name in (DATABASE, "images", "points"))
    with room_for(folder, len(names)):
        for name, view in zip(names, tqdm(scene.views, desc="photographs"), strict=True):
            if not (pictures / name).is_file():
                write_png(pictures / name, view.rounded())
            if masks:
                view.write_mask(masks / mask_name(name))
        matching.register(database, pictures, names, "PINHOLE", shared=False, masks=masks)
        matching.extract(database, pictures, names, "PINHOLE", masks)
        matching.match(database, names, chosen, seed)
        points.mkdir(exist_ok=True)
        options = pycolmap.IncrementalPipelineOptions(random_seed=seed)
        model = _posed_model(scene, names, database)
        return _points(pycolmap.triangulate_points(model, database, pictures, points, options=options))


def _posed_model(scene: Scene, names: list[str], database: Path) -> pycolmap.Reconstruction:
    """The scene's cameras under the ids that the database gave its images, which get the same intrinsics."""
    model = pycolmap.Reconstruction()
    with pycolmap.Database.open(database) as opened:
        for name, view in zip(names, scene.views, strict=True):
            stored = opened.read_image_with_name(name)
            if stored is None:
                raise InputError(f"{database}: made for other images", found=f"no {name}", fix="remove its folder")
            camera = to_colmap_camera(view.camera, stored.camera_id)
            opened.update_camera(camera)
            model.add_camera_with_trivial_rig(camera)
            image = pycolmap.Image(name=name, camera_id=stored.camera_id, image_id=stored.image_id)
            model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(view.camera.world_to_camera[:3]))
    return model


def _points(model: pycolmap.Reconstruction) -> Points:
    model.update_point_3d_errors()
    points = [model.points3D[i] for i in sorted(model.points3D)]
    return reliable(
        SparsePoints(
            np.array([point.xyz for point in points]).reshape(-1, 3),
            np.array([point.color for point in points], np.uint8).reshape(-1, 3),
            np.array([point.error for point in points]),
            np.array([point.track.length() for point in points], np.int64),
            np.array(sorted(model.points3D), np.int64),
        )
    )

"""A video becomes a capture: sharp frames, masks, and cameras estimated from the rainy frames themselves."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hydroviews.captures.photographs import without_camera
from hydroviews.captures.sfm.poses import SETTINGS as POSES
from hydroviews.captures.sfm.poses import FeatureKind, Matcher, estimate_poses
from hydroviews.captures.sfm.rain import Enhance
from hydroviews.captures.video.frames import FILE, IMAGES, SETTINGS, FrameChoice, take_frames
from hydroviews.captures.video.user_masks import SETTINGS as MASK_SETTINGS
from hydroviews.captures.video.user_masks import put_masks
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.formats.capture_json import FILE as CAPTURE
from hydroviews.formats.capture_json import RAINY, read_capture_json
from hydroviews.formats.photographs import some
from hydroviews.profiles import require_seed
from hydroviews.scene.masks import MASKS
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)

FEW = 0.5  # share of registered frames below which the user is warned


def capture_video(
    path: Path,
    out: Path,
    choice: FrameChoice,
    *,
    masks: Path | None = None,
    inpaint: bool = False,
    dry: bool = False,
    frames_only: bool = False,
    matcher: Matcher = "auto",
    features: FeatureKind = "auto",
    seed: int = 0,
    enhance: Enhance | None = None,
) -> Scene | None:
    """Make the capture `out` from a video; the same call resumes after an interruption.

    Args:
        path: the video.
        out: gets `images`, `masks`, `sparse`, `capture.json`, and the settings of `video.frames`, `video.user_masks`
            and `sfm.poses`.
        choice: which frames, and how large.
        masks: pixels to hide, see `video.user_masks`.
        inpaint: fill in what is hidden.
        dry: it did not rain: the frames are a clean ground truth.
        frames_only: stop before cameras are estimated, so that masks can be drawn.
        matcher: see `poses.estimate_poses`.
        features: see `poses.estimate_poses`.
        seed: see `poses.estimate_poses`.
        enhance: see `poses.estimate_poses`; not used where it is dry.

    Returns:
        The scene that `read_scene(out)` gives; None with `frames_only`.

    Raises:
        InputError: see `take_frames`, `put_masks` and `estimate_poses`; or the disk is full.
    """
    require_seed(seed)
    if inpaint and not masks:
        raise InputError("--inpaint: nothing to fill in", fix="say what to hide with --masks")
    _require_begun_alike(out, dry, masks is not None, inpaint)
    for note in take_frames(path, out, choice):
        logger.info(note)
    frames = read_json(out / FILE)["frames"]
    logger.info("%d frames in %s", len(frames), out / IMAGES)
    if masks:
        for note in put_masks(masks, out, {frame["name"]: frame["time"] for frame in frames}, inpaint):
            logger.info(note)
    elif (out / MASK_SETTINGS).is_file():
        raise InputError(f"{out}: begun with masks", fix="give the same --masks again, or choose another --out")
    rain = {"rain": "none"} if dry else RAINY
    facts = {**rain, **read_json(out / SETTINGS), "frames": len(frames), "inpainted": inpaint}
    write_json(out / CAPTURE, {**read_capture_json(out), **facts})  # what people added stays
    if frames_only:
        return None
    advice = advise(choice, masks is not None)
    hidden = out / MASKS if masks else None
    scene = estimate_poses(
        out / IMAGES,
        out,
        matcher=matcher,
        seed=seed,
        masks=hidden,
        advice=advice,
        rainy=not dry,
        features=features,
        enhance=None if dry else enhance,
    )
    return replace(
        scene, notes=(*scene.notes, *registration_notes(without_camera(scene, out / IMAGES), len(frames), advice))
    )


def _require_begun_alike(out: Path, dry: bool, masked: bool, inpaint: bool) -> None:
    """Refuse other frames than those that cameras are being estimated of, before anything of them is changed.

    Raises:
        InputError: cameras were begun in other weather, or with other masks.
    """
    begun = read_json(out / POSES) if (out / POSES).is_file() else None
    if not isinstance(begun, dict):
        return
    facts = (
        (bool(begun.get("rainy")), not dry, "in rain", "in dry weather"),
        (bool(begun.get("masks")), masked, "with masks", "without masks"),
        (bool(read_capture_json(out).get("inpainted")), inpaint, "with --inpaint", "without --inpaint"),
    )
    for earlier, now, yes, no in facts:
        if earlier != now:
            raise InputError(
                f"{out}: cameras of these frames were begun {yes if earlier else no}",
                found=f"a command {yes if now else no}",
                fix="repeat the earlier command, or choose another --out",
            )


def advise(choice: FrameChoice, masked: bool) -> str:
    """Advice for a rainy video whose frames do not register, with the options to try."""
    hide = "" if masked else "; hide people, cars and the camera's own housing with --masks"
    return (
        f"take more frames a second into another folder (--rate {2 * choice.rate:g} --out ...){hide}. "
        "Otherwise film again: walk more slowly, wipe the lens dry, shelter it, keep the light and let each place be "
        "seen from several sides. Drops on the lens and heavy streaks are matched as if they were the scene: wait for "
        "lighter rain"
    )


def registration_notes(missing: Sequence[str], frames: int, advice: str) -> list[str]:
    """Sentences about frames without a camera, with advice if they are many; none if every frame has one."""
    if not missing:
        return []
    notes = [f"{len(missing)} of {frames} frames could not be registered and are left out: {some(missing)}"]
    if len(missing) > (1 - FEW) * frames:
        notes.append(f"that is more than half: expect a poor scene, or {advice}")
    return notes

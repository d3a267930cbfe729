"""A film becomes a capture: sharp frames, masks, and cameras estimated from the rainy frames themselves."""

from dataclasses import replace
from pathlib import Path

from hydroviews.captures.sfm.poses import Matcher, estimate_poses
from hydroviews.captures.video.frames import FILE, IMAGES, SETTINGS, FrameChoice, take_frames
from hydroviews.captures.video.user_masks import SETTINGS as MASK_SETTINGS
from hydroviews.captures.video.user_masks import put_masks
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.formats.capture_json import FILE as CAPTURE
from hydroviews.formats.capture_json import RAINY
from hydroviews.scene.masks import MASKS
from hydroviews.scene.scenes import Scene

FEW = 0.5  # share of registered frames below which the capture is doubtful


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
    seed: int = 0,
) -> Scene | None:
    """Make the capture `out` from a film; what is finished is kept, so the same call goes on.

    Args:
        path: the film.
        out: gets `images`, `masks`, `sparse`, `capture.json` and what `frames`, `privacy` and `poses` keep.
        choice: which frames, and how large.
        masks: what to hide, see `privacy`.
        inpaint: fill in what is hidden.
        dry: it did not rain: the frames are a clean ground truth.
        frames_only: stop before cameras are estimated, so that masks can be drawn.
        matcher: see `poses.estimate_poses`.
        seed: see `poses.estimate_poses`.

    Returns:
        The scene that `read_scene(out)` gives; None with `frames_only`.

    Raises:
        InputError: see `take_frames`, `put_masks` and `estimate_poses`.
    """
    if inpaint and not masks:
        raise InputError("--inpaint: nothing to fill in", fix="say what to hide with --masks")
    for note in take_frames(path, out, choice):
        print(note)
    frames = read_json(out / FILE)["frames"]
    print(f"{len(frames)} frames in {out / IMAGES}")
    if masks:
        for note in put_masks(masks, out, {frame["name"]: frame["time"] for frame in frames}, inpaint):
            print(note)
    elif (out / MASK_SETTINGS).is_file():
        raise InputError(f"{out}: begun with masks", fix="give the same --masks again, or choose another --out")
    rain = {"rain": "none"} if dry else RAINY
    write_json(out / CAPTURE, {**rain, **read_json(out / SETTINGS), "frames": len(frames), "inpainted": inpaint})
    if frames_only:
        return None
    advice = advise(choice, masks is not None)
    hidden = out / MASKS if masks else None
    scene = estimate_poses(out / IMAGES, out, matcher=matcher, seed=seed, masks=hidden, advice=advice, rainy=not dry)
    return replace(scene, notes=(*scene.notes, *registration_notes(len(scene.views), len(frames), advice)))


def advise(choice: FrameChoice, masked: bool) -> str:
    """What to do about frames of a rainy film that do not register, with the options to try."""
    hide = "" if masked else "; hide people, cars and the camera's own housing with --masks"
    return (
        f"take more frames a second into another folder (--rate {2 * choice.rate:g} --out ...){hide}. "
        "Otherwise film again: walk more slowly, wipe the lens dry, shelter it, keep the light and let each place be "
        "seen from several sides. Drops on the lens and heavy streaks are matched as if they were the scene: wait for "
        "lighter rain"
    )


def registration_notes(registered: int, frames: int, advice: str) -> list[str]:
    """Says how many frames have no camera, and what to do if they are many."""
    if registered == frames:
        return []
    notes = [f"{frames - registered} of {frames} frames could not be registered and are left out"]
    if registered < FEW * frames:
        notes.append(f"that is more than half: expect a poor scene, or {advice}")
    return notes

"""hydroviews build | reconstruct | eval | poses | video | download | verify | sheet | pack | doctor.

`reconstruct`, `eval` and `doctor` are of packages that this one does not know: it finds them as entry points.
"""

from hydroviews.cli.starting import begin

if __name__ == "__main__":
    begin()

import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import tyro

from hydroviews.blender.embedded_scenes.captures import EMBEDDED
from hydroviews.captures.catalogue.catalogue import (
    Capture,
    all_captures,
    captures_root,
    find_captures,
    locate,
)
from hydroviews.captures.download.captures import download_captures
from hydroviews.captures.enhancer import find_enhancer
from hydroviews.captures.packed.sample import SAMPLE, copy_sample
from hydroviews.captures.panoramas import Panoramas, refuse_panoramas
from hydroviews.captures.photographs import camera_notes, check_photographs
from hydroviews.captures.sfm.poses import FeatureKind, Matcher, estimate_poses
from hydroviews.captures.video.capture import capture_video
from hydroviews.captures.video.frames import FrameChoice
from hydroviews.cli.commands import choices, run_command
from hydroviews.cli.plugins import registered
from hydroviews.dataset.card.contact_sheet import COLUMNS, write_sheets
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import built_scenes, require_outside_scenes
from hydroviews.dataset.sharing.fetch import fetch
from hydroviews.dataset.sharing.pack import pack
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.suites import build_suite, known_suites, read_suite
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.files.locks import BUSY, locked
from hydroviews.files.ownership import require_ours
from hydroviews.formats.capture_json import FILE as CAPTURE
from hydroviews.formats.capture_json import RAINY, read_capture_json
from hydroviews.formats.photographs import FOLDERS, photographs_below
from hydroviews.formats.read import has_cameras
from hydroviews.profiles import PROFILES, Profile, find_profile, require_long_side, require_seed
from hydroviews.rain.registry import parse_pattern, pattern_names
from hydroviews.rain.scene_statistics import LensRenderer
from hydroviews.scene.masks import MASKS

COMMANDS = "hydroviews.commands"  # entry points: commands of other packages


def build_command(
    scene: Annotated[str, tyro.conf.Positional] = "courtyard",
    suite: Annotated[str | None, choices(known_suites(), "FILE.toml")] = None,
    out: Path | None = None,
    profile: Annotated[str, choices(PROFILES)] = "demo",
    seed: int | None = None,
    long_side: int | None = None,
    lens_renderer: LensRenderer | None = None,
    patterns: Annotated[tuple[str, ...], choices(pattern_names(), "package.module:Class-0")] = (),
    captures: Path | None = None,
    overwrite: bool = False,
    repair: bool = False,
    render: bool = False,
) -> None:
    """Build the clean views, cameras and rainy variants of a scene, or of every scene of a suite.

    Args:
        scene: a name that `hydroviews download` lists (courtyard, mipnerf360/garden), a folder with images and cameras,
            or a folder of dry photographs, whose cameras are then estimated as by `poses`.
        suite: name of a suite, or a TOML file of your own; builds many scenes.
        out: the data folder, in which the scene becomes a folder. Default: `data/<profile>`.
        profile: image size, patterns, and number of views of an embedded scene.
        seed: seed of the rain and of embedded scenes. Default: 0, or the seed of the scene that is there.
        long_side: longer side of the images in pixels. Default: the profile's.
        lens_renderer: method for water on the lens: disk (fast, the default), aperture (accurate), traced (slow).
        patterns: effects with a grade: 0 is light, 1 medium, 2 heavy. Default: the profile's.
        captures: the folder with captures. Default: $HYDROVIEWS_CAPTURES, else `captures`.
        overwrite: replace a scene that was built with other settings.
        repair: restore files of a finished scene that differ from the manifest.
        render: render an embedded scene with Blender, even if the package contains its rendered views.
    """
    sizes, data = find_profile(profile), out or Path("data") / profile
    if suite is not None:
        if patterns or long_side is not None or lens_renderer:
            raise InputError(
                "--suite with --patterns, --long-side or --lens-renderer", fix="name patterns in a suite of your own"
            )
        settings = {"captures": captures, "seed": seed, "overwrite": overwrite, "repair": repair, "render": render}
        _build_suite(suite, data, sizes, settings)
        return
    for name in patterns:  # before cameras are estimated, which may take hours
        parse_pattern(name)
    require_seed(seed)
    require_long_side(long_side)
    folder = build_source(
        _with_cameras(scene, data),
        data,
        sizes,
        patterns=patterns,
        all_patterns=True,
        long_side=long_side,
        seed=seed,
        lens_renderer=lens_renderer,
        overwrite=overwrite,
        repair=repair,
        captures=captures,
        render=render,
    )
    print(f"built: {folder}")


def _with_cameras(source: str, data: Path) -> str:
    """What to build: of a folder of photographs without cameras, the capture beside it, made first."""
    folder = Path(source)
    named = source in EMBEDDED or find_captures(source)
    if named or not folder.is_dir() or has_cameras(folder) or not photographs_below(folder):
        return source
    if data.resolve().is_relative_to(folder.resolve()):  # clean views would be photographs the next time
        raise InputError(
            f"--out {data}: among the photographs",
            expected="a data folder beside them",
            fix="choose another --out, or start the command from another folder",
        )
    out = _capture_beside(folder.resolve())
    poses_command(folder, out)
    return str(out)


def _build_suite(name: str, data: Path, profile: Profile, settings: dict[str, Any]) -> None:
    suite = read_suite(name)
    failures = build_suite(suite, data, profile, **settings)
    print(f"\n{suite.title}: {len(suite.scenes) - len(failures)} of {len(suite.scenes)} scenes are built in {data}")
    for error in failures.values():
        print(f"\n{error}")
    if failures:
        sys.exit(1)


def download_command(
    name: Annotated[str, tyro.conf.Positional] = "",
    captures: Path | None = None,
    mirror: str | None = None,
    out: Path | None = None,
) -> None:
    """List scenes and published captures, or download one: a capture, a collection, a packed variant; it resumes.

    Args:
        name: such as mipnerf360/garden, or mipnerf360 for all of its scenes; the address (http(s)://...) or file of a
            packed variant, `#sha256=...` at its end is the required checksum; sample: a rainy clip of the package,
            copied without a network. Without a name: list what there is.
        captures: the folder for captures. Default: $HYDROVIEWS_CAPTURES, else `captures`.
        mirror: address of an archive, or of a folder with archives, to try first. Default: $HYDROVIEWS_MIRROR.
        out: the data folder for a packed variant, or the folder for the sample clip (default: the current folder).
    """
    if not name:
        _list_scenes(captures_root(captures))
    elif name == SAMPLE:
        clip = copy_sample(out or Path())
        print(f"ready: {clip}; try `hydroviews reconstruct {shlex.quote(str(clip))} --profile demo`")
    elif name in EMBEDDED:
        print(f"{name} comes with the package: `hydroviews build {name}` builds it")
    elif is_packed(name):
        if out is None:
            raise InputError(f"{name}: a packed variant without a data folder", fix="add --out data/fetched")
        print(f"ready: {fetch(name, out)}")
    else:
        for folder in download_captures(name, captures_root(captures), mirror):
            print(f"ready: {folder}")


def is_packed(name: str) -> bool:
    """True for the address or the file of a packed variant, False for a capture's name."""
    path = name.partition("#")[0]
    return "://" in name or path.endswith(".zip") or Path(path).is_file()


def _list_scenes(root: Path) -> None:
    rows = [(name, "modelled, rendered with Blender", "comes with the package") for name in EMBEDDED]
    rows += [(SAMPLE, "courtyard in rain, a video", "comes with the package")]
    rows += [(one.name, one.title, _whereabouts(one, root)) for one in all_captures()]
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    for name, origin, place in rows:
        print(f"{name:{widths[0]}}  {origin:{widths[1]}}  {place}")


def _whereabouts(capture: Capture, root: Path) -> str:
    folder = locate(capture, root)
    if folder is not None:
        return f"here: {folder}"
    return f"to be downloaded, {capture.archive.gigabytes:g} GB" if capture.archive else "to be fetched by hand"


def verify_command(data: Annotated[Path, tyro.conf.Positional], every_view: bool = False) -> None:
    """Compare every file with its hash, and draw one rainy view of each variant again.

    Args:
        data: a data folder, or a built scene in one.
        every_view: draw every view again.
    """
    problems = verify(data, every_view)
    for problem in problems:
        print(problem)
    if problems:
        sys.exit(1)
    print(f"{data}: all files are as built")


def sheet_command(
    data: Annotated[Path, tyro.conf.Positional], scene: str = "", views: int = COLUMNS, out: Path | None = None
) -> None:
    """Draw contact sheets: a few rainy views of every pattern, and their layers.

    Args:
        data: a data folder, or a built scene in one.
        scene: draw only the scene of this name.
        views: number of views, spread evenly over the capture.
        out: folder of the sheets. Default: `sheets` in the data folder.
    """
    for folder in built_scenes(data, scene):
        for path in write_sheets(folder, out, views):
            print(path)


def poses_command(
    images: Annotated[Path, tyro.conf.Positional],
    out: Path | None = None,
    rainy: bool = False,
    panoramas: Panoramas = "cut",
    features: FeatureKind = "auto",
) -> None:
    """Estimate cameras for a folder of photographs with pycolmap.

    Args:
        images: folder of the photographs.
        out: folder of the capture. Default: `<images>-capture`, or `walk-capture` for `walk/images`.
        rainy: the photographs were taken in rain: detect learned features in enhanced photographs, and ignore features
            fixed on the lens. The capture's `capture.json` records this, so its photographs never count as clean views.
        panoramas: cut: cut 360-degree panoramas into perspective views; refuse: raise an error for a panorama.
        features: learned: XFeat with LighterGlue, weights downloaded once; sift: SIFT; auto: learned in rain if the
            weights can be downloaded, otherwise sift.
    """
    images = images.resolve()
    out = out or _capture_beside(images)
    check_photographs(images, out)
    require_outside_scenes(out)
    if panoramas == "refuse":
        refuse_panoramas(photographs_below(images))
    with locked(out.resolve(), BUSY):
        described = read_capture_json(out)
        if rainy and described != {**described, **RAINY}:
            require_ours([out / CAPTURE])
        enhance = find_enhancer() if rainy else None
        scene = estimate_poses(images, out, rainy=rainy, enhance=enhance, features=features)
        if rainy and described != {**described, **RAINY}:
            write_json(out / CAPTURE, {**described, **RAINY})
    for note in (*scene.notes, *camera_notes(scene, out / "images")):
        print(note)
    print(f"capture: {out}; build it with `hydroviews build {shlex.quote(str(out))}`")


def _capture_beside(images: Path) -> Path:
    """The capture's folder, called after that of the photographs, or the one above where each capture has one."""
    named = images.parent if images.name in FOLDERS and images.parent.name else images
    return named.with_name(named.name + "-capture")


def video_command(
    film: Annotated[Path, tyro.conf.Positional],
    out: Path | None = None,
    rate: float = 1.0,
    long_side: int | None = None,
    masks: Path | None = None,
    inpaint: bool = False,
    dry: bool = False,
    frames_only: bool = False,
    matcher: Matcher = "auto",
    features: FeatureKind = "auto",
    seed: int = 0,
) -> None:
    """Make a capture from a video: select sharp frames and estimate their cameras.

    Args:
        film: the video file.
        out: folder of the capture. Default: `<film>-capture` beside the video.
        rate: frames per second; each is the sharpest frame near its instant.
        long_side: longer side of the frames in pixels, if the video is larger.
        masks: hidden pixels in white: a picture for all frames, a folder of pictures named like the frames, or a
            video that runs beside this one.
        inpaint: fill the hidden pixels.
        dry: the video shows dry weather: its frames are clean views, to which rain can be added.
        frames_only: stop before cameras are estimated, so that you can draw masks.
        matcher: exhaustive: all pairs; sequential: neighbours and keyframes; auto: exhaustive up to 80 frames.
        features: learned: XFeat with LighterGlue, weights downloaded once; sift: SIFT; auto: learned in rain if the
            weights can be downloaded, otherwise sift.
        seed: seed of the camera estimation.
    """
    out = out or film.with_name(film.stem + "-capture")
    require_outside_scenes(out)
    choice = FrameChoice(rate, long_side)
    with locked(out.resolve(), BUSY):
        scene = capture_video(
            film,
            out,
            choice,
            masks=masks,
            inpaint=inpaint,
            dry=dry,
            frames_only=frames_only,
            matcher=matcher,
            features=features,
            seed=seed,
            enhance=None if dry or frames_only else find_enhancer(),
        )
    if scene is None:
        draw = f"draw masks, white where hidden, with the names of {out / 'images'}; then add --masks FOLDER"
        print(f"masks: {out / MASKS}; go on without --frames-only" if masks else draw)
        return
    for note in scene.notes:
        print(note)
    print(f"capture: {out}; train it with `make eval METHOD=3dgs SCENE={shlex.quote(str(out))}`")


def pack_command(
    data: Annotated[Path, tyro.conf.Positional],
    out: Path,
    scene: str = "",
    patterns: tuple[str, ...] = (),
    i_have_the_rights: str = "",
    layers_only: bool = False,
) -> None:
    """Pack a data set for redistribution: one archive per variant, with licence and Croissant metadata.

    Args:
        data: a data folder, or a built scene in one.
        out: folder of the archives, or the archive itself (`*.zip`) for a single variant.
        scene: pack only the scene of this name.
        patterns: pack only these variants, such as raindrop-1; clean is the scene without rain.
        i_have_the_rights: licence under which you publish the photographs: an SPDX identifier or a text.
        layers_only: leave out the pictures, which people with the same capture can compute.
    """
    archives = pack(data, out, scene=scene, patterns=patterns, owner_says=i_have_the_rights, layers_only=layers_only)
    for path, digest in archives:
        print(f"{digest}  {path}")


GROUPS: dict[str, dict[str, Callable[..., None] | str]] = {  # by what they are for
    "do the three jobs": {"build": build_command, "reconstruct": "", "eval": ""},
    "prepare photographs": {"poses": poses_command, "video": video_command, "download": download_command},
    "look at a data set and share it": {"verify": verify_command, "sheet": sheet_command, "pack": pack_command},
    "look at this machine": {"doctor": ""},
}


def main() -> None:
    """Entry point."""
    own = {name: command for group in GROUPS.values() for name, command in group.items()}
    commands = {name: command or registered(COMMANDS).get(name, "") for name, command in own.items()}
    run_command({name: command for name, command in commands.items() if command}, prog="hydroviews", groups=GROUPS)


if __name__ == "__main__":
    main()

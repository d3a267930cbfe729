"""python -m hydroviews build | scenes | verify | sheet | poses | video | download | pack | fetch."""

from hydroviews.cli.starting import begin

if __name__ == "__main__":
    begin()

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import tyro

from hydroviews.blender.embedded_scenes.captures import EMBEDDED
from hydroviews.captures.catalogue.catalogue import Capture, all_captures, captures_root, locate
from hydroviews.captures.download.captures import download_captures
from hydroviews.captures.panoramas import Panoramas, refuse_panoramas
from hydroviews.captures.photographs import camera_notes, check_photographs
from hydroviews.captures.sfm.poses import FeatureKind, Matcher, estimate_poses
from hydroviews.captures.video.capture import capture_video
from hydroviews.captures.video.frames import FrameChoice
from hydroviews.cli.commands import choices, run_command
from hydroviews.dataset.contact_sheet import COLUMNS, write_sheets
from hydroviews.dataset.manifest import built_scenes
from hydroviews.dataset.sharing.fetch import fetch
from hydroviews.dataset.sharing.pack import pack
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.suites import build_suite, known_suites, read_suite
from hydroviews.dataset.verify import verify
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.files.locks import BUSY, locked
from hydroviews.files.ownership import require_ours
from hydroviews.formats.capture_json import FILE as CAPTURE
from hydroviews.formats.capture_json import RAINY, read_capture_json
from hydroviews.formats.photographs import FOLDERS, photographs_below
from hydroviews.profiles import PROFILES, Profile, find_profile
from hydroviews.rain.registry import pattern_names
from hydroviews.rain.scene_statistics import LensRenderer
from hydroviews.scene.masks import MASKS


def build_command(
    scene: str = "courtyard",
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
) -> None:
    """Build a capture's clean views, cameras and rainy variants, or those of every scene of a suite.

    Args:
        scene: one that `scenes` lists (courtyard, mipnerf360/garden), or a folder with images and cameras.
        suite: many scenes at once, by its name or from a TOML file of your own.
        out: the data folder; the scene becomes a folder in it. `data/<profile>` if not given.
        profile: size, patterns, views of an embedded scene.
        seed: of everything drawn; 0 if the scene is new.
        long_side: pixels of the longer side, instead of the profile's.
        lens_renderer: how water on the lens is drawn: disk (fast, the default), aperture (accurate) or traced (slow).
        patterns: 0 is light, 1 medium, 2 heavy; instead of the profile's.
        captures: the folder with published captures; $HYDROVIEWS_CAPTURES or `captures` if not given.
        overwrite: drop a scene that was built with other settings.
        repair: make files of a finished scene again that are no longer what the manifest says.
    """
    sizes, data = find_profile(profile), out or Path("data") / profile
    if suite is not None:
        if patterns or long_side is not None or lens_renderer:
            raise InputError(
                "--suite with --patterns, --long-side or --lens-renderer", fix="name patterns in a suite of your own"
            )
        settings = {"captures": captures, "seed": seed, "overwrite": overwrite, "repair": repair}
        _build_suite(suite, data, sizes, settings)
        return
    folder = build_source(
        scene,
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
    )
    print(f"built: {folder}")


def _build_suite(name: str, data: Path, profile: Profile, settings: dict[str, Any]) -> None:
    suite = read_suite(name)
    failures = build_suite(suite, data, profile, **settings)
    print(f"\n{suite.title}: {len(suite.scenes) - len(failures)} of {len(suite.scenes)} scenes are built in {data}")
    for error in failures.values():
        print(f"\n{error}")
    if failures:
        sys.exit(1)


def scenes_command(captures: Path | None = None) -> None:
    """List the scenes there are: embedded ones and published captures, where each comes from, whether it is here.

    Args:
        captures: the folder with published captures; $HYDROVIEWS_CAPTURES or `captures` if not given.
    """
    rows = [(name, "modelled, rendered with Blender", "comes with the package") for name in EMBEDDED]
    rows += [(one.name, one.title, _whereabouts(one, captures_root(captures))) for one in all_captures()]
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    for name, origin, place in rows:
        print(f"{name:{widths[0]}}  {origin:{widths[1]}}  {place}")


def _whereabouts(capture: Capture, root: Path) -> str:
    folder = locate(capture, root)
    if folder is not None:
        return f"here: {folder}"
    return f"to be downloaded, {capture.archive.gigabytes:g} GB" if capture.archive else "to be fetched by hand"


def download_command(
    name: Annotated[str, tyro.conf.Positional], captures: Path | None = None, mirror: str | None = None
) -> None:
    """Download a published capture, or all of a collection; finished files are kept, begun ones are resumed.

    Args:
        name: such as mipnerf360/garden, or mipnerf360 for all of its scenes.
        captures: the folder it goes to; $HYDROVIEWS_CAPTURES or `captures` if not given.
        mirror: where to look first: an archive's address, or that of a folder with the archives.
            $HYDROVIEWS_MIRROR if not given.
    """
    for folder in download_captures(name, captures_root(captures), mirror):
        print(f"ready: {folder}")


def verify_command(data: Annotated[Path, tyro.conf.Positional], every_view: bool = False) -> None:
    """Recompute every hash, and re-derive one rainy view of each variant from clean view, layers and parameters.

    Args:
        data: a data folder, or a built scene in one.
        every_view: re-derive every view of every variant, not one of each.
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
    """Draw contact sheets: the rain on a few views, and the layers it is made of.

    Args:
        data: a data folder, or a built scene in one.
        scene: only the one of that name.
        views: how many, spread evenly over the capture.
        out: where the sheets go; `sheets` in the data folder if not given.
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
        images: the photographs.
        out: where the capture goes; `<images>-capture` if not given, `walk-capture` for `walk/images`.
        rainy: they were taken in rain: features are learned ones, and what stays in one place of the lens is none. The
            capture's `capture.json` says so: nobody takes its photographs for clean views.
        panoramas: cut: perspective photographs are cut out of those of 360 cameras; refuse: there must be none.
        features: learned: XFeat, matched by LighterGlue, whose weights are fetched once; sift; auto: learned ones in
            rain, sift in dry weather and without a package index.
    """
    images = images.resolve()
    out = out or _capture_beside(images)
    check_photographs(images, out)
    if panoramas == "refuse":
        refuse_panoramas(photographs_below(images))
    with locked(out.resolve(), BUSY):
        described = read_capture_json(out)
        if rainy and described != {**described, **RAINY}:
            require_ours([out / CAPTURE])
        scene = estimate_poses(images, out, rainy=rainy, features=features)
        if rainy and described != {**described, **RAINY}:
            write_json(out / CAPTURE, {**described, **RAINY})
    for note in (*scene.notes, *camera_notes(scene, out / "images")):
        print(note)
    print(f"capture: {out}; build it with `python -m hydroviews build --scene {shlex.quote(str(out))}`")


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
    seed: int = 0,
) -> None:
    """Make a capture from a film taken in rain: sharp frames, and cameras estimated from them.

    Args:
        film: the video file.
        out: where the capture goes; `<film>-capture` beside it if not given.
        rate: frames taken a second, each the sharpest one near its instant.
        long_side: pixels of the frames' longer side, if the film is larger.
        masks: what to hide, in white: a picture for all frames, a folder of pictures named like the frames, or a
            film that runs beside this one.
        inpaint: fill in what is hidden.
        dry: it did not rain: the frames are clean views, to which rain can be added.
        frames_only: stop before cameras are estimated, to draw masks.
        matcher: exhaustive, sequential, or auto: the first for up to 80 frames.
        seed: of the estimation of cameras.
    """
    out = out or film.with_name(film.stem + "-capture")
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
            seed=seed,
        )
    if scene is None:
        draw = f"draw masks, white where hidden, under the names of {out / 'images'}; then add --masks FOLDER"
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
    """Pack a data set to hand it on: an archive for every variant, with licence and Croissant metadata.

    Args:
        data: a data folder, or a built scene in one.
        out: the folder for the archives, or the archive itself (`*.zip`) where there is one to write.
        scene: only the one of that name.
        patterns: only these variants, such as raindrop-1; clean is the scene without rain.
        i_have_the_rights: the licence of the photographs, if it is yours to give: an SPDX identifier or a text.
        layers_only: leave out pictures, which people with the same capture have or can make.
    """
    archives = pack(data, out, scene=scene, patterns=patterns, owner_says=i_have_the_rights, layers_only=layers_only)
    for path, digest in archives:
        print(f"{digest}  {path}")


def fetch_command(address: Annotated[str, tyro.conf.Positional], out: Path) -> None:
    """Get a packed variant, check it, and add it to a data folder; what was interrupted goes on.

    Args:
        address: http(s)://... or a file; `#sha256=...` at its end is the checksum that it must have.
        out: the data folder.
    """
    print(f"ready: {fetch(address, out)}")


def main() -> None:
    """Entry point."""
    run_command(
        {
            "build": build_command,
            "scenes": scenes_command,
            "verify": verify_command,
            "sheet": sheet_command,
            "poses": poses_command,
            "video": video_command,
            "download": download_command,
            "pack": pack_command,
            "fetch": fetch_command,
        },
        prog="hydroviews",
    )


if __name__ == "__main__":
    main()

"""python -m hydroviews build | verify | poses."""

import sys
from pathlib import Path
from typing import Annotated

import tyro

from hydroviews.commands import run_command
from hydroviews.poses import estimate_poses
from hydroviews.profiles import find_profile
from hydroviews.sources import build_source
from hydroviews.verify import verify


def build_command(
    scene: str = "courtyard",
    out: Path | None = None,
    profile: str = "demo",
    seed: int | None = None,
    long_side: int | None = None,
    patterns: tuple[str, ...] = (),
    overwrite: bool = False,
) -> None:
    """Build a capture's clean views, cameras and rainy variants.

    Args:
        scene: a known capture (courtyard), or a folder with images and cameras.
        out: the data folder; the scene becomes a folder in it. `data/<profile>` if not given.
        profile: demo, quick or paper: size, number of patterns, views of an embedded scene.
        seed: of everything drawn; 0 if the scene is new.
        long_side: pixels of the longer side, instead of the profile's.
        patterns: such as raindrop-0 streak-2, instead of the profile's.
        overwrite: drop a scene that was built with other settings.
    """
    folder = build_source(
        scene,
        out or Path("data") / profile,
        find_profile(profile),
        patterns=patterns,
        all_patterns=True,
        long_side=long_side,
        seed=seed,
        overwrite=overwrite,
    )
    print(f"built: {folder}")


def verify_command(data: Annotated[Path, tyro.conf.Positional], every_view: bool = False) -> None:
    """Recompute every hash, and re-derive rainy views from clean views, layers and parameters.

    Args:
        data: a data folder, which holds manifest.json.
        every_view: re-derive every view of every variant, not one of each.
    """
    problems = verify(data, every_view)
    for problem in problems:
        print(problem)
    if problems:
        sys.exit(1)
    print(f"{data}: all files are as built")


def poses_command(images: Annotated[Path, tyro.conf.Positional], out: Path | None = None) -> None:
    """Estimate cameras for a folder of photographs with pycolmap.

    Args:
        images: the photographs.
        out: where the capture goes; `<images>-capture` if not given.
    """
    images = images.resolve()
    out = out or images.with_name(images.name + "-capture")
    scene = estimate_poses(images, out)
    for note in scene.notes:
        print(note)
    print(f"capture: {out}; build it with `python -m hydroviews build --scene {out}`")


def main() -> None:
    """Entry point."""
    run_command({"build": build_command, "verify": verify_command, "poses": poses_command}, prog="hydroviews")


if __name__ == "__main__":
    main()

"""Captures by name or folder, built at a profile's size."""

from collections.abc import Sequence
from pathlib import Path

from hydroviews.blender.captures import read_courtyard, render_courtyard
from hydroviews.build import build
from hydroviews.errors import InputError
from hydroviews.files import read_json
from hydroviews.profiles import Profile
from hydroviews.rain.patterns import choose_patterns
from hydroviews.readers import read_scene
from hydroviews.scenes import Scene

EMBEDDED = ("courtyard",)
CAPTURES = "captures"  # embedded scenes as rendered, beside the built ones


def find_capture(source: str, captures: Path, views: int, long_side: int) -> Scene:
    """The capture of that name, rendered if it is an embedded scene, or the one in that folder.

    Args:
        source: "courtyard", or a folder with a COLMAP, nerfstudio or LLFF capture.
        captures: where embedded scenes are rendered.
        views: number of views of an embedded scene.
        long_side: pixels of an embedded scene's width.

    Raises:
        InputError: neither a name nor a folder, or an unreadable capture.
    """
    if source in EMBEDDED:
        width, height = long_side, max(1, long_side * 3 // 4)
        folder = captures / f"{source}-{views}-{width}x{height}"
        render_courtyard(folder, views, width, height, seed=0)
        return read_courtyard(folder)
    if not Path(source).is_dir():
        raise InputError(
            f"SCENE={source}: no such capture",
            expected=f"one of {', '.join(EMBEDDED)}, or a folder with images and cameras",
        )
    return read_scene(Path(source))


def build_source(
    source: str,
    out: Path,
    profile: Profile,
    *,
    patterns: Sequence[str] = (),
    all_patterns: bool = False,
    long_side: int | None = None,
    seed: int | None = None,
    overwrite: bool = False,
) -> Path:
    """Build a capture and the named patterns under `out`; keeps what is there.

    Args:
        source: see `find_capture`.
        out: the data folder.
        profile: sizes and counts where nothing else is said.
        patterns: names such as raindrop-0; none builds the clean views alone.
        all_patterns: where none is named, the profile's patterns.
        long_side: pixels, instead of the profile's.
        seed: of the rain; a scene that is already there keeps its own if None.
        overwrite: drop a scene that was built from another request.

    Returns:
        The built scene's folder.
    """
    long_side = profile.long_side if long_side is None else long_side
    scene = find_capture(source, out / CAPTURES, profile.embedded_views, long_side)
    for note in scene.notes:
        print(f"{scene.name}: {note}")
    return build(
        scene,
        out,
        patterns=choose_patterns(patterns, profile.patterns if all_patterns else ()),
        long_side=long_side,
        seed=_built_seed(out / scene.name) if seed is None else seed,
        source=source,
        overwrite=overwrite,
    )


def _built_seed(folder: Path) -> int:
    request = folder / "request.json"
    return int(read_json(request).get("seed", 0)) if request.is_file() else 0

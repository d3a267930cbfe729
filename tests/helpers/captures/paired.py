"""Paired captures made of a small synthetic one."""

import json
import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from synthetic import capture_in

from hydroviews.formats.writers import write_colmap, write_nerfstudio
from hydroviews.scene.images import read_image, write_png

NAMES = [f"view-{i:02d}" for i in range(9)]


def wet(path: Path, source: Path) -> None:
    """Write a photograph whose right half is white."""
    image = read_image(source)
    image[:, image.shape[1] // 2 :] = 1
    write_png(path, image)


def paired_capture(folder: Path, rainy: Iterable[str] = NAMES, clean: Iterable[str] = NAMES) -> Path:
    """Views 00 to 08 of 48x36 in `rainy` and `clean`, as many as are named, with cameras of all in a COLMAP model."""
    scene = capture_in(folder)
    write_colmap(scene, folder / "sparse" / "0")
    for name in rainy:
        wet(folder / "rainy" / f"{name}.png", folder / "images" / f"{name}.png")
    for name in clean:
        (folder / "clean").mkdir(exist_ok=True)
        shutil.copy(folder / "images" / f"{name}.png", folder / "clean")
    shutil.rmtree(folder / "images")
    return folder


def name_cameras(folder: Path, files: dict[str, list[str]]) -> None:
    """Replace the COLMAP model by a `transforms.json` with a frame for each of some views' files, in order.

    Args:
        folder: a paired capture of nine views.
        files: by view name, what the camera file calls its photographs; moved 0.1 further for each but the first.
    """
    scene = capture_in(folder.with_name("cameras"))
    write_nerfstudio(scene, folder / "transforms.json", "images")
    content = json.loads((folder / "transforms.json").read_text())
    by_name = {Path(frame["file_path"]).stem: frame for frame in content["frames"]}
    frames = []
    for name, paths in files.items():
        for i, path in enumerate(paths):
            matrix = np.array(by_name[name]["transform_matrix"])
            matrix[0, 3] += 0.1 * i
            frames.append({**by_name[name], "file_path": path, "transform_matrix": matrix.tolist()})
    (folder / "transforms.json").write_text(json.dumps({**content, "frames": frames}))
    for path in (folder / "sparse" / "0").glob("*.bin"):
        path.unlink()

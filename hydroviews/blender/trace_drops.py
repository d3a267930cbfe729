"""Blender process: drops on a lens by full path tracing, the reference for `bake_drops`."""

from pathlib import Path
from typing import Any

import numpy as np

from hydroviews.blender.cycles import render_rgba
from hydroviews.blender.drop_scene import add_picture, lens_scene
from hydroviews.blender.process import Report
from hydroviews.cameras import Camera
from hydroviews.files import replacing


def main(request: dict[str, Any], report: Report) -> None:
    """Write the light that comes through the drops.

    Args:
        request: "drops" and "camera" as for `bake_drops`; "samples" a pixel; "picture": an npy file [H, W, 3] of
            linear light; "output": an npy file, which gets [H, W, 4], linear radiance and cover.
        report: told of the start and the end.
    """
    report(0, 1)
    camera, picture = Camera(**request["camera"]), np.load(request["picture"])
    red, green, blue = picture.mean(axis=(0, 1)).tolist()
    scene = lens_scene(request["drops"], camera, ambient=(red, green, blue))
    add_picture(scene, camera, picture)
    scene.cycles.samples = request["samples"]
    scene.cycles.filter_width = 1.0
    with replacing(Path(request["output"])) as temporary:
        np.save(temporary, render_rgba(scene))
    report(1, 1)

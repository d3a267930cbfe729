"""Blender process: drops on a lens by full path tracing, the reference for `bake_drops`."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from hydroviews.blender.cycles import render_rgba
from hydroviews.blender.drop_scene import add_picture, lens_scene
from hydroviews.blender.process import Report
from hydroviews.files.atomic import replacing
from hydroviews.scene.cameras import Camera


def main(request: dict[str, Any], report: Report) -> None:
    """Write the light that comes through the drops.

    Args:
        request: "input": an npz file with the fields of `WaterMesh` and "picture", [H, W, 3] of linear light;
            "camera", "aperture" and "focus" as for `bake_drops`; "samples" a pixel; "seed" of the paths; "output":
            an npz file, which gets "light" [H, W, 4], linear radiance and cover, and "seconds", the CPU time of
            rendering.
        report: told of the start and the end.
    """
    report(0, 1)
    camera = Camera(**request["camera"])
    with np.load(request["input"]) as file:
        water = dict(file)
    picture = water.pop("picture")
    red, green, blue = picture.mean(axis=(0, 1)).tolist()
    scene = lens_scene(water, camera, ambient=(red, green, blue), aperture=request["aperture"], focus=request["focus"])
    add_picture(scene, camera, picture)
    scene.cycles.samples = request["samples"]
    scene.cycles.seed = request["seed"]
    scene.cycles.filter_width = 1.0
    start = time.process_time()
    light = render_rgba(scene)
    seconds = time.process_time() - start
    with replacing(Path(request["output"])) as temporary:
        np.savez(temporary, light=light, seconds=seconds)
    report(1, 1)

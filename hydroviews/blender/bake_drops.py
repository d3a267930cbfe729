"""Blender process: follow every light path through the drops on a lens to where it comes from.

The picture is rendered several times larger with one path a pixel, against a ramp of coordinates instead of a
photograph, so that each fine pixel says where its one path ends. Averaging coordinates would mix unrelated places;
keeping the paths apart makes the drops a linear map from background pixels to lens pixels.
"""

from pathlib import Path
from typing import Any

import numpy as np

from hydroviews.blender.cycles import render_rgba
from hydroviews.blender.drop_scene import FRAMES, add_ramp, lens_scene
from hydroviews.blender.process import Report
from hydroviews.cameras import Camera
from hydroviews.files import replacing

FAINTEST = 1e-4  # throughput below which a path counts as ending nowhere


def main(request: dict[str, Any], report: Report) -> None:
    """Write the paths as arrays.

    Args:
        request: "drops": the fields of `Drop`; "camera": the fields of `Camera`; "paths": k, for k x k paths a
            pixel; "output": an npz file. It gets `cover` [H, W], and for each path that ends on the picture's
            plane `pixel` (flat index of the lens pixel), `place` (x, y in the camera's pixels, borders not yet
            mirrored) and `throughput` (already divided by k^2).
        report: told of the start and the end.
    """
    report(0, 1)
    camera, k = Camera(**request["camera"]), request["paths"]
    scene = lens_scene(request["drops"], camera.resized(k * camera.width, k * camera.height), ambient=(0, 0, 0))
    add_ramp(scene, camera)
    scene.cycles.samples = 1
    scene.cycles.filter_width = 0.01
    fine = render_rgba(scene)
    row, column = np.nonzero(fine[..., 2] > FAINTEST)
    found = fine[row, column].astype(np.float64)
    size = np.array([camera.width, camera.height])
    place = (found[:, :2] / found[:, 2:3] * FRAMES - (FRAMES - 1) / 2) * size
    cover = fine[..., 3].reshape(camera.height, k, camera.width, k).mean(axis=(1, 3))
    with replacing(Path(request["output"])) as temporary:
        np.savez(
            temporary,
            cover=cover,
            pixel=(row // k) * camera.width + column // k,
            place=place,
            throughput=(found[:, 2] / k**2).astype(np.float32),
        )
    report(1, 1)

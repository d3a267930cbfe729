"""Blender process: follow every light path through the drops on a lens to where it comes from.

The picture is rendered several times larger with one path a pixel, against a ramp of coordinates instead of a
photograph, so that each fine pixel says where its one path ends. Averaging coordinates would mix unrelated places;
keeping the paths apart makes the drops a linear map from background pixels to lens pixels.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydroviews.blender.cycles import render_rgba
from hydroviews.blender.drop_scene import FRAMES, add_ramp, lens_scene
from hydroviews.blender.process import Report
from hydroviews.files.atomic import replacing
from hydroviews.scene.cameras import Camera

FAINTEST = 1e-4  # throughput below which a path counts as ending nowhere


def main(request: dict[str, Any], report: Report) -> None:
    """Write the paths as arrays.

    Args:
        request: "input": an npz file with the fields of `WaterMesh`; "camera": the fields of `Camera`; "paths": k,
            for k x k paths a pixel; "passes": how often; "aperture": its radius in lens distances, 0 for a
            pinhole; "focus" as for `lens_scene`; "output": an npz file. It gets `cover` [H, W], and for each path that
            ends on the picture's plane `pixel` (flat index of the lens pixel), `place` (x, y in the camera's pixels,
            borders not yet mirrored) and `throughput` (already divided by the number of paths a pixel).
        report: told of every pass.
    """
    passes = request["passes"]
    report(0, passes)
    camera, k = Camera(**request["camera"]), request["paths"]
    with np.load(request["input"]) as water:
        fine = camera.resized(k * camera.width, k * camera.height)
        scene = lens_scene(dict(water), fine, ambient=(0, 0, 0), aperture=request["aperture"], focus=request["focus"])
    add_ramp(scene, camera)
    scene.cycles.filter_width = 0.01
    scene.cycles.samples = passes
    # One by one, the samples of one low-discrepancy sequence: together they fill the aperture evenly.
    scene.cycles.use_sample_subset, scene.cycles.sample_subset_length = True, 1
    bakes = []
    for done in range(passes):
        scene.cycles.sample_offset = done
        bakes.append(_paths(render_rgba(scene), camera, k))
        report(done + 1, passes)
    joined = {name: np.concatenate([bake[name] for bake in bakes]) for name in ("pixel", "place", "throughput")}
    joined["throughput"] /= len(bakes)
    cover = np.mean([bake["cover"] for bake in bakes], axis=0)
    with replacing(Path(request["output"])) as temporary:
        np.savez(temporary, cover=cover, **joined)


def _paths(fine: NDArray[np.float32], camera: Camera, k: int) -> dict[str, NDArray]:
    """What one render [k H, k W, 4] against the ramp says of its paths."""
    row, column = np.nonzero(fine[..., 2] > FAINTEST)
    found = fine[row, column].astype(np.float64)
    size = np.array([camera.width, camera.height])
    return {
        "cover": fine[..., 3].reshape(camera.height, k, camera.width, k).mean(axis=(1, 3)),
        "pixel": (row // k) * camera.width + column // k,
        "place": (found[:, :2] / found[:, 2:3] * FRAMES - (FRAMES - 1) / 2) * size,
        "throughput": (found[:, 2] / k**2).astype(np.float32),
    }

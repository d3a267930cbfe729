"""Steps of training on request, timed: run by `against.py` with the packages of any checkout.

    python step_server.py GAUSSIANS WIDTH HEIGHT THREADS [MODEL SCENE]

Writes a line when it is ready, then for every line it reads the processor and wall seconds of one step. It uses only
what checkouts have in common.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np

from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.backends.warm_up import warm_up
from baselines.splatting.files.checkpoints import read_model
from baselines.splatting.objective import Objective
from baselines.splatting.schedule import rates_at
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.training.images import TrainingImages
from benchmarks.splatting.scenes import picture, room, view
from benchmarks.splatting.speed import STILL
from hydroviews.scene.cameras import Camera


def made_up(gaussians: int, width: int, height: int) -> tuple[Any, Camera, TrainingImages, float]:
    """The Gaussians, camera, picture and nearest depth of `scenes.room`."""
    camera = view(width, height)
    return room(gaussians, camera), camera, picture(camera), 0.01


def trained(model: Path, scene: Path, width: int, height: int) -> tuple[Any, Camera, TrainingImages, float]:
    """Those of a trained model and the first view of a built scene."""
    gaussians, about = read_model(model)
    frame = json.loads((scene / "transforms.json").read_text())["frames"][0]
    pose = np.linalg.inv(np.array(frame["transform_matrix"]) @ np.diag([1.0, -1, -1, 1]))
    lens = (frame[name] for name in ("fl_x", "fl_y", "cx", "cy"))
    camera = Camera(frame["w"], frame["h"], *lens, pose).resized(width, height)
    pixels = cv2.imread(str(scene / frame["file_path"]))[..., ::-1]
    pixels = np.ascontiguousarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA))
    return gaussians, camera, TrainingImages([pixels]), float(about["near"])


def serve(gaussians: int, width: int, height: int, threads: int, *files: str) -> None:
    """Answer every line of the input by a step."""
    warm_up(3)
    numba.set_num_threads(threads)
    made = trained(Path(files[0]), Path(files[1]), width, height) if files else made_up(gaussians, width, height)
    scene, camera, images, near = made
    backend = CpuBackend(Objective(images), np.zeros(3, np.float32), near)
    backend.put(fresh_state(scene))
    rates, options = rates_at(0, 1, STILL, 1.0, 3), DefaultStrategy().step_options(0, 0.0, 1.0, 0)
    print("ready", flush=True)
    for iteration, _ in enumerate(sys.stdin):
        cpu, wall = time.process_time(), time.perf_counter()
        backend.step(camera, 0, iteration, 3, rates, options)
        print(time.process_time() - cpu, time.perf_counter() - wall, flush=True)


if __name__ == "__main__":
    serve(*map(int, sys.argv[1:5]), *sys.argv[5:])

"""Made-up scenes to measure on."""

import numpy as np

from baselines.splatting.gaussians import FIELDS, Gaussians
from baselines.training.images import TrainingImages
from hydroviews.scene.cameras import Camera

COVER = 25.0  # sum of all ellipse areas over the image's: about what a trained indoor scene has


def room(n: int, camera: Camera, seed: int = 0) -> Gaussians:
    """An object in a room: half the Gaussians on a shell, half all around, sized to COVER the image."""
    generator = np.random.default_rng(seed)
    shell = generator.normal(size=(n // 2, 3))
    shell *= generator.uniform(0.7, 1, (n // 2, 1)) / np.linalg.norm(shell, axis=1, keepdims=True)
    means = np.concatenate([shell, generator.uniform(-4, 4, (n - n // 2, 3))])[generator.permutation(n)]
    shapes = generator.normal(0, 0.4, (n, 1)) + generator.normal(0, 0.5, (n, 3))
    logits = generator.normal(0, 1.8, n)
    sh = generator.normal(0, 0.05, (n, 16, 3))
    sh[:, 0] = generator.uniform(-1.7, 1.7, (n, 3))
    pixels, depth = camera.project(means)
    seen = (depth > 0.3) & (pixels >= 0).all(1) & (pixels < (camera.width, camera.height)).all(1)
    reach = 2 * np.log(np.maximum(255 / (1 + np.exp(-logits)), 1))  # squared radius at alpha 1/255, in deviations

    def cover(log_size: float) -> float:
        axes = np.sort(np.exp(shapes + log_size), axis=1)[:, 1:] * camera.fx / np.maximum(depth, 0.3)[:, None]
        return float((np.pi * reach * np.sqrt(axes**2 + 0.3).prod(axis=1))[seen].sum()) / (camera.width * camera.height)

    low, high = -12.0, 2.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (low, middle) if cover(middle) > COVER else (middle, high)
    quaternions = generator.normal(size=(n, 4))
    values = dict(zip(FIELDS, (means, quaternions, shapes + low, logits, sh), strict=True))
    arrays = {name: np.ascontiguousarray(value, np.float32) for name, value in values.items()}
    return Gaussians(**arrays, origin=np.zeros(3))


def view(width: int, height: int) -> Camera:
    """Four units in front of the origin."""
    pose = np.eye(4)
    pose[2, 3] = 4
    return Camera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2, pose)


def picture(camera: Camera) -> TrainingImages:
    """One random picture to compare with."""
    shape = (camera.height, camera.width, 3)
    return TrainingImages([np.random.default_rng(0).integers(0, 256, shape, np.uint8)])

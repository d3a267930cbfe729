"""How far images and gradients are from the truth, and which choice costs what.

Two questions, asked apart: how far the float32 kernels are from float64 with the same cut-offs, and how far the
cut-offs themselves are from a renderer that leaves nothing out.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.splatting import rasterizer
from baselines.splatting.backends import torch_rasterizer as reference
from baselines.splatting.gaussians import FIELDS, Gaussians
from baselines.splatting.kernels import constants
from baselines.splatting.kernels.simd import SIMD
from benchmarks.splatting.scenes import room, view
from benchmarks.tables import rows_of

CAMERA = view(96, 72)
GAUSSIANS = 1500
LARGE_ENOUGH = 1e-4  # gradients are compared where they are at least this share of the largest
NOTHING = {"MIN_ALPHA": 0.0, "MIN_TRANSMITTANCE": 0.0}
CUTOFFS: tuple[dict[str, float], ...] = (
    {},
    {"MIN_ALPHA": 1 / 64},
    {"MIN_ALPHA": 1 / 1024},
    {"MIN_ALPHA": 0.0},
    {"MIN_TRANSMITTANCE": 1e-2},
    {"MIN_TRANSMITTANCE": 1e-3},
    {"MIN_TRANSMITTANCE": 1e-5},
    {"MIN_TRANSMITTANCE": 0.0},
    {"MAX_ALPHA": 0.999},
)
Gradients = dict[str, NDArray]


def precision() -> pd.DataFrame:
    """The kernels against float64 with the same cut-offs, for all degrees of view dependence."""
    return rows_of(_precision, [(degree,) for degree in range(4)], "precision")


def _precision(degree: int) -> dict[str, Any]:
    gaussians, weights = _scene(degree)
    image, state = rasterizer.render(gaussians, CAMERA, sh_degree=degree)
    ours = rasterizer.backward(state, weights).parameters.state_dict()
    exact, theirs, _ = _exact(gaussians, weights, degree)
    return {"simd": SIMD, "sh degree": degree} | _image_error(image, exact) | _gradient_errors(ours, theirs)


def cutoffs() -> pd.DataFrame:
    """Float64 with cut-offs against float64 without any, and how many splats a pixel blends."""
    gaussians, weights = _scene(0)
    with _constants(NOTHING):
        whole, all_gradients, _ = _exact(gaussians, weights, 0)
    rows = []
    for choice in tqdm(CUTOFFS, desc="cut-offs", leave=False):
        with _constants(choice):
            image, gradients, blends = _exact(gaussians, weights, 0)
        about = {"cut-offs": ", ".join(f"{k} {v:.4g}" for k, v in choice.items()) or "the default"}
        rows.append(about | {"blends a pixel": blends} | _image_error(image, whole) | _pooled(gradients, all_gradients))
    return pd.DataFrame(rows)


def _scene(degree: int) -> tuple[Gaussians, NDArray[np.float32]]:
    weights = np.random.default_rng(degree).normal(size=(CAMERA.height, CAMERA.width, 3)).astype(np.float32)
    return room(GAUSSIANS, CAMERA, seed=degree), weights


def _exact(gaussians: Gaussians, weights: NDArray, degree: int) -> tuple[NDArray, Gradients, float]:
    """Image, gradients of its product with the weights, and the mean number of splats a pixel blends."""
    parameters = reference.tensors(gaussians)
    image = reference.render(parameters, CAMERA, torch.zeros(3), degree)
    (image * torch.from_numpy(weights)).sum().backward()
    gradients = {}
    for name, value in parameters.items():
        assert value.grad is not None
        gradients[name] = value.grad.numpy()
    with torch.no_grad():
        blends = reference.blends(parameters, CAMERA) / (CAMERA.width * CAMERA.height)
    return image.detach().numpy(), gradients, blends


def _image_error(image: NDArray, exact: NDArray) -> dict[str, float]:
    error = np.abs(image - exact).max(axis=2)
    return {"image max": float(error.max()), "image p99": float(np.quantile(error, 0.99))}


def _relative(ours: NDArray, theirs: NDArray) -> NDArray[np.float64]:
    """Error of each Gaussian's gradient over its length, where it is large enough to matter."""
    ours, theirs = ours.reshape(len(ours), -1), theirs.reshape(len(theirs), -1)
    size = np.linalg.norm(theirs, axis=1)
    counts = size > LARGE_ENOUGH * size.max()
    return np.asarray(np.linalg.norm(ours - theirs, axis=1)[counts] / size[counts])


def _gradient_errors(ours: Gradients, theirs: Gradients) -> dict[str, float]:
    row = {}
    for name in FIELDS:
        relative = _relative(ours[name], theirs[name])
        row |= {f"{name} median": float(np.median(relative)), f"{name} p99": float(np.quantile(relative, 0.99))}
    return row


def _pooled(ours: Gradients, theirs: Gradients) -> dict[str, float]:
    relative = np.concatenate([_relative(ours[name], theirs[name]) for name in FIELDS])
    return {"gradient median": float(np.median(relative)), "gradient p99": float(np.quantile(relative, 0.99))}


@contextmanager
def _constants(values: dict[str, float]) -> Iterator[None]:
    """Other cut-offs in the float64 renderer, which looks them up when it runs."""
    before = {name: getattr(constants, name) for name in values}
    for name, value in values.items():
        setattr(constants, name, value)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(constants, name, value)

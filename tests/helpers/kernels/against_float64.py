"""Renders and gradients of the kernels beside those of the float64 reference."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from splats import BACKGROUND

from baselines.splatting.backends import torch_rasterizer as reference
from baselines.splatting.gaussians import FIELDS, Gaussians
from baselines.splatting.kernels.constants import NEAR
from baselines.splatting.rasterizer import RenderState, backward, render
from hydroviews.scene.cameras import Camera

Gradients = dict[str, NDArray]


def random_weights(height: int, width: int, seed: int = 1) -> NDArray[np.float32]:
    """Weights of a linear loss [H, W, 3]."""
    return np.random.default_rng(seed).normal(size=(height, width, 3)).astype(np.float32)


def rendered(gaussians: Gaussians, view: Camera, **options: Any) -> tuple[NDArray[np.float32], RenderState, Gradients]:
    """Image, state and gradients of a random linear loss, by the kernels."""
    image, state = render(gaussians, view, BACKGROUND, **options)
    return image, state, backward(state, random_weights(view.height, view.width)).parameters.state_dict()


def leaves_of_sh_sets(
    twin: torch.nn.Module, gaussians: Gaussians, view: Camera, weights: Sequence[NDArray]
) -> dict[str, torch.Tensor]:
    """A scene's tensors with gradients of a linear loss of two renders, by the reference.

    Args:
        twin: an appearance in float64, which gives both sets of colours and gets gradients as well.
        gaussians: of the scene.
        view: of both renders.
        weights: of the loss [H, W, 3], for each render.
    """
    leaves = {name: torch.from_numpy(v).double().requires_grad_() for name, v in gaussians.state_dict().items()}
    background = torch.from_numpy(BACKGROUND).double()
    loss = sum(
        (reference.render({**leaves, "sh": sh}, view, background, 1, 0.01) * torch.from_numpy(weight)).sum()
        for sh, weight in zip(twin.sh_sets(leaves, view, 1, 1), weights, strict=True)
    )
    loss.backward()
    return leaves


def exactly(
    gaussians: Gaussians,
    view: Camera,
    near: float = NEAR,
    sh_degree: int | None = None,
    antialiased: bool = False,
) -> tuple[NDArray, Gradients]:
    """Image and gradients of the same loss, by the reference."""
    parameters = reference.tensors(gaussians)
    degree = gaussians.sh_degree if sh_degree is None else sh_degree
    background = torch.from_numpy(BACKGROUND)
    image = reference.render(parameters, view, background, degree, near, antialiased=antialiased)
    (image * torch.from_numpy(random_weights(view.height, view.width))).sum().backward()
    return image.detach().numpy(), {name: value.grad.numpy() for name, value in parameters.items()}


def assert_same(
    gaussians: Gaussians,
    view: Camera,
    image_error: float = 1e-5,
    gradient_error: float = 1e-5,
    first_error: float | None = None,
    **options: Any,
) -> RenderState:
    """The kernels agree with float64: every pixel, the gradients of all and, where asked for, of the first Gaussian."""
    image, state, gradients = rendered(gaussians, view, **options)
    exact, exact_gradients = exactly(gaussians, view, **options)
    assert np.abs(image - exact).max() <= image_error
    for name in FIELDS:
        ours, theirs = gradients[name], exact_gradients[name]
        assert np.linalg.norm(ours - theirs) <= gradient_error * np.linalg.norm(theirs) + 1e-9, name
        if first_error is not None:
            largest = max(np.linalg.norm(theirs[0]), 1e-3 * np.abs(theirs).max())
            assert np.linalg.norm(ours[0] - theirs[0]) <= first_error * largest + 1e-9, f"{name} of the first"
    return state


def assert_absent(gaussians: Gaussians, view: Camera, rows: int | Sequence[int] | NDArray) -> None:
    """The Gaussians `rows` are culled: image and gradients of the others are bit for bit what they are without."""
    rows = np.atleast_1d(rows)
    others = np.setdiff1d(np.arange(len(gaussians)), rows)
    image, state, gradients = rendered(gaussians, view)
    without, _, expected = rendered(gaussians.select(others), view)
    assert not state.visible[rows].any()
    assert image.tobytes() == without.tobytes()
    for name in FIELDS:
        assert not gradients[name][rows].any(), name
        assert gradients[name][others].tobytes() == expected[name].tobytes(), name

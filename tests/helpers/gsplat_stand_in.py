"""The GPU's backend on the CPU: all of `CudaBackend` but gsplat's own kernels, in whose place the reference renders."""

import sys
from types import SimpleNamespace

import pytest
import torch

from baselines.splatting.backends import torch_rasterizer as reference
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.kernels.constants import LOW_PASS
from hydroviews.scene.cameras import Camera


def rasterization(
    means, quaternions, scales, opacities, sh, pose, matrix, width, height, *,
    near_plane, rasterize_mode, eps2d, sh_degree, packed, absgrad, backgrounds,
):  # fmt: skip
    """What gsplat's function of this name does, of what we use of it, for one camera.

    Absolute gradients are those of the sums, which is what they are where all pixels pull the same way.
    """
    n, planes = len(means), sh.shape[1]
    assert n, "gsplat divides by the number of Gaussians"
    assert eps2d == LOW_PASS
    assert not packed
    shapes = [tuple(value.shape) for value in (quaternions, scales, opacities, sh, pose, matrix, backgrounds)]
    assert shapes == [(n, 4), (n, 3), (n,), (n, planes, 3), (1, 4, 4), (1, 3, 3), (1, 3)]
    k = matrix[0].numpy()
    camera = Camera(width, height, k[0, 0], k[1, 1], k[0, 2], k[1, 2], pose[0].double().numpy())
    values = means, quaternions, scales.log(), opacities.double().clamp_min(1e-12).logit(), sh
    parameters = {name: value.double() for name, value in zip(FIELDS, values, strict=True)}
    means2d = torch.zeros(1, n, 2, dtype=torch.float64, requires_grad=True) + 0  # no leaf, as gsplat's are none
    if absgrad:
        means2d.register_hook(lambda gradient: setattr(means2d, "absgrad", gradient.abs()))
    background, antialiased = backgrounds[0].double(), {"classic": False, "antialiased": True}[rasterize_mode]
    image = reference.render(parameters, camera, background, sh_degree, near_plane, means2d[0], antialiased)
    shown = (opacities.detach() > 1 / 255)[None, :, None].expand(1, -1, 2)
    return image.float()[None], torch.ones(1, height, width, 1), {"means2d": means2d, "radii": shown.int()}


@pytest.fixture
def cuda_backend(monkeypatch):
    """The class, fresh from its module, with a gsplat and a device that are none."""
    monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(rasterization=rasterization))
    monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", SimpleNamespace(_C="kernels"))
    monkeypatch.delitem(sys.modules, "baselines.splatting.backends.cuda", raising=False)
    monkeypatch.setattr(torch.Tensor, "cuda", lambda tensor: tensor.clone())
    monkeypatch.setattr(torch.nn.Module, "cuda", lambda module: module)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda: "none")
    from baselines.splatting.backends.cuda import CudaBackend

    yield CudaBackend
    del sys.modules["baselines.splatting.backends.cuda"]

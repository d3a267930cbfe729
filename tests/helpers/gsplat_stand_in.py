"""The GPU's backend on the CPU: all of `CudaBackend` but gsplat's own kernels, in whose place the reference renders."""

import sys
from types import SimpleNamespace

import pytest
import torch

from baselines.splatting import reference
from baselines.splatting.gaussians import FIELDS
from hydroviews.cameras import Camera


def rasterization(means, quaternions, scales, opacities, sh, pose, matrix, width, height, **options):
    """What gsplat's function of this name does, of what we use of it, for one camera."""
    k = matrix[0].numpy()
    camera = Camera(width, height, k[0, 0], k[1, 1], k[0, 2], k[1, 2], pose[0].double().numpy())
    values = means, quaternions, scales.log(), opacities.double().clamp_min(1e-12).logit(), sh
    parameters = {name: value.double() for name, value in zip(FIELDS, values, strict=True)}
    means2d = torch.zeros(1, len(means), 2, dtype=torch.float64, requires_grad=True)
    background = options["backgrounds"][0].double()
    antialiased = {"classic": False, "antialiased": True}[options["rasterize_mode"]]
    image = reference.render(
        parameters, camera, background, options["sh_degree"], options["near_plane"], means2d[0], antialiased
    )
    shown = (opacities.detach() > 1 / 255)[None, :, None].expand(1, -1, 2)
    return image.float()[None], None, {"means2d": means2d, "radii": shown.int()}


@pytest.fixture
def cuda_backend(monkeypatch):
    """The class, fresh from its module, with a gsplat and a device that are none."""
    monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(rasterization=rasterization))
    monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", SimpleNamespace(_C="kernels"))
    monkeypatch.delitem(sys.modules, "baselines.splatting.cuda", raising=False)
    monkeypatch.setattr(torch.Tensor, "cuda", lambda tensor: tensor.clone())
    monkeypatch.setattr(torch.nn.Module, "cuda", lambda module: module)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda: "none")
    from baselines.splatting.cuda import CudaBackend

    yield CudaBackend
    del sys.modules["baselines.splatting.cuda"]

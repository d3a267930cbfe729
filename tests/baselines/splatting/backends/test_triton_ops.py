"""The GPU's fused loss and Adam against torch in float64: in Triton's interpreter, and on a GPU where there is one.

The interpreter is chosen when Triton is imported, so it has a process of its own.
"""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from ssim_windows import KINDS, hard_weights, loss_by_windows

from baselines.splatting.backends import torch_ops
from baselines.splatting.backends.torch_rasterizer import photometric_loss

pytestmark = pytest.mark.skipif(importlib.util.find_spec("triton") is None, reason="needs triton: pip install triton")
SIZES = ((9, 14), (1, 1), (2, 171))  # the last is wider than a program's block


def compare(device: str) -> None:
    """Raise AssertionError unless they agree."""
    from baselines.splatting.backends import triton_ops

    generator = torch.Generator().manual_seed(0)
    for size in SIZES:
        for hides in (False, True):
            image = torch.rand(*size, 3, generator=generator)
            target = torch.randint(0, 256, (*size, 3), generator=generator, dtype=torch.uint8)
            shown = torch.rand(size, generator=generator) > 0.3 if hides else None
            for weights in (None, 2 * torch.rand(size, generator=generator)):
                compare_losses(triton_ops, device, image, target, shown, weights)
    for kind in KINDS:
        compare_hard_losses(triton_ops, device, kind, generator)
    compare_adam(triton_ops, device, torch.randn(4, 5, 7, 3, generator=generator), torch.rand(21, generator=generator))


def compare_losses(ops, device, image, target, shown, weights) -> None:
    exact = image.double().requires_grad_()
    wanted = photometric_loss(exact, target.double() / 255, 0.2, shown, weights)
    wanted.backward()
    given = [value if value is None else value.to(device) for value in (image, target, shown, weights)]
    for tried in (ops, torch_ops):
        loss, gradient = tried.photometric_loss(given[0], given[1], 0.2, *given[2:])
        assert float(loss) == pytest.approx(wanted.item(), rel=1e-6)
        error = (gradient.cpu() - exact.grad).abs().max() / exact.grad.abs().max()
        assert error < 2e-6, (tried.__name__, tuple(image.shape), float(error))
        assert shown is None or not gradient[~given[2]].any()


def compare_hard_losses(ops, device, kind, generator) -> None:
    """Against every window spelled out, with NaN wherever a pixel counts for nothing."""
    weights = torch.from_numpy(hard_weights(kind, 9, 13))
    image = torch.rand(9, 13, 3, generator=generator)
    target = torch.randint(0, 256, image.shape, generator=generator, dtype=torch.uint8)
    exact = image.double().requires_grad_()
    wanted = loss_by_windows(exact, target.double() / 255, 0.2, weights)
    wanted.backward()
    hidden = weights == 0
    tolerance = 5e-5 if kind == "one pixel" else 2e-6  # alone in its window, whose variance is nothing but rounding
    broken = torch.where(hidden[..., None], torch.nan, image).to(device)
    shown, anything = ~hidden, torch.where(hidden, 3, weights)
    for given in ((None, weights), (shown, anything)):
        where = [value if value is None else value.to(device) for value in given]
        for tried in (ops, torch_ops):
            loss, gradient = tried.photometric_loss(broken, target.to(device), 0.2, *where)
            assert float(loss) == pytest.approx(wanted.item(), rel=tolerance), (tried.__name__, kind)
            error = torch.linalg.norm(gradient.cpu() - exact.grad)
            assert error <= tolerance * torch.linalg.norm(exact.grad), (tried.__name__, kind, float(error))
            assert not gradient.cpu()[hidden].any()


def compare_adam(ops, device, arrays, rates) -> None:
    # A GPU's roots and quotients are off by two units in the last place, each.
    step, tolerance, results = 3, 1e-6 if device == "cpu" else 4e-6, {}
    for tried, dtype in ((ops, torch.float32), (torch_ops, torch.float32), (torch_ops, torch.float64)):
        values, gradient, first, second = (array.to(device, dtype, copy=True) for array in arrays)
        second.abs_()
        broken = torch.zeros(1, dtype=torch.int32, device=device)
        given = rates.to(device, dtype)
        tried.adam_step(values, gradient, first, second, given, step, broken)
        assert not broken.any()
        results[tried, dtype] = [part.cpu().double().clone() for part in (values, first, second)]
        values[1, 2, 0] = float("nan")  # as if it had been lost before
        tried.adam_step(values, gradient, first, second, given, step, broken)
        assert broken.all()
        tried.adam_step(values[:0], gradient[:0], first[:0], second[:0], given, step, broken)  # nothing to do
    for key, found in results.items():
        for one, two in zip(found, results[torch_ops, torch.float64], strict=True):
            assert torch.allclose(one, two, rtol=tolerance, atol=tolerance), key


def test_in_the_interpreter():
    environment = {**os.environ, "TRITON_INTERPRET": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run([sys.executable, __file__, "cpu"], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-2000:]


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs an NVIDIA GPU")
def test_on_a_gpu():
    compare("cuda")


if __name__ == "__main__":
    sys.path.insert(0, str(Path.cwd()))
    compare(sys.argv[1])

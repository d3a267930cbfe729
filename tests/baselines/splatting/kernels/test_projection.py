"""Projection, its gradient and Adam's step in it against float64 torch, with all instructions that there are."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import projection_run
import pytest
import torch
from projection_run import CASES, EXPONENTS, RATES, STEP, VIEW, before, pixels, scene

from baselines.splatting.backends import torch_rasterizer as reference
from baselines.splatting.gaussians import SHAPE
from baselines.splatting.kernels.adam import BETA1, BETA2, EPSILON
from baselines.splatting.kernels.constants import CONIC_SCALE, MIN_ALPHA, NEAR
from baselines.splatting.kernels.simd import VARIABLE, available
from baselines.splatting.kernels.splats.projection import COLOURS, CUTOFF, HALF_HEIGHT, HALF_WIDTH, L11, L21, L22, X, Y

ROOT = Path(__file__).parents[4]


@pytest.fixture(scope="module", params=available())
def found(request, tmp_path_factory):
    """What the kernels return, with one kind of instructions."""
    out = tmp_path_factory.mktemp("projection") / "found.npz"
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests/helpers/scenes")])
    environment = {**os.environ, VARIABLE: request.param, "PYTHONPATH": path}
    subprocess.run([sys.executable, projection_run.__file__, str(out)], env=environment, check=True)
    with np.load(out) as arrays:
        return dict(arrays)


@pytest.fixture(params=range(len(CASES)), ids=[str(tuple(case)) for case in CASES])
def case(request, found):
    """One of the cases, and what was found of it."""
    start = f"{request.param} "
    return CASES[request.param], {k.removeprefix(start): v for k, v in found.items() if k.startswith(start)}


class Exactly:
    """The same in float64, differentiable, of all Gaussians, whether they are shown or not."""

    def __init__(self, case):
        gaussians, sh = scene(case)
        self.parameters = reference.tensors(gaussians)
        self.parameters["sh"] = torch.from_numpy(sh).double().requires_grad_()
        p, pose = self.parameters, torch.from_numpy(VIEW.world_to_camera)
        local = p["means"] @ pose[:3, :3].T + pose[:3, 3]
        self.depths = local[:, 2].detach().numpy()
        self.shift = torch.zeros(case.n, 2, dtype=torch.float64, requires_grad=True)
        focal, middle = torch.from_numpy(np.array([[VIEW.fx, VIEW.fy], [VIEW.cx, VIEW.cy]]))
        self.centres = local[:, :2] / local[:, 2:] * focal + middle + self.shift
        sharp = reference._covariances(p, local, VIEW)
        self.wide = sharp + 0.3 * torch.eye(2, dtype=torch.float64)
        self.opacities = torch.sigmoid(p["opacity_logits"])
        if case.antialiased:
            self.opacities = self.opacities * (torch.linalg.det(sharp) / torch.linalg.det(self.wide)).sqrt()
        directions = torch.nn.functional.normalize(p["means"] + pose[:3, :3].T @ pose[:3, 3], dim=1)
        values = reference.basis(case.degree, directions)
        used = values.shape[1]
        self.colours = (values[None, :, :, None] * p["sh"][:, :, :used]).sum(2) + 0.5  # [L, N, 3]
        self.conics = torch.linalg.inv(self.wide)

    def cutoffs(self):
        """log2(255 opacity) [N], and how far the splats reach [N, 2]."""
        cutoff = torch.log2(self.opacities / MIN_ALPHA)
        deviations = torch.diagonal(self.wide, dim1=1, dim2=2).sqrt()
        return cutoff.detach().numpy(), ((cutoff / CONIC_SCALE).sqrt()[:, None] * deviations).detach().numpy()

    def shown(self):
        """Which Gaussians are [n]."""
        cutoff, reach = self.cutoffs()
        centres = self.centres.detach().numpy()
        inside = (centres + reach > 0).all(1) & (centres - reach < (VIEW.width, VIEW.height)).all(1)
        return np.flatnonzero(inside & (cutoff > 0) & (self.depths > NEAR))

    def backward(self, case, rows):
        """Gradients of the loss that `projection_run.moments` is of, and what its absolute values add up to [n, 2]."""
        apart, gain, by_colour = (torch.from_numpy(values[rows]) for values in pixels(case))
        away = self.centres[rows].detach()[:, None] + apart - self.centres[rows][:, None]
        slopes = torch.einsum("nij,npj->npi", self.conics[rows], away)
        alphas = self.opacities[rows, None] * torch.exp(-0.5 * (away * slopes).sum(2))
        colours = self.colours[:, rows].clamp_min(0).permute(1, 0, 2).reshape(len(rows), -1)
        ((alphas * gain).sum() + (colours * by_colour).sum()).backward()
        return ((alphas * gain)[..., None] * slopes).abs().sum(1).detach().numpy()


def near(ours, theirs, error):
    """Whether rows differ by that share of the largest of them and of themselves at most."""
    ours, theirs = (np.reshape(values, (len(values), -1)) for values in (ours, theirs))
    apart, length = np.linalg.norm(ours - theirs, axis=1), np.linalg.norm(theirs, axis=1)
    return (apart <= error * (length + 1e-2 * length.max(initial=0))).all()


def test_functions(found):
    exponents = EXPONENTS.astype(float)
    with np.errstate(over="ignore"):
        powers = np.exp(exponents).astype(np.float32)
    assert np.allclose(found["powers"], powers, rtol=1e-7, atol=0, equal_nan=True)
    finite = np.isfinite(exponents)
    assert np.allclose(found["logarithms"][finite], exponents[finite] / np.log(2), rtol=1e-7, atol=1e-9)


def test_splats_are_those_of_float64(case):
    case, found = case
    exact = Exactly(case)
    rows = found["gaussian"]
    assert np.array_equal(rows, exact.shown())
    assert len(rows) > 0
    splats, (cutoffs, reach) = found["splats"].astype(float), exact.cutoffs()
    assert np.allclose(splats[:, [X, Y]], exact.centres.detach().numpy()[rows], rtol=1e-7, atol=1e-6)
    l11, l21, l22 = splats[:, L11], splats[:, L21], splats[:, L22]
    conics = np.stack([l11 * l11, l11 * l21, l11 * l21, l21 * l21 + l22 * l22], 1) / CONIC_SCALE
    assert near(conics, exact.conics.detach().numpy()[rows], 1e-5)
    assert np.allclose(splats[:, CUTOFF], cutoffs[rows], rtol=1e-5, atol=1e-6)
    assert np.allclose(splats[:, [HALF_WIDTH, HALF_HEIGHT]], reach[rows], rtol=1e-5)
    colours = exact.colours.detach().clamp_min(0).numpy()[:, rows].transpose(1, 0, 2).reshape(len(rows), -1)
    assert np.allclose(splats[:, COLOURS:], colours, atol=5e-7)
    assert np.allclose(found["depths"], exact.depths[rows], rtol=1e-6)


def test_gradients_are_those_of_float64(case):
    case, found = case
    exact, rows = Exactly(case), found["touched"]  # one that is shown, but in no tile, gains nothing
    absolute = exact.backward(case, rows)
    for name in SHAPE:
        assert near(found[name], exact.parameters[name].grad.numpy(), 1e-4), name
    assert near(found["means2d"], exact.shift.grad.numpy(), 1e-5)
    assert near(found["absolute"][rows], absolute, 1e-5)
    for ours, theirs in zip(found["sh"], exact.parameters["sh"].grad.numpy(), strict=True):
        assert near(ours, theirs, 1e-6)
    hidden = np.setdiff1d(np.arange(case.n), rows)
    assert not any(found[name][hidden].any() for name in (*SHAPE, "means2d", "absolute"))
    assert not found["sh"][:, hidden].any()
    assert not found["sh"][:, :, (case.degree + 1) ** 2 :].any()


def test_adam_takes_its_step_in_the_same_kernel(case):
    case, found = case
    _, sh = scene(case)
    (first, second), gradient = (a.astype(float) for a in before(case)), found["sh"].astype(float)
    first = BETA1 * first + (1 - BETA1) * gradient
    second = BETA2 * second + (1 - BETA2) * gradient**2
    rates = RATES[: sh.shape[2]] / (1 - BETA1**STEP)
    expected = sh - rates * first / (np.sqrt(second / (1 - BETA2**STEP)) + EPSILON)
    assert np.allclose(found["first"], first, rtol=1e-5, atol=1e-6)
    assert np.allclose(found["second"], second, rtol=1e-5)
    assert np.allclose(found["stepped"], expected, rtol=1e-6, atol=1e-7)
    unused = slice((case.degree + 1) ** 2, None)
    assert np.array_equal(found["stepped"][:, :, unused], sh[:, :, unused])
    assert found["same"].all()

"""The renderer and the loss once more in torch, sorted and untiled, slow and plain: the kernels' yardstick."""

import torch
from torch import Tensor

from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels import constants
from baselines.splatting.kernels.splats.sh_coefficients import (
    C0,
    C1,
    C2_XX,
    C2_XY,
    C2_ZZ,
    C3_0,
    C3_1,
    C3_2,
    C3_3,
    C3_XX,
)
from hydroviews.scene.cameras import Camera
from hydroviews.scene.quaternions import rotation_entries

FAINT = 1e-30  # windows whose weight is as little are divided by it


def tensors(gaussians: Gaussians) -> dict[str, Tensor]:
    """The parameters in float64, ready to be differentiated."""
    return {k: torch.from_numpy(v).double().requires_grad_() for k, v in gaussians.state_dict().items()}


def render(
    parameters: dict[str, Tensor],
    camera: Camera,
    background: Tensor,
    degree: int,
    near: float = constants.NEAR,
    shift: Tensor | None = None,
    antialiased: bool = False,
) -> Tensor:
    """The image [H, W, 3] of parameters as `tensors` gives them, differentiable; the cut-offs are the kernels'.

    `shift` [N, 2] moves the splats on the image, in pixels: its gradient is the one by their positions.
    """
    alphas, colours = _splats(parameters, camera, degree, near, shift, antialiased)
    return _composite(alphas, colours.clamp_min(0), background).reshape(camera.height, camera.width, 3)


def blends(parameters: dict[str, Tensor], camera: Camera) -> int:
    """How many splats the pixels of an image blend, all added up."""
    alphas, _ = _splats(parameters, camera, 0, constants.NEAR, None, False)
    return int((_weights(alphas)[0] > 0).sum())


def _splats(
    parameters: dict[str, Tensor], camera: Camera, degree: int, near: float, shift: Tensor | None, antialiased: bool
) -> tuple[Tensor, Tensor]:
    """What each visible Gaussian covers of each pixel [n, H W], nearest first, and its colour [n, 3]."""
    pose = torch.from_numpy(camera.world_to_camera)
    local = parameters["means"] @ pose[:3, :3].T + pose[:3, 3]
    shown = torch.nonzero(local[:, 2].detach() > near)[:, 0]
    shown = shown[torch.argsort(local[shown, 2].detach(), stable=True)]
    p = {name: value[shown] for name, value in parameters.items()}
    local = local[shown]

    centres = local[:, :2] / local[:, 2:] * torch.tensor([camera.fx, camera.fy]) + torch.tensor([camera.cx, camera.cy])
    if shift is not None:
        centres = centres + shift[shown]
    directions = p["means"] + pose[:3, :3].T @ pose[:3, 3]
    directions = directions / directions.norm(dim=1, keepdim=True)
    colours = (basis(degree, directions)[:, :, None] * p["sh"][:, : (degree + 1) ** 2]).sum(1) + 0.5
    sharp = _covariances(p, local, camera)
    wide = sharp + constants.LOW_PASS * torch.eye(2, dtype=torch.float64)
    opacities = torch.sigmoid(p["opacity_logits"])
    if antialiased:
        opacities = opacities * (torch.linalg.det(sharp) / torch.linalg.det(wide)).clamp_min(1e-300).sqrt()
    return _alphas(centres, wide, opacities, camera), colours


def basis(degree: int, directions: Tensor) -> Tensor:
    """Spherical harmonics [N, (degree + 1)^2] of unit vectors [N, 3]."""
    x, y, z = directions.unbind(1)
    xx, yy, zz = x * x, y * y, z * z
    values = [torch.full_like(x, C0), -C1 * y, C1 * z, -C1 * x]
    values += [C2_XY * x * y, -C2_XY * y * z, C2_ZZ * (2 * zz - xx - yy), -C2_XY * x * z, C2_XX * (xx - yy)]
    values += [-C3_3 * y * (3 * xx - yy), C3_2 * x * y * z, -C3_1 * y * (4 * zz - xx - yy)]
    values += [C3_0 * z * (2 * zz - 3 * xx - 3 * yy), -C3_1 * x * (4 * zz - xx - yy)]
    values += [C3_XX * z * (xx - yy), -C3_3 * x * (xx - 3 * yy)]
    return torch.stack(values[: (degree + 1) ** 2], 1)


def rotations(quaternions: Tensor) -> Tensor:
    """Rotation matrices [N, 3, 3]."""
    unit = torch.nn.functional.normalize(quaternions, dim=1)
    return torch.stack(rotation_entries(*unit.unbind(1)), 1).reshape(-1, 3, 3)


def photometric_loss(
    image: Tensor, target: Tensor, lambda_dssim: float, shown: Tensor | None = None, weights: Tensor | None = None
) -> Tensor:
    """(1 - lambda) L1 + lambda (1 - SSIM) as in `photometric`, of images [H, W, 3] in any precision, on any device.

    Where `shown`, bool [H, W], is false, pixels are hidden; `weights` [H, W], from 0 on, are factors on each pixel's
    share, in the windows of SSIM as well.
    """
    x, y = image.permute(2, 0, 1), target.permute(2, 0, 1).to(image.dtype)
    w = _visible_weights(shown, weights)
    if w is not None:
        x, y = (torch.where(w == 0, 0, picture) for picture in (x, y))
    mean_x, mean_y, xx, yy, xy = _window_means(torch.cat([x, y, x * x, y * y, x * y]), w).split(3)
    c1, c2 = 0.01**2, 0.03**2
    ssim = (2 * mean_x * mean_y + c1) * (2 * (xy - mean_x * mean_y) + c2)
    ssim = ssim / ((mean_x**2 + mean_y**2 + c1) * (xx - mean_x**2 + yy - mean_y**2 + c2))
    losses = (1 - lambda_dssim) * (x - y).abs() + lambda_dssim * (1 - ssim)
    return (losses if w is None else w * losses).mean()


def _visible_weights(shown: Tensor | None, weights: Tensor | None) -> Tensor | None:
    """Weights [H, W], at least 0, 0 where pixels are hidden; None where all are 1."""
    if weights is not None:
        weights = weights.clamp_min(0)
    if shown is None:
        return weights
    return shown.float() if weights is None else torch.where(shown, weights, 0)


def _window_means(planes: Tensor, weights: Tensor | None) -> Tensor:
    """Means [N, H, W] of planes in SSIM's windows, weighted where there are weights [H, W]."""
    if weights is None:
        return _filtered(planes)
    weights = weights.to(planes.dtype)[None]
    sums = _filtered(torch.cat([weights * planes, weights, torch.ones_like(weights)]))
    return sums[:-2] / (sums[-2] / sums[-1]).clamp_min(FAINT)


def _filtered(planes: Tensor) -> Tensor:
    """Planes [N, H, W], zero outside, through the Gaussian window."""
    taps = torch.exp(-(torch.arange(-5, 6, dtype=planes.dtype, device=planes.device) ** 2) / (2 * 1.5**2))
    taps = taps / taps.sum()
    planes = torch.nn.functional.conv2d(planes[:, None], taps.view(1, 1, 1, -1), padding=(0, 5))
    return torch.nn.functional.conv2d(planes, taps.view(1, 1, -1, 1), padding=(5, 0))[:, 0]


def _covariances(p: dict[str, Tensor], local: Tensor, camera: Camera) -> Tensor:
    rotation = torch.from_numpy(camera.rotation)
    axes = rotations(p["quaternions"]) * p["log_scales"].exp()[:, None]
    x, y, z = local.unbind(1)
    slopes = []
    for along, focal, centre, size in (
        (x, camera.fx, camera.cx, camera.width),
        (y, camera.fy, camera.cy, camera.height),
    ):
        margin = constants.FRUSTUM_MARGIN * size / focal
        slopes.append((along / z).clamp(-centre / focal - margin, (size - centre) / focal + margin))
    zero = torch.zeros_like(z)
    jacobian = torch.stack([camera.fx / z, zero, -camera.fx * slopes[0] / z], 1)
    jacobian = torch.stack([jacobian, torch.stack([zero, camera.fy / z, -camera.fy * slopes[1] / z], 1)], 1)
    rows = jacobian @ rotation @ axes
    return rows @ rows.transpose(1, 2)


def _alphas(centres: Tensor, covariances: Tensor, opacities: Tensor, camera: Camera) -> Tensor:
    """What each Gaussian covers of each pixel [N, H W], after the cut-offs."""
    y, x = torch.meshgrid(
        torch.arange(camera.height, dtype=torch.float64) + 0.5,
        torch.arange(camera.width, dtype=torch.float64) + 0.5,
        indexing="ij",
    )
    dx, dy = x.reshape(1, -1) - centres[:, :1], y.reshape(1, -1) - centres[:, 1:]
    xx, xy, yy = (covariances[:, i, j, None] for i, j in ((0, 0), (0, 1), (1, 1)))
    sigma = 0.5 * (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    alphas = (opacities[:, None] * torch.exp(-sigma)).clamp_max(constants.MAX_ALPHA)
    return torch.where(alphas >= constants.MIN_ALPHA, alphas, torch.zeros_like(alphas))


def _composite(alphas: Tensor, colours: Tensor, background: Tensor) -> Tensor:
    """Front to back [H W, 3]."""
    weights, left = _weights(alphas)
    return weights.T @ colours + left[:, None] * background.double()


def _weights(alphas: Tensor) -> tuple[Tensor, Tensor]:
    """Each splat's share of each pixel [n, H W], and the background's [H W].

    A pixel takes nothing more once its transmittance would fall below the cut-off.
    """
    after = torch.cumprod(1 - alphas, 0)
    before = torch.cat([torch.ones_like(after[:1]), after[:-1]])
    unfinished = (after.detach() >= constants.MIN_TRANSMITTANCE) | (alphas.detach() == 0)
    unfinished = torch.cummin(unfinished.int(), 0).values.bool() if len(alphas) else unfinished
    weights = torch.where(unfinished, alphas * before, torch.zeros_like(alphas))
    return weights, torch.where(unfinished, 1 - alphas, torch.ones_like(alphas)).prod(0)

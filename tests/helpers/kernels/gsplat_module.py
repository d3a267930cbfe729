"""gsplat 1.5.3's compiled module, replayed in torch on the CPU, so that gsplat's own Python runs without a GPU.

Written from what its CUDA kernels compute, with their cut-offs: an alpha of at most 0.999 and no less than 1/255, light
that ends at 1e-4, boxes of at most 3.33 standard deviations in whole tiles, absolute gradients of every pixel. Memory
that they leave uninitialised is NaN. Inputs that they refuse are refused.

Every gradient is torch's own of the same formula in float64, so formulas stand here once.
"""

import inspect
import math
from collections.abc import Callable, Iterator, Sequence
from types import ModuleType, SimpleNamespace
from typing import Any

import torch
from torch import Tensor

MAX_ALPHA, MIN_ALPHA, MIN_LIGHT, MAX_SIGMAS = 0.999, 1 / 255, 1e-4, 3.33


def compiled_module(on_device: Callable[[Tensor], bool], launch: Callable[..., Any]) -> ModuleType:
    """What `from gsplat import csrc` finds where gsplat was installed with its kernels.

    Args:
        on_device: whether a tensor is in the GPU's memory.
        launch: calls a kernel with its arguments.
    """
    module = ModuleType("gsplat.csrc")
    module.__spec__ = SimpleNamespace(name="gsplat.csrc", loader=None)  # type: ignore[assignment]
    for kernel in KERNELS:
        setattr(module, kernel.__name__, _checked(kernel, on_device, launch))
    module.CameraModelType = SimpleNamespace(PINHOLE="pinhole")  # type: ignore[attr-defined]
    module.PINHOLE = "pinhole"  # type: ignore[attr-defined]  # where gsplat looks for it
    return module


def _checked(kernel: Callable, on_device: Callable[[Tensor], bool], launch: Callable[..., Any]) -> Callable:
    """A kernel that first looks at its tensors, as CHECK_INPUT and `data_ptr<float>` do."""
    names = list(inspect.signature(kernel).parameters)

    def call(*arguments: Any) -> Any:
        for name, value in zip(names, arguments, strict=True):
            if not isinstance(value, Tensor):
                continue
            if not (on_device(value) or name.startswith("grad_")):  # autograd makes zeros where it likes
                raise RuntimeError(f"{kernel.__name__}: {name} must be a CUDA tensor")
            if not value.is_contiguous():
                raise RuntimeError(f"{kernel.__name__}: {name} must be contiguous")
            if value.is_floating_point() and value.dtype != torch.float32:
                raise RuntimeError(f"{kernel.__name__}: expected {name} of type Float, found {value.dtype}")
        return launch(kernel, *arguments)

    return call


def _project(
    means: Tensor, quats: Tensor, scales: Tensor, viewmats: Tensor, ks: Tensor, size: tuple[int, int], eps2d: float
) -> SimpleNamespace:
    """Splats of Gaussians: centres [1, N, 2], depths, blurred covariances, their inverses, and what blur took."""
    from gsplat.cuda import _torch_impl as by_gsplat

    covariances, _ = by_gsplat._quat_scale_to_covar_preci(quats, scales, True, False)
    local, covariances = by_gsplat._world_to_cam(means, covariances, viewmats)
    centres, sharp = by_gsplat._persp_proj(local, covariances, ks, *size)
    blurred = sharp + eps2d * torch.eye(2, dtype=sharp.dtype)
    area = _determinant(blurred)
    inverse = torch.stack([blurred[..., 1, 1], -blurred[..., 0, 1], blurred[..., 0, 0]], -1) / area[..., None]
    compensations = (_determinant(sharp) / area).clamp_min(1e-12).sqrt()
    return SimpleNamespace(
        centres=centres, depths=local[..., 2], blurred=blurred, area=area, conics=inverse, compensations=compensations
    )


def _determinant(matrix: Tensor) -> Tensor:
    return matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]


@torch.no_grad()
def projection_ewa_3dgs_fused_fwd(
    means, covars, quats, scales, opacities, viewmats, ks, width, height, eps2d, near, far, clip, antialiased, model
):  # fmt: skip
    """Radii in pixels [1, N, 2], 0 where a Gaussian is culled; centres, depths, conics and compensations."""
    assert (covars, model) == (None, "pinhole"), "not what HydroViews asks for"
    splats = _project(*_doubles(means, quats, scales, viewmats, ks), (width, height), eps2d)
    opacity = opacities.double()[None] * (splats.compensations if antialiased else 1)
    sigmas = (2 * (opacity / MIN_ALPHA).log()).clamp_min(0).sqrt().clamp_max(MAX_SIGMAS)
    radii = (sigmas[..., None] * splats.blurred.diagonal(dim1=-2, dim2=-1).sqrt()).ceil()
    beyond = torch.tensor([width, height])
    culled = (splats.depths < near) | (splats.depths > far) | (splats.area <= 0) | (opacity < MIN_ALPHA)
    culled |= (radii <= clip).all(-1)
    culled |= ((splats.centres + radii <= 0) | (splats.centres - radii >= beyond)).any(-1)
    written = [_unwritten(value, culled) for value in (splats.centres, splats.depths, splats.conics)]
    compensations = torch.where(culled, 0, splats.compensations).float() if antialiased else None
    return torch.where(culled[..., None], 0, radii.nan_to_num(0)).int(), *written, compensations


def projection_ewa_3dgs_fused_bwd(
    means, covars, quats, scales, viewmats, ks, width, height, eps2d, model, radii, conics, compensations,
    grad_centres, grad_depths, grad_conics, grad_compensations, camera_learns,
):  # fmt: skip
    """Gradients by means, quaternions and scales; zero for culled Gaussians, whatever theirs are."""
    assert not camera_learns
    shown = (radii[0] > 0).all(-1)
    gradients = [torch.zeros_like(value) for value in (means, quats, scales)]
    leaves = [value.detach()[shown].double().requires_grad_() for value in (means, quats, scales)]
    with torch.enable_grad():
        splats = _project(*leaves, *_doubles(viewmats, ks), (width, height), eps2d)
        outputs = [splats.centres, splats.depths, splats.conics]
        by = [grad_centres, grad_depths, grad_conics]
        if grad_compensations is not None:
            outputs, by = [*outputs, splats.compensations], [*by, grad_compensations]
        found = torch.autograd.grad(outputs, leaves, [value[:, shown].double() for value in by])
    for gradient, value in zip(gradients, found, strict=True):
        gradient[shown] = value.float()
    return gradients[0], None, gradients[1], gradients[2], None


def spherical_harmonics_fwd(degree, directions, coefficients, shown):
    """Colours [1, N, 3], of shown Gaussians alone."""
    colours = torch.full_like(directions, math.nan)
    colours[shown] = _colours(degree, directions[shown].double(), coefficients[shown].double()).float()
    return colours


def spherical_harmonics_bwd(planes, degree, directions, coefficients, shown, grad_colours, directions_learn):
    """Gradients by coefficients and directions; zero where nothing is shown."""
    gradients = [torch.zeros_like(coefficients), torch.zeros_like(directions)]
    leaves = [value.detach()[shown].double().requires_grad_() for value in (coefficients, directions)]
    with torch.enable_grad():
        colours = _colours(degree, leaves[1], leaves[0])
        found = torch.autograd.grad(colours, leaves, grad_colours[shown].double(), allow_unused=True)
    for gradient, value in zip(gradients, found, strict=True):
        if value is not None:  # a constant colour has no direction
            gradient[shown] = value.float()
    return gradients[0], gradients[1] if directions_learn else None


def _colours(degree: int, directions: Tensor, coefficients: Tensor) -> Tensor:
    from gsplat.cuda import _torch_impl as by_gsplat

    return by_gsplat._spherical_harmonics(degree, directions, coefficients)


def intersect_tile(
    centres, radii, depths, images, gaussians, n_images, side, columns, rows, sort, segmented
):  # fmt: skip
    """How many tiles a splat's box touches [1, N]; tile and depth as one number, and the splat, sorted by it."""
    assert (n_images, images, sort, segmented) == (1, None, True, False), "not what HydroViews asks for"
    shown = (radii[0] > 0).all(-1)
    middle, reach = centres[0].nan_to_num(0) / side, radii[0] / side
    grid = torch.stack(torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")[::-1], -1)
    first, end = (middle - reach).floor()[:, None, None], (middle + reach).ceil()[:, None, None]
    touched = ((grid >= first) & (grid < end)).all(-1) & shown[:, None, None]
    splat, row, column = touched.nonzero().unbind(1)
    bits = depths[0].contiguous().view(torch.int32).long() & 0xFFFFFFFF
    keys = (row * columns + column) << 32 | bits[splat]
    order = keys.argsort(stable=True)
    return touched.sum((1, 2)).int()[None], keys[order], splat[order].int()


def intersect_offset(keys, n_images, columns, rows):
    """Where each tile's splats begin in the list [1, rows, columns]."""
    tiles = torch.arange(rows * columns)
    return torch.searchsorted(keys >> 32, tiles).int().reshape(1, rows, columns)


def _tiles(
    offsets: Tensor, ids: Tensor, side: int, width: int, height: int
) -> Iterator[tuple[tuple[slice, slice], Tensor]]:
    """The pixels of each tile that shows anything, and its splats, front to back."""
    _, rows, columns = offsets.shape
    ends = [*offsets.flatten().tolist(), len(ids)]
    for tile in range(rows * columns):
        splats = ids[ends[tile] : ends[tile + 1]].long()
        y, x = tile // columns * side, tile % columns * side
        if len(splats):
            yield (slice(y, min(y + side, height)), slice(x, min(x + side, width))), splats


def _blend(
    pixels: tuple[slice, slice], centres: Tensor, conics: Tensor, colours: Tensor, opacities: Tensor
) -> tuple[Tensor, Tensor]:
    """Colours [h, w, 3] of a tile without background, and how much light comes through [h, w].

    Args:
        pixels: rows and columns.
        centres: of the splats, for every pixel a copy [n, h, w, 2], so that gradients can be told apart.
        conics: [n, 3].
        colours: [n, 3].
        opacities: [n].
    """
    y, x = (torch.arange(span.start, span.stop, dtype=torch.float64) + 0.5 for span in pixels)
    dx, dy = centres[..., 0] - x, centres[..., 1] - y[:, None]
    a, b, c = (conics[:, k, None, None] for k in range(3))
    sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
    alpha = (opacities[:, None, None] * (-sigma).exp()).clamp_max(MAX_ALPHA)
    counts = (sigma >= 0) & (alpha >= MIN_ALPHA)
    alpha = torch.where(counts, alpha, 0)
    dark = counts & ((1 - alpha).cumprod(0) <= MIN_LIGHT)  # the splat that would make it so is left out already
    alpha = torch.where(dark.int().cumsum(0) == 0, alpha, 0)
    light = (1 - alpha).cumprod(0)
    before = torch.cat([torch.ones_like(light[:1]), light[:-1]])
    return torch.einsum("nhw,nc->hwc", alpha * before, colours), light[-1]


@torch.no_grad()
def rasterize_to_pixels_3dgs_fwd(
    centres, conics, colours, opacities, backgrounds, masks, width, height, side, offsets, ids
):  # fmt: skip
    """Images [1, H, W, C], how much of each pixel is covered [1, H, W, 1], and what only the kernels need."""
    assert masks is None
    image = torch.zeros(height, width, colours.shape[-1], dtype=torch.float64)
    light = torch.ones(height, width, dtype=torch.float64)
    for pixels, splats in _tiles(offsets, ids, side, width, height):
        values = [value[0, splats].double() for value in (centres, conics, colours, opacities)]
        image[pixels], light[pixels] = _blend(pixels, values[0][:, None, None], *values[1:])
    if backgrounds is not None:
        image += light[..., None] * backgrounds[0].double()
    last = torch.zeros(1, height, width, dtype=torch.int32)
    return image.float()[None], (1 - light).float()[None, ..., None], last


def rasterize_to_pixels_3dgs_bwd(
    centres, conics, colours, opacities, backgrounds, masks, width, height, side, offsets, ids, alphas, last,
    grad_image, grad_alphas, absolute,
):  # fmt: skip
    """Gradients by centres, all pixels' added up without their signs, and with; by conics, colours and opacities."""
    found = [torch.zeros_like(value, dtype=torch.float64) for value in (centres, centres, conics, colours, opacities)]
    for pixels, splats in _tiles(offsets, ids, side, width, height):
        values = [value.detach()[0, splats].double() for value in (centres, conics, colours, opacities)]
        down, across = (span.stop - span.start for span in pixels)
        leaves = [values[0][:, None, None].repeat(1, down, across, 1), *values[1:]]
        with torch.enable_grad():
            image, light = _blend(pixels, *(leaf.requires_grad_() for leaf in leaves))
            if backgrounds is not None:
                image = image + light[..., None] * backgrounds[0].double()
            by = [grad_image[0][pixels].double(), -grad_alphas[0][pixels][..., 0].double()]
            pulls, *rest = torch.autograd.grad([image, light], leaves, by)
        for total, value in zip(found, [pulls.abs().sum((1, 2)), pulls.sum((1, 2)), *rest], strict=True):
            total[0].index_add_(0, splats, value)
    without_sign, *gradients = [value.float() for value in found]
    return without_sign if absolute else None, *gradients


def _unwritten(value: Tensor, where: Tensor) -> Tensor:
    """As float32, NaN where a kernel writes nothing."""
    return torch.where(where.reshape(*where.shape, *[1] * (value.ndim - where.ndim)), math.nan, value).float()


def _doubles(*values: Tensor) -> Sequence[Tensor]:
    return [value.detach().double() for value in values]


KERNELS = (
    projection_ewa_3dgs_fused_fwd,
    projection_ewa_3dgs_fused_bwd,
    spherical_harmonics_fwd,
    spherical_harmonics_bwd,
    intersect_tile,
    intersect_offset,
    rasterize_to_pixels_3dgs_fwd,
    rasterize_to_pixels_3dgs_bwd,
)

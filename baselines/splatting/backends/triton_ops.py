# Triton's kernels have no types.
# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc"
"""The loss and Adam on a GPU in five Triton kernels; `torch_ops` has the same in a hundred launches of torch's.

An image [H, W, 3] is a plane of H rows of 3 W numbers: along a row, the next pixel of the same channel is three on.
"""

import functools
import math

import torch
import triton
import triton.language as tl
from torch import Tensor

from baselines.splatting.kernels.adam import BETA1, BETA2, EPSILON

RADIUS, SIGMA = 5, 1.5  # of SSIM's window
C1, C2 = 0.01**2, 0.03**2
FAINT = tl.constexpr(1e-30)  # windows whose weight is as little are divided by it
BLOCK = 512  # numbers a program


def photometric_loss(
    image: Tensor, target: Tensor, lambda_dssim: float, shown: Tensor | None, weights: Tensor | None
) -> tuple[Tensor, Tensor]:
    """As `torch_ops.photometric_loss`."""
    image = image.contiguous()
    height, row = image.shape[0], image.shape[1] * 3
    taps, blocks = _window(image.device), triton.cdiv(row, BLOCK)
    grid, shape = (height, blocks), (height, row, RADIUS, BLOCK)
    varies = shown is not None, weights is not None
    seen = shown.view(torch.uint8) if shown is not None else target
    factors = weights.contiguous() if weights is not None else image
    moments, slopes, blurred = (image.new_empty(planes, height, row) for planes in (5 + any(varies), 3, 3))
    losses, gradient = image.new_empty(height, blocks), torch.empty_like(image)
    pictures = image, target, seen, factors
    _blur_pictures[grid](*pictures, taps, moments, *shape, *varies)
    lambdas = lambda_dssim, C1, C2
    _compare[grid](*pictures, taps, moments, slopes, losses, *lambdas, *shape, *varies)
    _blur_slopes[grid](slopes, taps, blurred, *shape)
    share = 1 / image.numel()
    _gradient[grid](*pictures, taps, blurred, gradient, lambda_dssim, share, *shape, *varies)
    return losses.sum() * share, gradient


def adam_step(
    values: Tensor, gradient: Tensor, first: Tensor, second: Tensor, rates: Tensor, step: int, broken: Tensor
) -> None:
    """As `torch_ops.adam_step`."""
    n = values.numel()
    if not n:
        return
    root, scale = 1 / math.sqrt(1 - BETA2**step), 1 / (1 - BETA1**step)
    constants = BETA1, BETA2, root, scale, EPSILON
    grid = (triton.cdiv(n, BLOCK),)
    _adam[grid](values, gradient.contiguous(), first, second, rates, broken, n, rates.numel(), *constants, BLOCK)


@functools.cache
def _window(device: torch.device) -> Tensor:
    """The weights of SSIM's window along an axis."""
    taps = torch.exp(-(torch.arange(-RADIUS, RADIUS + 1, dtype=torch.float64) ** 2) / (2 * SIGMA**2))
    return (taps / taps.sum()).float().to(device)


@triton.jit
def _pixels(image, target, shown, weights, line, at, row, inside, HIDDEN: tl.constexpr, WEIGHED: tl.constexpr):
    """Both pictures and the weight of each number, 0 where hidden, without weight, or outside."""
    pixel = line * (row // 3) + at // 3
    if HIDDEN:
        inside = inside & (tl.load(shown + pixel, mask=inside, other=0) != 0)
    if WEIGHED:
        weight = tl.maximum(tl.load(weights + pixel, mask=inside, other=0.0), 0.0)
        inside = inside & (weight != 0)
    else:
        weight = inside.to(tl.float32)
    x = tl.load(image + line * row + at, mask=inside, other=0.0)
    y = tl.load(target + line * row + at, mask=inside, other=0).to(tl.float32) / 255
    return x, y, weight


@triton.jit
def _blur_pictures(
    image,
    target,
    shown,
    weights,
    taps,
    out,
    height,
    row,
    RADIUS: tl.constexpr,
    BLOCK: tl.constexpr,
    HIDDEN: tl.constexpr,
    WEIGHED: tl.constexpr,
):
    """Along rows: x, y, x^2, y^2 and x y by their weights; where these vary, they themselves by what is inside."""
    line = tl.program_id(0)
    at = tl.program_id(1) * BLOCK + tl.arange(0, BLOCK)
    mean_x = tl.zeros([BLOCK], tl.float32)
    mean_y, xx, yy, xy, total, part = mean_x, mean_x, mean_x, mean_x, mean_x, mean_x
    for k in tl.static_range(2 * RADIUS + 1):
        column = at + 3 * (k - RADIUS)
        there = (column >= 0) & (column < row)
        x, y, weight = _pixels(image, target, shown, weights, line, column, row, there, HIDDEN, WEIGHED)
        tap = tl.load(taps + k)
        if HIDDEN or WEIGHED:
            part += tl.where(there, tap, 0.0)
            tap *= weight
            total += tap
        mean_x += tap * x
        mean_y += tap * y
        xx += tap * x * x
        yy += tap * y * y
        xy += tap * x * y
    to, plane, inside = out + line * row + at, height * row, at < row
    tl.store(to, mean_x, mask=inside)
    tl.store(to + plane, mean_y, mask=inside)
    tl.store(to + 2 * plane, xx, mask=inside)
    tl.store(to + 3 * plane, yy, mask=inside)
    tl.store(to + 4 * plane, xy, mask=inside)
    if HIDDEN or WEIGHED:
        # Columns beyond the row have no part inside, and are not stored.
        tl.store(to + 5 * plane, total / tl.where(inside, part, 1.0), mask=inside)


@triton.jit
def _compare(
    image,
    target,
    shown,
    weights,
    taps,
    moments,
    slopes,
    losses,
    lambda_dssim,
    c1,
    c2,
    height,
    row,
    RADIUS: tl.constexpr,
    BLOCK: tl.constexpr,
    HIDDEN: tl.constexpr,
    WEIGHED: tl.constexpr,
):
    """Along columns, then what each pixel adds to the loss, and the slopes of SSIM by the means of x, x^2 and x y."""
    line = tl.program_id(0)
    at = tl.program_id(1) * BLOCK + tl.arange(0, BLOCK)
    plane, inside = height * row, at < row
    mean_x = tl.zeros([BLOCK], tl.float32)
    mean_y, xx, yy, xy, total, part = mean_x, mean_x, mean_x, mean_x, mean_x, mean_x
    for k in tl.static_range(2 * RADIUS + 1):
        other = line + k - RADIUS
        there = inside & (other >= 0) & (other < height)
        source = moments + other * row + at
        tap = tl.load(taps + k)
        mean_x += tap * tl.load(source, mask=there, other=0.0)
        mean_y += tap * tl.load(source + plane, mask=there, other=0.0)
        xx += tap * tl.load(source + 2 * plane, mask=there, other=0.0)
        yy += tap * tl.load(source + 3 * plane, mask=there, other=0.0)
        xy += tap * tl.load(source + 4 * plane, mask=there, other=0.0)
        if HIDDEN or WEIGHED:
            total += tap * tl.load(source + 5 * plane, mask=there, other=0.0)
            part += tl.where(there, tap, 0.0)
    x, y, weight = _pixels(image, target, shown, weights, line, at, row, inside, HIDDEN, WEIGHED)
    slope = weight
    if HIDDEN or WEIGHED:
        inverse = 1 / tl.maximum(total / tl.where(inside, part, 1.0), FAINT)
        slope = weight * inverse
        mean_x *= inverse
        mean_y *= inverse
        xx *= inverse
        yy *= inverse
        xy *= inverse
    a1 = 2 * mean_x * mean_y + c1
    a2 = 2 * (xy - mean_x * mean_y) + c2
    b1 = mean_x * mean_x + mean_y * mean_y + c1
    b2 = xx - mean_x * mean_x + yy - mean_y * mean_y + c2
    ssim = a1 * a2 / (b1 * b2)
    by_mean = 2 * mean_y * (a2 - a1) / (b1 * b2) - 2 * mean_x * ssim * (1 / b1 - 1 / b2)
    loss = (1 - lambda_dssim) * tl.abs(x - y) + lambda_dssim * (1 - ssim)
    tl.store(losses + line * tl.num_programs(1) + tl.program_id(1), tl.sum(weight * loss))
    to = slopes + line * row + at
    tl.store(to, slope * by_mean, mask=inside)
    tl.store(to + plane, -slope * ssim / b2, mask=inside)
    tl.store(to + 2 * plane, 2 * slope * a1 / (b1 * b2), mask=inside)


@triton.jit
def _blur_slopes(slopes, taps, out, height, row, RADIUS: tl.constexpr, BLOCK: tl.constexpr):
    """Along rows."""
    line = tl.program_id(0)
    at = tl.program_id(1) * BLOCK + tl.arange(0, BLOCK)
    plane = height * row
    mean = tl.zeros([BLOCK], tl.float32)
    xx, xy = mean, mean
    for k in tl.static_range(2 * RADIUS + 1):
        column = at + 3 * (k - RADIUS)
        there = (column >= 0) & (column < row)
        source = slopes + line * row + column
        weight = tl.load(taps + k)
        mean += weight * tl.load(source, mask=there, other=0.0)
        xx += weight * tl.load(source + plane, mask=there, other=0.0)
        xy += weight * tl.load(source + 2 * plane, mask=there, other=0.0)
    to, inside = out + line * row + at, at < row
    tl.store(to, mean, mask=inside)
    tl.store(to + plane, xx, mask=inside)
    tl.store(to + 2 * plane, xy, mask=inside)


@triton.jit
def _gradient(
    image,
    target,
    shown,
    weights,
    taps,
    blurred,
    gradient,
    lambda_dssim,
    share,
    height,
    row,
    RADIUS: tl.constexpr,
    BLOCK: tl.constexpr,
    HIDDEN: tl.constexpr,
    WEIGHED: tl.constexpr,
):
    """Along columns, then the gradient of the loss by x."""
    line = tl.program_id(0)
    at = tl.program_id(1) * BLOCK + tl.arange(0, BLOCK)
    plane, inside = height * row, at < row
    mean = tl.zeros([BLOCK], tl.float32)
    xx, xy = mean, mean
    for k in tl.static_range(2 * RADIUS + 1):
        other = line + k - RADIUS
        there = inside & (other >= 0) & (other < height)
        source = blurred + other * row + at
        weight = tl.load(taps + k)
        mean += weight * tl.load(source, mask=there, other=0.0)
        xx += weight * tl.load(source + plane, mask=there, other=0.0)
        xy += weight * tl.load(source + 2 * plane, mask=there, other=0.0)
    x, y, weight = _pixels(image, target, shown, weights, line, at, row, inside, HIDDEN, WEIGHED)
    sign = tl.where(x > y, 1.0, 0.0) - tl.where(x < y, 1.0, 0.0)
    by_x = (1 - lambda_dssim) * sign - lambda_dssim * (mean + 2 * x * xx + y * xy)
    tl.store(gradient + line * row + at, share * weight * by_x, mask=inside)


@triton.jit
def _adam(
    values,
    gradients,
    first,
    second,
    rates,
    broken,
    n,
    period,
    beta1,
    beta2,
    root,
    scale,
    epsilon,
    BLOCK: tl.constexpr,
):
    """One step; `rates` repeats along the values. `broken` becomes 1 where a value is no longer finite."""
    at = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = at < n
    gradient = tl.load(gradients + at, mask=inside, other=0.0)
    m = beta1 * tl.load(first + at, mask=inside, other=0.0) + (1 - beta1) * gradient
    v = beta2 * tl.load(second + at, mask=inside, other=0.0) + (1 - beta2) * gradient * gradient
    rate = scale * tl.load(rates + at % period)
    value = tl.load(values + at, mask=inside, other=0.0) - rate * m / (tl.sqrt(v) * root + epsilon)
    tl.store(first + at, m, mask=inside)
    tl.store(second + at, v, mask=inside)
    tl.store(values + at, value, mask=inside)
    lost = tl.max((inside & ((value - value) != 0)).to(tl.int32))
    if lost > 0:
        tl.store(broken, 1)

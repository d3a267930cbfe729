"""Projection, its gradient and Adam on made-up moments, in a process of its own: `simd.py` chooses once a process.

`python projection_run.py OUT.npz` writes what they return for every case of CASES.
"""

import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from splats import camera, cloud

from baselines.splatting.gaussians import SHAPE, Gaussians
from baselines.splatting.kernels.adam import settings
from baselines.splatting.kernels.chunks import CHUNKS
from baselines.splatting.kernels.constants import NEAR
from baselines.splatting.kernels.jit import serial_kernel
from baselines.splatting.kernels.splats.geometry import exp64, log2
from baselines.splatting.kernels.splats.projection import COLOURS, L11, L21, L22, LOG2_OPACITY, project
from baselines.splatting.kernels.splats.projection_gradient import project_gradient
from baselines.splatting.kernels.vector.memory import gather, store64
from baselines.splatting.kernels.vector.vectors import LANES64, to_float32

VIEW = camera(61, 47)
PIXELS, STEP = 5, 3
RATES = np.linspace(1e-3, 2e-3, 48, dtype=np.float32).reshape(16, 3)
EXPONENTS = np.array([0, 1, -1, 0.3, -80, 80, 600, np.nan, *np.linspace(-9, 9, 120)], np.float32)


class Case(NamedTuple):
    """One call."""

    n: int
    stored: int  # degree
    degree: int
    sets: int = 1
    antialiased: bool = False


CASES = (
    Case(1700, 3, 3),
    Case(203, 3, 1, 2),
    Case(150, 2, 2, 1, True),
    Case(90, 1, 1),
    Case(70, 0, 0, 3),
    Case(1, 3, 2),
)


def scene(case: Case) -> tuple[Gaussians, NDArray[np.float32]]:
    """Gaussians, of which many are out of sight, and sets of coefficients [L, N, K, 3]."""
    gaussians = cloud(case.n, case.stored, seed=case.n)
    gaussians.means[:] *= 2 if case.n > 1 else 0.1
    noise = np.random.default_rng(1).normal(0, 0.1, (case.sets, *gaussians.sh.shape))
    return gaussians, (gaussians.sh + noise).astype(np.float32)


def pixels(case: Case) -> tuple[NDArray, NDArray, NDArray]:
    """For every Gaussian where made-up pixels are, from its centre [N, P, 2], what the loss gains by what it covers of
    them [N, P], and by its colours [N, 3 L]."""
    generator = np.random.default_rng(2)
    return (
        generator.normal(0, 2, (case.n, PIXELS, 2)),
        generator.normal(size=(case.n, PIXELS)),
        generator.normal(size=(case.n, 3 * case.sets)),
    )


def moments(case: Case, splats: NDArray, gaussian: NDArray) -> NDArray[np.float32]:
    """Rows for splats [n, 9 + 3 L] of some Gaussians [n]: of two pairs each, of which the second has the last pixel."""
    apart, gain, by_colour = (values[gaussian] for values in pixels(case))
    l11, l21, l22, log2_opacity = (splats[:, column, None].astype(float) for column in (L11, L21, L22, LOG2_OPACITY))
    u, v = l11 * apart[..., 0] + l21 * apart[..., 1], l22 * apart[..., 1]
    w = gain * np.exp2(log2_opacity - u * u - v * v)
    terms = [w, w * u, w * v, w * u * u, w * u * v, w * v * v, np.abs(w * u), np.abs(l21 / l22 * w * u + w * v)]
    rows = np.zeros((len(splats), 2, 16 * ((8 + 3 * case.sets + 15) // 16)), np.float32)
    for column, term in enumerate(terms):
        rows[:, 0, column], rows[:, 1, column] = term[:, :-1].sum(1), term[:, -1]
    rows[:, 1, 8 : 8 + 3 * case.sets] = by_colour
    return rows.reshape(2 * len(splats), -1)


def run(case: Case) -> dict[str, NDArray]:
    """What the kernels return."""
    gaussians, sh = scene(case)
    n, shape = case.n, [getattr(gaussians, name) for name in SHAPE]
    pose = VIEW.world_to_camera
    lens = np.array([VIEW.fx, VIEW.fy, VIEW.cx, VIEW.cy])
    view = pose, -pose[:3, :3].T @ pose[:3, 3], lens, VIEW.width, VIEW.height
    splats, depths = np.full((n, COLOURS + 3 * case.sets), np.nan, np.float32), np.full(n, np.nan, np.float32)
    gaussian, counts = np.full(n, -1, np.int32), np.empty(CHUNKS, np.int32)
    project(*shape, sh, case.degree, *view, NEAR, case.antialiased, splats, depths, gaussian, counts)
    slots = np.concatenate([chunk * n // CHUNKS + np.arange(count) for chunk, count in enumerate(counts)])
    pair_start, pair_end = np.zeros(n, np.int32), np.zeros(n, np.int32)
    pair_start[slots] = 2 * np.arange(len(slots))
    pair_end[slots] = pair_start[slots] + 2
    rows = moments(case, splats[slots], gaussian[slots])
    rows = np.concatenate([rows, np.full_like(rows[:1], np.nan)])  # the gradient stays away from what is no pair's
    touched = slots[: max(1, len(slots) - 1)]
    pair_start[slots[len(touched) :]] = pair_end[slots[len(touched) :]] = len(rows) - 1
    found = {"splats": splats[slots], "depths": depths[slots], "gaussian": gaussian[slots]}
    found["touched"] = gaussian[touched]

    def gradient(sh: NDArray[np.float32], form: tuple[NDArray, ...]) -> list[NDArray[np.float32]]:
        small = [np.full_like(value, np.nan) for value in shape]
        small += [np.full((n, 2), np.nan, np.float32) for _ in range(2)]
        project_gradient(
            *shape, sh, case.degree, *view, case.antialiased,
            splats, gaussian, counts, pair_start, pair_end, rows, *small, form,
        )  # fmt: skip
        return small

    g_sh = np.full_like(sh, np.nan)
    written = gradient(sh, (g_sh.reshape(-1),))
    found |= dict(zip((*SHAPE, "means2d", "absolute"), written, strict=True)) | {"sh": g_sh}
    first, second = before(case)
    rates, constants = settings(STEP, RATES[: sh.shape[2]])
    learned = gradient(sh, (first.reshape(-1), second.reshape(-1), rates, constants))
    found["same"] = np.array([a.tobytes() == b.tobytes() for a, b in zip(written, learned, strict=True)])
    return found | {"stepped": sh, "first": first, "second": second}


def before(case: Case) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Adam's moments of the coefficients [L, N, K, 3], zero above the degree in use."""
    generator = np.random.default_rng(3)
    shape = (case.sets, case.n, (case.stored + 1) ** 2, 3)
    first = generator.normal(size=shape).astype(np.float32)
    second = generator.uniform(0.1, 1, shape).astype(np.float32)
    first[:, :, (case.degree + 1) ** 2 :] = second[:, :, (case.degree + 1) ** 2 :] = 0
    return first, second


@serial_kernel
def functions(x, rows, powers, logarithms):
    """exp(x), and log2 of it."""
    for start in range(0, x.shape[0], LANES64):
        for lane in range(LANES64):
            rows[lane] = start + lane
        power = exp64(gather(x, rows, 1, 0))
        store64(to_float32(power), powers, start)
        store64(to_float32(log2(power)), logarithms, start)


def main() -> None:
    """Write everything to a file."""
    found = {f"{index} {name}": value for index, case in enumerate(CASES) for name, value in run(case).items()}
    powers, logarithms = np.empty_like(EXPONENTS), np.empty_like(EXPONENTS)
    functions(EXPONENTS, np.empty(LANES64, np.int64), powers, logarithms)
    np.savez(sys.argv[1], powers=powers, logarithms=logarithms, **found)


if __name__ == "__main__":
    main()

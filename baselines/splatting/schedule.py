"""Schedules, functions of the iteration alone: view order, resolution, learning rates, spherical-harmonic degree.

Nothing here keeps state, so training that resumes at iteration i goes on exactly as it would have.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, unique

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.splats.sh_coefficients import coefficients
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera

COOLED = 0.1  # factor on all rates at the end of a cooldown; ours


@unique
class Stream(IntEnum):
    """What a training draws random numbers for: each purpose has a generator of its own, whoever else draws.

    All purposes stand here, those of methods too; a number is never used twice, nor changed, as the seed's bits go by.
    """

    VIEW_ORDER = 1
    SPLITTING = 2
    RELOCATION = 3
    NOISE = 4
    DROPOUT = 5  # of features: GS-W's of maps, WildGaussians' of a lesson
    ABSENCE = 6  # GS-W's steps without a reference
    INLIERS = 7  # which pixels of a view count, by their probabilities
    LAYERS = 8  # of Gaussians before each camera
    START = 9  # points between those of the capture


@dataclass(frozen=True)
class LearningRates:
    """Learning rates of Adam. Defaults are those of Kerbl et al. 2023."""

    means: float = 1.6e-4  # positions at the start, in scene extents
    means_final: float = 1.6e-6  # positions at the end, in scene extents; exponential in between
    sh: float = 2.5e-3  # coefficients of degree 0
    sh_rest: float = 2.5e-3 / 20  # coefficients of higher degrees
    opacity: float = 0.05
    scales: float = 5e-3
    quaternions: float = 1e-3
    final: float = 1.0  # factor at the end, for all rates but the means'
    cooldown: float = 0.0  # share of the iterations at the end in which all rates fall faster


def random_stream(seed: int, purpose: Stream, index: int) -> np.random.Generator:
    """The generator for one purpose at one point of the training."""
    return np.random.default_rng((seed, int(purpose), index))


def view_at(iteration: int, n_views: int, seed: int) -> int:
    """Which view a step learns from: every view once an epoch, in a new random order each time."""
    epoch, position = divmod(iteration, n_views)
    return int(random_stream(seed, Stream.VIEW_ORDER, epoch).permutation(n_views)[position])


def validation_views(n_views: int, n_validation: int) -> tuple[int, ...]:
    """Which of the training views validate, and are not learned from: spread evenly.

    Raises:
        InputError: none would be left to learn from.
    """
    if n_validation >= n_views:
        raise InputError(
            "early stop: no training view is left to learn from",
            found=f"{n_views} views, of which {n_validation} validate",
            fix="validate on fewer",
        )
    return tuple(int((k + 0.5) * n_views / n_validation) for k in range(n_validation))


def sh_degree_at(iteration: int, raise_every: int, highest: int) -> int:
    """Degree 0 first, one more every `raise_every` iterations."""
    return min(highest, iteration // raise_every)


def shrink_at(iteration: int, iterations: int, resolutions: Sequence[tuple[float, int]]) -> int:
    """By which factor images are smaller in a step: (0.25, 4), (0.25, 2) is a quarter of the size for a quarter of the
    iterations, then half of it for another quarter, then the whole."""
    end = 0.0
    for share, factor in resolutions:
        end += share
        if iteration < round(end * iterations):
            return factor
    return 1


def shrunk(camera: Camera, factor: int) -> Camera:
    """The same camera with an image `factor` times smaller, rounded half up to whole pixels."""
    if factor == 1:
        return camera
    return camera.resized(*(max(1, (side + factor // 2) // factor) for side in (camera.width, camera.height)))


def cooling_at(progress: float, rates: LearningRates) -> float:
    """Factor on all rates, at a share of the iterations: 1, then down to `COOLED` in the last `cooldown` of them.

    Rates may stay high for longer, as what single steps add to the parameters is gone in the end: a warm-up, stable,
    decay schedule (Hu et al. 2024, MiniCPM, section 4) without the warm-up. Here as good as a mean of the parameters.
    """
    if not rates.cooldown:
        return 1.0
    return float(COOLED ** max(0.0, 1 - (1 - progress) / rates.cooldown))


def rates_at(
    iteration: int, iterations: int, rates: LearningRates, extent: float, sh_degree: int
) -> dict[str, float | NDArray[np.float32]]:
    """Learning rates by parameter; for sh one for each coefficient [K, 3]."""
    progress = iteration / max(iterations, 1)
    cooling = cooling_at(progress, rates)
    decay = cooling * math.exp(progress * math.log(rates.final))
    sh = np.full((coefficients(sh_degree), 3), rates.sh_rest * decay, np.float32)
    sh[0] = rates.sh * decay
    means = math.exp((1 - progress) * math.log(rates.means) + progress * math.log(rates.means_final))
    return {
        "means": cooling * extent * means,
        "quaternions": rates.quaternions * decay,
        "log_scales": rates.scales * decay,
        "opacity_logits": rates.opacity * decay,
        "sh": sh,
    }

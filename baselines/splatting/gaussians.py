"""The parameters of a splatted scene."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.splats.sh_coefficients import degree_of, from_colour

FIELDS = ("means", "quaternions", "log_scales", "opacity_logits", "sh")
SHAPE = FIELDS[:4]  # all but the colours
FEATURES = "features"


@dataclass(frozen=True)
class Gaussians:
    """N Gaussians as they are optimised: unconstrained, float32, C-contiguous.

    The world position of a Gaussian is `origin + means`: float32 alone would shake a scene that lies far from zero.
    """

    means: NDArray[np.float32]  # [N, 3], relative to origin
    quaternions: NDArray[np.float32]  # [N, 4], w x y z, of any length
    log_scales: NDArray[np.float32]  # [N, 3], natural logarithm of the standard deviations
    opacity_logits: NDArray[np.float32]  # [N], opacity = sigmoid
    sh: NDArray[np.float32]  # [N, K, 3], K = 1, 4, 9 or 16; colour = 0.5 + sh . basis(direction), not below 0
    origin: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    features: NDArray[np.float32] | None = None  # [N, F], what an `Appearance` makes colours of; renderers want none

    def __post_init__(self) -> None:
        n = len(self.means)
        expected = {"means": (n, 3), "quaternions": (n, 4), "log_scales": (n, 3), "opacity_logits": (n,)}
        expected["sh"] = (n, *self.sh.shape[1:2], 3)
        if self.features is not None:
            expected[FEATURES] = (n, *self.features.shape[1:2])
        for name, shape in expected.items():
            value = getattr(self, name)
            if value.shape != shape or value.dtype != np.float32 or not value.flags.c_contiguous:
                raise ValueError(
                    f"Gaussians.{name}: {value.dtype} of shape {value.shape}, expected contiguous float32 {shape}"
                )
        degree_of(self.sh.shape[1])

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """The highest spherical-harmonic degree there are coefficients for."""
        return degree_of(self.sh.shape[1])

    def state_dict(self) -> dict[str, NDArray[np.float32]]:
        """The parameters by name, in the order of FIELDS, then the features where there are any."""
        arrays = {name: getattr(self, name) for name in FIELDS}
        return arrays if self.features is None else {**arrays, FEATURES: self.features}

    def bare(self) -> "Gaussians":
        """The same without features, as renderers want them."""
        return replace(self, features=None)

    def map(self, function: Callable[[NDArray], NDArray]) -> "Gaussians":
        """The same function applied to every parameter array."""
        changed = {name: np.ascontiguousarray(function(value)) for name, value in self.state_dict().items()}
        return replace(self, **changed)

    def select(self, which: NDArray) -> "Gaussians":
        """Those that a mask [N] or an index array picks, copied."""
        rows = np.flatnonzero(which) if which.dtype == bool else which
        return self.map(lambda value: np.take(value, rows, axis=0))

    def coloured(self, colours: NDArray[np.float32]) -> "Gaussians":
        """The same with given colours [N, 3] instead of spherical harmonics; below 0 they are shown as 0."""
        return replace(self.bare(), sh=np.ascontiguousarray(from_colour(colours)[:, None], np.float32))

    def zeros(self) -> "Gaussians":
        """As many, with every parameter zero: a place for gradients or moments."""
        return self.map(np.zeros_like)


def join(first: Gaussians, rows: NDArray[np.intp], second: Gaussians) -> Gaussians:
    """Those of the first at some rows [M], then all of the second; the origins must be the same.

    Raises:
        ValueError: different origins.
    """
    if not np.array_equal(first.origin, second.origin):
        raise ValueError(f"Gaussians with origins {first.origin} and {second.origin} cannot be joined")
    joined = {name: _join(value, rows, getattr(second, name)) for name, value in first.state_dict().items()}
    return Gaussians(**joined, origin=first.origin)


def _join(first: NDArray, rows: NDArray[np.intp], second: NDArray) -> NDArray:
    """In memory that is touched once: most of what a refinement takes is copying."""
    both = np.empty((len(rows) + len(second), *first.shape[1:]), first.dtype)
    np.take(first, rows, axis=0, out=both[: len(rows)], mode="clip")  # "raise" would copy through a buffer
    both[len(rows) :] = second
    return both

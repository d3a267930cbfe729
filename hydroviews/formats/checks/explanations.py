"""What may be wrong where cameras, points and pixels do not fit: each is tried, and the one that fits is named."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydroviews.formats.checks.samples import Positions
from hydroviews.formats.geometry import OPENGL_TO_OPENCV, inverse

Pose = NDArray[np.float64]  # world-to-camera [4, 4]

OTHER = "where the format has {}, or the other way round"


def _same(array: NDArray) -> NDArray:
    return array


@dataclass(frozen=True)
class Explanation:
    """A change that would make a capture fit itself."""

    says: str
    cloud: Callable[[Positions], Positions] = _same
    pose: Callable[[Pose], Pose] = _same
    picture: Callable[[NDArray], NDArray] = _same


AS_READ = Explanation("")


def explanations() -> Iterator[Explanation]:
    """All that are tried, the most frequent ones first."""
    yield Explanation("the poses are inverted: camera-to-world " + OTHER.format("world-to-camera"), pose=inverse)
    axes = "the cameras have other axes: OpenGL's (y up, z backward) " + OTHER.format("OpenCV's")
    yield Explanation(axes, pose=lambda pose: OPENGL_TO_OPENCV @ pose)
    for i, axis in enumerate("xyz"):
        yield Explanation(f"the {axis} axis of the points is flipped against the cameras", cloud=_flipped(i))
    for turn in (1, -1):
        yield Explanation("y and z of the points are exchanged against the cameras: z up for y up", cloud=_tipped(turn))
    for factor in (1000.0, 100.0, 0.01, 0.001):
        says = f"the points are in another unit than the cameras: {1 / factor:g} times as large"
        yield Explanation(says, cloud=_scaled(factor))
    for quarters, angle in ((1, "90"), (3, "90"), (2, "180")):
        says = f"the photographs are turned by {angle} degrees against their cameras"
        yield Explanation(says, picture=_turned(quarters))
    yield Explanation("the photographs are mirrored against their cameras", picture=lambda picture: picture[:, ::-1])


def _flipped(axis: int) -> Callable[[Positions], Positions]:
    factors = np.ones(3)
    factors[axis] = -1
    return lambda positions: positions * factors


def _scaled(factor: float) -> Callable[[Positions], Positions]:
    return lambda positions: positions * factor


def _turned(quarters: int) -> Callable[[NDArray], NDArray]:
    return lambda picture: np.rot90(picture, quarters)


def _tipped(turn: int) -> Callable[[Positions], Positions]:
    return lambda positions: positions[:, [0, 2, 1]] * (1, turn, -turn)

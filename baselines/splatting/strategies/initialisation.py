"""The Gaussians that training starts from."""

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.splats.sh_coefficients import coefficients, from_colour
from baselines.splatting.schedule import Stream, random_stream
from hydroviews.scene.cameras import Camera
from hydroviews.scene.checks import FARTHEST, usable
from hydroviews.scene.scenes import Points

logger = logging.getLogger(__name__)

INITIAL_OPACITY = 0.1
NEIGHBOURS = 3
FEWEST_POINTS = 100  # with fewer scene points, random ones are added
RANDOM_POINTS = 10_000
LARGE_CLOUD = 0.6  # of a budget that a cloud of more points is thinned to: the others are left to growth
CELLS = 1 << 16  # a side, in which points are ordered before a cloud is thinned
USUAL = (0.001, 0.999)  # quantiles of coordinates between which the cells lie
BETWEEN = 4  # nearest neighbours between which and a point new ones are put
MIDDLE = (0.25, 0.75)  # and where on the way
LARGEST = 0.05  # of the extent: no Gaussian starts larger, however lonely its point
STRAY = 2.0  # a camera this many times as far away as nine tenths of the others is taken for misplaced
ONE_PLACE = 0.01  # of the points' median distance: cameras that are no further apart stand in one place
FROM_ONE_PLACE = 0.25  # of that distance: the extent then; it is 0.1 for LLFF flower, 0.5 for Mip-NeRF 360 bonsai
FAR_ORIGIN = 100.0  # extents from zero beyond which float32 positions would cost accuracy


def scene_extent(cameras: Sequence[Camera], points: NDArray[np.floating]) -> tuple[NDArray[np.float64], float]:
    """Mean camera position [3] and 1.1 times the largest distance from it, the length unit of learning rates.

    Cameras that lie far from all others, misplaced by the pose estimation, are left out. Of one camera, or of several
    in one place as on a tripod, that distance says nothing of the scene: then it is a share of the distance of its
    points [N, 3], or for fewer than 100 of them that of the cameras, if there is any, or 1.
    """
    centres = np.stack([camera.centre for camera in cameras])
    distances = np.linalg.norm(centres - np.median(centres, axis=0), axis=1)
    kept = centres[distances <= STRAY * np.quantile(distances, 0.9)]
    middle = kept.mean(axis=0)
    radius = 1.1 * float(np.linalg.norm(kept - middle, axis=1).max())
    usual = points[(np.abs(points) <= FARTHEST).all(axis=1)]
    if len(usual) >= FEWEST_POINTS:
        away = float(np.median(np.linalg.norm(usual - middle, axis=1)))
        radius = radius if radius > ONE_PLACE * away else FROM_ONE_PLACE * away
    return middle, radius if radius > 0 else 1.0


def initialise(
    points: Points, cameras: Sequence[Camera], sh_degree: int, seed: int, fewest: int = 0, budget: int | None = None
) -> Gaussians:
    """One Gaussian a scene point: round, as large as the distance to its neighbours, its colour the point's.

    Points that are not finite or impossibly far away are left out. Where the capture has fewer than 100 others, 10,000
    grey ones are drawn in the cube around the cameras; the log says so, but of a capture without any. Where it has more
    than that but fewer than `fewest`, others are put between them: see `filled_up`. A cloud of more
    points than `budget`, if there is one, is thinned to LARGE_CLOUD of the budget, or to `fewest`: see `thinned`.
    """
    positions, colours = np.asarray(points.positions, np.float64), np.asarray(points.colours) / 255.0
    middle, extent = scene_extent(cameras, positions)
    origin = middle if float(np.linalg.norm(middle)) > FAR_ORIGIN * extent else np.zeros(3)
    kept = usable("training", positions)
    positions, colours = positions[kept], colours[kept]
    if len(positions) < FEWEST_POINTS:
        if len(points):
            told = "training: %d points are few: %d random ones are added; a capture without its cloud gets another one"
            logger.warning(told, len(positions), RANDOM_POINTS)
        generator = np.random.default_rng(seed)
        random = middle + extent * generator.uniform(-1, 1, (RANDOM_POINTS, 3))
        positions = np.concatenate([positions, random])
        colours = np.concatenate([colours, np.full((RANDOM_POINTS, 3), 0.5)])
    elif len(positions) < fewest:
        positions, colours = filled_up(positions, colours, fewest, random_stream(seed, Stream.START, 0))
    if budget is not None and len(positions) > budget:
        chosen = thinned(positions, max(fewest, round(LARGE_CLOUD * budget)))
        told = "training: %s points are more than the budget of %s Gaussians: the cloud is thinned evenly to %s"
        logger.warning(told, f"{len(positions):,}", f"{budget:,}", f"{len(chosen):,}")
        positions, colours = positions[chosen], colours[chosen]

    spread = np.clip(neighbour_distance(positions - origin), 1e-7 * extent, LARGEST * extent)
    n = len(positions)
    sh = np.zeros((n, coefficients(sh_degree), 3), np.float32)
    sh[:, 0] = from_colour(colours)
    quaternions = np.zeros((n, 4), np.float32)
    quaternions[:, 0] = 1
    return Gaussians(
        means=np.ascontiguousarray(positions - origin, np.float32),
        quaternions=quaternions,
        log_scales=np.repeat(np.log(spread)[:, None], 3, axis=1).astype(np.float32),
        opacity_logits=np.full(n, np.log(INITIAL_OPACITY / (1 - INITIAL_OPACITY)), np.float32),
        sh=sh,
        origin=origin,
    )


def thinned(positions: NDArray[np.float64], number: int) -> NDArray[np.intp]:
    """Which of the points [N, 3] stay where `number` of them may: the same share everywhere, sorted indices [number].

    The points are ordered along a curve that fills space (Morton 1966), so that neighbours on the curve are neighbours
    in space. Then the curve is cut into `number` equal parts, and the point in the middle of each part stays.
    """
    low, high = np.quantile(positions, USUAL, axis=0)
    cells = np.clip((positions - low) / np.maximum(high - low, np.finfo(float).tiny), 0, 1) * (CELLS - 1)
    order = np.argsort(_along_the_curve(cells.astype(np.uint64)), kind="stable")
    middles = (np.arange(number) + 0.5) * (len(positions) / number)
    return np.sort(order[middles.astype(int)])


def _along_the_curve(cells: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Places [N] of cells [N, 3] on the curve: the bits of the three numbers take turns."""
    places = np.zeros(len(cells), np.uint64)
    for bit in range(CELLS.bit_length() - 1):
        for axis in range(3):
            places |= ((cells[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return places


def filled_up(
    positions: NDArray[np.float64], colours: NDArray[np.float64], number: int, generator: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points [N, 3] and their colours [N, 3], followed by new ones up to a number.

    Each new one lies between a point and one of its nearest neighbours, in a colour between theirs: what structure from
    motion finds are mostly points of surfaces, which go on from one to the next. Every point is taken equally often.
    """
    from scipy.spatial import cKDTree

    n, more = len(positions), number - len(positions)
    rounds = -(-more // n)
    rows = np.concatenate([generator.permutation(n) for _ in range(rounds)])[:more]
    neighbours = cKDTree(positions).query(positions, BETWEEN + 1)[1]
    others = neighbours[rows, generator.integers(1, BETWEEN + 1, more)]
    way = generator.uniform(*MIDDLE, (more, 1))

    def with_new(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([values, (1 - way) * values[rows] + way * values[others]])

    return with_new(positions), with_new(colours)


def neighbour_distance(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root mean square distance [N] to the three nearest others."""
    from scipy.spatial import cKDTree

    k = min(NEIGHBOURS, len(positions) - 1)
    if k < 1:
        return np.ones(len(positions))
    distances = cKDTree(positions).query(positions, k + 1)[0][:, 1:]
    return np.sqrt((distances**2).mean(axis=1))

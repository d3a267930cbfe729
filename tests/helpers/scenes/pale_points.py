"""Points of known colours behind mist on the lens, in fog, and behind both."""

import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import to_srgb
from hydroviews.scene.point_colours import PointColours

POINTS, VIEWS = 400, 24
AIR = np.array([0.7, 0.75, 0.8], np.float32)
TYPICAL_DEPTH = 1.75  # the median


def alpha_at(places: NDArray) -> NDArray[np.float32]:
    """Thick above, none below: [...] of places [..., 2], across and down."""
    return np.asarray(0.4 * (1 - places[..., 1]), np.float32)


def pale_points(
    mist: float = 1.0,
    fog: float = 0.0,
    upright: float = 0.0,
    drops: float = 0.0,
    views: int = VIEWS,
    points: int = POINTS,
    noise: float = 0.01,
    air: NDArray[np.float32] = AIR,
    seed: int = 0,
) -> PointColours:
    """Points seen through so much of `alpha_at`, in fog that takes a part of the light over the mean depth.

    Args:
        mist: factor on `alpha_at`.
        fog: of the light that it takes over a depth of 1, 1 halves it.
        upright: how surely what is far is seen high in the photograph.
        drops: share of the colours that show something else.
        views: photographs, each of which shows half of the points.
        points: how many.
        noise: standard deviation of encoded colours.
        air: linear light [3] of mist and fog.
        seed: of all that is random.
    """
    rng = np.random.default_rng(seed)
    places = rng.random((points, views, 2))
    depths = 1 + 1.5 * (upright * (1 - places[..., 1]) + (1 - upright) * rng.random((points, views)))
    own = 0.5 * rng.random((points, 1, 3))
    passing = np.exp(-fog * np.log(2) * depths)[..., None]
    alpha = mist * alpha_at(places)[..., None]
    colours = (1 - alpha) * (passing * own + (1 - passing) * air) + alpha * air
    other = rng.random((points, views)) < drops
    colours[other] = rng.random((other.sum(), 3))
    colours = np.clip(to_srgb(colours.astype(np.float32)) + noise * rng.normal(size=colours.shape), 0, 1)
    return PointColours(
        rng.normal(size=(points, 3)),
        np.arange(views),
        rng.normal(size=(views, 3)),
        colours.astype(np.float32),
        places.astype(np.float32),
        depths.astype(np.float32),
        rng.random((points, views)) < 0.5,
    )

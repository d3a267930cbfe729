"""How much mist, and at most how many drops, a grade needs on a scene.

Water on the lens is at the same place in every view. A veil of mist is learned as part of the scene. Sharp drops cover
other places of the scene in other views: of the error they make, one c-th is left where c views see a place. That is
what drops leave that are new in every view; those that stay leave more on some scenes, `drops_cost` times as much.
Where the lens is focused on the drops, the blur of the scene is learned as part of it.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.optics.path_matte import defocus
from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.rain.scene_statistics import SceneStatistics, fine_detail
from hydroviews.rain.severity import CLEAN_ERROR, MOST_BY_DROPS, solve, wanted_harm
from hydroviews.scene.images import to_linear, to_srgb

LOSS = {"light": 1.5, "medium": 3.7, "heavy": 8.5}  # dB for plain 3DGS; medium drops cost 4 to 5 where 4 were predicted
IN_FOCUS = {**LOSS, "light": 1.0}  # the same of drops in focus; light ones cost 1.8 to 2.6 where 1.5 were predicted
THICKEST_MIST = 0.95
MOST_BLUR = 0.5  # share of the wanted harm that blur of the scene may do; for more the aperture closes
BLURRED_VIEWS = 6  # at full size, from which that is predicted


def grade_raindrops(drawn: RaindropPattern, grade: str, statistics: SceneStatistics) -> RaindropPattern:
    """The pattern with its mist, and if need be its coverage, set to the grade on this scene."""
    wanted = left = wanted_harm((IN_FOCUS if drawn.focus == "drops" else LOSS)[grade], statistics)
    aperture = drawn.focus_blur
    if drawn.focus == "drops":
        blurred = blur_harm(statistics)
        aperture = round(solve(blurred, MOST_BLUR * wanted, 0.0, drawn.focus_blur), 5)
        left -= blurred(aperture)
    full_cover = drops_harm(1.0, statistics, drawn.renewed)
    coverage = min(drawn.coverage, MOST_BY_DROPS * left / full_cover if full_cover else 1.0)
    left -= full_cover * coverage
    mist = solve(veil_harm(drawn, statistics), left, 0.0, THICKEST_MIST)
    graded = replace(drawn, coverage=round(coverage, 4), mist=round(mist, 4), focus_blur=aperture)
    if drawn.focus == "scene":
        return graded
    # In focus, droplets and rivulets do harm as drops do: where these are fewer, so are they.
    share = coverage / drawn.coverage if drawn.coverage else 1.0
    return replace(graded, droplets=round(share * drawn.droplets), rivulets=round(share * drawn.rivulets))


def veil_harm(pattern: RaindropPattern, statistics: SceneStatistics) -> Callable[[float], float]:
    """For a level of mist, the mean squared difference that it makes to the scene, in encoded values."""
    air = (np.array(pattern.air) * statistics.light.air).astype(np.float32)
    forms: dict[tuple[int, int], NDArray[np.float32]] = {}
    scenes = []
    for sample in statistics.samples:
        height, width = sample.shape[:2]
        if (height, width) not in forms:
            forms[height, width] = mist_veil(replace(pattern, mist=1.0), width, height, moment=0.5)
        scenes.append((sample, to_linear(sample), forms[height, width][..., None]))

    def harm(level: float) -> float:
        veiled = [to_srgb(linear * (1 - level * form) + level * form * air) for _, linear, form in scenes]
        return float(np.mean([np.mean((v - sample) ** 2) for v, (sample, _, _) in zip(veiled, scenes, strict=True)]))

    return harm


def drops_harm(coverage: float, statistics: SceneStatistics, renewed: float = 0.0) -> float:
    """Mean squared error that sharp drops leave in what is learned, in encoded values.

    They show another place than the one they cover, and so err by twice the variance of the views; what is learned
    from c views errs by one c-th of that. Those that stay on the lens, all but the share `renewed`, leave more in some
    scenes, where it was measured.
    """
    cost = renewed + (1 - renewed) * statistics.drops_cost
    return (
        cost
        * coverage
        * statistics.mean_inverse_visibility
        * 2
        * float(np.mean([sample.var(axis=(0, 1)).mean(dtype=np.float64) for sample in statistics.samples]))
    )


def blur_harm(statistics: SceneStatistics) -> Callable[[float], float]:
    """For an aperture, as the diameter in sides of its disk, what blur adds to the mean squared error of the scene.

    That is the difference of blurred and clean views, in encoded values, less the fine detail that is not learned from
    clean views either.
    """
    views = statistics.views[:: -(-len(statistics.views) // BLURRED_VIEWS)]
    pictures = [view.image() for view in views]
    lost = min(statistics.clean_error or CLEAN_ERROR, 1.0)

    def harm(aperture: float) -> float:
        if aperture == 0:
            return 0.0
        changes = []
        for clean in pictures:
            seen = to_srgb(defocus(to_linear(clean), aperture * float(np.sqrt(clean.shape[0] * clean.shape[1]))))
            error = np.mean((seen - clean) ** 2, dtype=np.float64)
            changes.append(error + lost * (fine_detail(seen) - fine_detail(clean)))
        return max(float(np.mean(changes)), 0.0)

    return harm

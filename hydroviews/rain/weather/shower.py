"""A shower: a dark sky, haze, rain in space, mist and drops on the lens and a noisy sensor, in that order.

Every part falls on what those before it left: drops show the dark, hazy, rainy scene behind them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import Any, ClassVar

import numpy as np

from hydroviews.rain.lens.effect import RaindropEffect
from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.rain.lens.patterns.pattern import RaindropPattern, fitted_to
from hydroviews.rain.lens.patterns.pattern import draw_pattern as draw_lens
from hydroviews.rain.lens.severity import THICKEST_MIST, drops_harm
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import SceneStatistics, measure_light
from hydroviews.rain.severity import solve, wanted_harm
from hydroviews.rain.storm.drop_sizes import DEEPEST, LARGEST, moment
from hydroviews.rain.storm.effect import StormEffect
from hydroviews.rain.storm.storm import StormPattern, storm_light
from hydroviews.rain.storm.storm import draw_pattern as draw_storm
from hydroviews.rain.storm.world import metres_and_focus
from hydroviews.rain.weather import haze, noise
from hydroviews.rain.weather.chain import Chain, seen_through
from hydroviews.rain.weather.dark import Ambient, draw_ambient, grade_ambient
from hydroviews.rain.weather.severity import LOSS, SHARES, harm, solve_ratio
from hydroviews.scene.images import Image, to_linear, to_srgb

THINNEST = 0.02  # density of a storm, in drops that Marshall and Palmer counted


class Shower(Chain):
    """`shower`: `ambient` has no layer, those of the others are their effects' own."""

    parts: ClassVar = {
        "ambient": Ambient(),
        "haze": haze.Haze(),
        "storm": StormEffect(),
        "lens": RaindropEffect(),
        "noise": noise.SensorNoise(),
    }
    falling = "storm.M"

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> dict[str, Any]:
        """All chance from the seed; each part but the noise as strong as makes its share of the grade's harm."""
        wanted, clean = wanted_harm(LOSS["shower"][pattern.grade], statistics), statistics.samples
        upto = {part: wanted * share for part, share in zip(SHARES, accumulate(SHARES.values()), strict=True)}

        def rng(part: str) -> np.random.Generator:
            return pattern_generator(pattern, statistics, part)

        ambient = grade_ambient(draw_ambient(rng("ambient"), statistics.light), upto["ambient"], statistics, clean)
        dark = self._seen_through("ambient", ambient, pattern, statistics)
        air = haze.grade_haze(haze.draw_pattern(rng("haze")), upto["haze"], dark, clean)
        hazy = self._seen_through("haze", air, pattern, dark)
        storm, rainy = grade_storm(draw_storm(rng("storm"), pattern.level), upto["storm"], hazy, clean)
        lens = grade_lens(draw_lens(rng("lens"), pattern.level), upto["mist"], rainy, clean)
        sensor = noise.draw_pattern(rng("noise"), pattern.level)
        return {"ambient": ambient, "haze": air, "storm": storm, "lens": lens, "noise": sensor}

    def _seen_through(self, part: str, drawn: Any, pattern: Pattern, seen: SceneStatistics) -> SceneStatistics:
        return seen_through(self.parts[part], self.parts[part].place(drawn, pattern, seen), seen)


def grade_storm(
    drawn: StormPattern, wanted: float, seen: SceneStatistics, clean: Sequence[Image]
) -> tuple[StormPattern, SceneStatistics]:
    """The storm with its density set so that `clean` samples seen through it suffer the wanted harm, and what is seen.

    Streaks are new in every view: what is learned is the mean cover by all drops, 1 - exp(-optical depth).
    """
    metres, _ = metres_and_focus(seen.views, seen.points, seen.metres_per_unit)
    thickness = moment(2, drawn.rate, 0.0, LARGEST) * np.pi / 4 * 1e-6  # of density 1, a metre
    scenes = []
    for view, sample in zip(seen.sampled_views, seen.samples, strict=True):
        far = np.minimum(haze.distance(view, seen.points, metres, sample), DEEPEST)
        scenes.append((to_linear(sample), storm_light(sample, seen.light), (thickness * far)[..., None]))

    def through(density: float) -> Iterator[Image]:
        for scene, light, thick in scenes:
            yield to_srgb(scene + (1 - np.exp(-density * thick)) * (light - scene))

    density = solve_ratio(lambda value: harm(through(value), clean), wanted, THINNEST, drawn.density)
    samples = tuple(through(density))
    return replace(drawn, density=density), replace(seen, samples=samples, light=measure_light(samples))


def grade_lens(drawn: RaindropPattern, wanted: float, seen: SceneStatistics, clean: Sequence[Image]) -> RaindropPattern:
    """The lens before a scene in rain: drops for their share of the harm, and mist until all together do the wanted."""
    full_cover = drops_harm(1.0, seen)
    coverage = min(drawn.coverage, SHARES["drops"] * wanted / full_cover if full_cover else 1.0)
    air = (np.array(drawn.air) * seen.light.air).astype(np.float32)
    form = replace(drawn, mist=1.0)
    veils = [mist_veil(form, sample.shape[1], sample.shape[0], moment=0.5)[..., None] for sample in seen.samples]
    scenes = [to_linear(sample) for sample in seen.samples]

    def misty_harm(mist: float) -> float:
        pairs = zip(scenes, veils, strict=True)
        return harm((to_srgb(scene + mist * veil * (air - scene)) for scene, veil in pairs), clean)

    mist = solve(misty_harm, wanted - drops_harm(coverage, seen), 0.0, THICKEST_MIST)
    return fitted_to(replace(drawn, coverage=round(coverage, 4), mist=round(mist, 4)), seen)

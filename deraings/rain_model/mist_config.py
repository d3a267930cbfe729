"""Settings of mist on the lens: what it can be, when it is believed, how it is learned."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MistConfig:
    """How mist is looked for and learned.

    Numbers without a source were chosen on courtyard and LLFF flower (docs/experiments/2026-11-rain-model.md).

    Attributes:
        cells: grid cells along the longer side, at least 1.
        views_per_knot: views, at least 1, that mist at one time is learned from; fewer views have fewer knots.
        max_time_knots: times at which mist may differ, at least 1.
        start: share of the iterations, [0, 1), before mist is learned: flower in heavy mist has 20.9 dB
            from 0.2 on, 22.4 from 0.03 on.
        likely: mist_alpha at the start as a share, [0, 1], of the most that the photographs allow.
        slack: factor, at least 1, by which mist_alpha may exceed the most that the photographs allow: that most is a
            quantile.
        brightest: share of all pixels, (0, 1], the brightest, that mist is expected to be as light as: it is lit from
            all around. From 0.05 to 0.3 it makes no difference.
        rate: of Adam for sqrt(mist_alpha), positive.
        colour_rate: of Adam for the mist's light, positive; linear light a step.
        final_rate: factor, (0, 1], to which both rates have fallen at the end; that of the Gaussians' rates.
        mean_penalty: factor in the loss of the mean mist_alpha, from 0: even mist cannot be told from a pale scene.
        roughness_penalty: factor of the mean squared difference of neighbouring knots, in sqrt(mist_alpha), from 0.
        brightness_penalty: factor of the squared distance of the mist's light to what is expected of it, from 0, in the
            mean of the channels: lighter mist is as good as more of it.
        tint_penalty: the same of how far each channel is from that mean: dark things show the tint. With 0.1 flower's
            heavy drops have 26.0 dB, with 0.001 to 0.01 26.4 to 26.6.
        max_alpha: most that mist_alpha may be, [0, 1).
        dark_quantile: share of what a place of the lens shows, (0, 1), that may be darker than the mist there: noise.
        min_possible: upper quartile over the lens of the mist_alpha that photographs allow, [0, 1], from which scene
            points are asked for mist: mist on a window leaves whole regions free. Below, a network alone can tell.
            Where neither tells, mist is looked for if the lower quartile is as large.
        min_seen: mist_alpha, [0, 1], median over the lens, from which the enhancement network is believed: of
            development scenes streaks have 0.0024 at most (heavy ones of courtyard 0.0066), the lightest mist 0.0041.
        min_seen_in_rain: the same, above `min_seen`, from which mist stands behind falling rain: streaks of development
            scenes have 0.0066 at most, medium drops 0.012 and more.
        min_mist: share of the possible mist, [0, 1], from which scene points show mist: clean views, streaks and drops
            without mist have 0.41 at most, mist on a window 0.57 and more.
        min_fog: share of their contrast, [0, 1], that points lose over the median depth, from which it is fog: clean
            views have 0.06 at most, fog that takes half of the light 0.3 and more.
    """

    cells: int = 24
    views_per_knot: int = 12
    max_time_knots: int = 3
    start: float = 0.03
    likely: float = 0.7
    slack: float = 1.3
    brightest: float = 0.05
    rate: float = 1e-2
    colour_rate: float = 1e-3
    final_rate: float = 0.1
    mean_penalty: float = 1e-3
    roughness_penalty: float = 0.01
    brightness_penalty: float = 0.1
    tint_penalty: float = 0.003
    max_alpha: float = 0.95
    dark_quantile: float = 0.05
    min_possible: float = 0.007
    min_seen: float = 0.003
    min_seen_in_rain: float = 0.009
    min_mist: float = 0.5
    min_fog: float = 0.15

"""Mist on the lens by its spectrum: a sum of waves of random direction, length and phase."""

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.other_make.drops import LensPattern
from hydroviews.scene.seeds import generator

WAVES = 64
STEEPNESS = 1.0  # amplitudes fall as the wavelength to this power: power over wave number as k^-2
MEAN = 0.65  # of the form, before it is clipped
DRIFT = 0.1  # sides that it moves from the first view to the last


def mist_cover(pattern: LensPattern, width: int, height: int, moment: float) -> NDArray[np.float32]:
    """Cover by mist [H, W], at most `pattern.mist`; at every size of picture the same form.

    A wave exp(i (a x + b y)) is one along rows times one along columns: all of them take one matrix product.
    """
    if pattern.mist <= 0:
        return np.zeros((height, width), np.float32)
    rng = generator(pattern.seed, "mist")
    waves = pattern.mist_coarsest * (pattern.mist_finest / pattern.mist_coarsest) ** rng.uniform(size=WAVES)
    direction, phase, heading = rng.uniform(0, 2 * np.pi, WAVES), rng.uniform(0, 2 * np.pi, WAVES), rng.uniform(0, 6.28)
    amplitude = waves**-STEEPNESS
    amplitude *= np.sqrt(2 / np.square(amplitude).sum())  # unit variance
    side = np.sqrt(width * height)
    x = (np.arange(width) + 0.5 - width / 2) / side + DRIFT * moment * np.cos(heading)
    y = (np.arange(height) + 0.5 - height / 2) / side + DRIFT * moment * np.sin(heading)
    along = np.exp(2j * np.pi * np.outer(y, waves * np.sin(direction)) + 1j * phase).astype(np.complex64)
    across = np.exp(2j * np.pi * np.outer(waves * np.cos(direction), x)).astype(np.complex64)
    form = ((along * amplitude.astype(np.float32)) @ across).real
    return np.asarray(pattern.mist * np.clip(MEAN + pattern.mist_contrast * form, 0, 1), np.float32)

"""Haze, darkness and noise as their formulas have them, in float64: slow, to compare with."""

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.weather.dark import AmbientPattern
from hydroviews.rain.weather.noise import NoisePattern

Picture = NDArray[np.float64]  # [H, W, 3]


def decoded(encoded: NDArray) -> Picture:
    """SRGB-encoded [0, 1] to linear light (IEC 61966-2-1)."""
    x = np.asarray(encoded, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def encoded(linear: NDArray) -> Picture:
    """Linear light to sRGB-encoded [0, 1]."""
    x = np.clip(np.asarray(linear, np.float64), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def hazy(clean: NDArray, cover: NDArray, airlight: NDArray) -> Picture:
    """B (1 - H) + A H for a view B [H, W, 3], a cover H [H, W] and an airlight A [3]."""
    hidden = np.asarray(cover, np.float64)[..., None]
    return encoded(decoded(clean) * (1 - hidden) + np.asarray(airlight, np.float64) * hidden)


def dark(clean: NDArray, chance: NDArray, ambient: AmbientPattern, noise: NoisePattern) -> Picture:
    """g p (B / p)^c for a view B [H, W, 3], and noise of `chance` [H, W, 3] standard deviations."""
    contrast = 1 / (1 + ambient.flatness * ambient.stops)
    gain = (np.array(ambient.tint, np.float64) / 2) ** ambient.stops
    light = gain * ambient.pivot * (decoded(clean) / ambient.pivot) ** contrast
    return encoded(light + chance * np.sqrt(noise.shot * light + noise.read**2))

"""Water film: vertical bands packed with tiny beads and short wavy ridges, the glass between them clean."""

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.patterns.beads import Beads, joined, log_normal, no_beads, scattered
from hydroviews.rain.lens.patterns.window import WindowPattern
from hydroviews.scene.seeds import generator

Array = NDArray[np.float64]
COLUMNS, ROWS = 240, 160  # cells of the field of bands
HALF_WIDTHS = (0.02, 0.075)  # of a band, in widths of the picture
WANDER = 0.012  # how far a band swings, in widths
RIDGES = (2.6, 0.22)  # aspect and wave of ridges
TINY = (1.1, 0.12)  # of the beads between them
RIDGE_RADIUS, BEAD_RADIUS = 0.0042, 0.0022  # medians, in sides
RIDGES_A_BAND, BEADS_A_BAND = 110, 260


def draw_film(pattern: WindowPattern, extent: tuple[float, float]) -> Beads:
    """The water of the pattern's bands; more bands are further ones."""
    if pattern.film == 0:
        return no_beads()
    bands = _bands(pattern)
    rng = generator(pattern.seed, "film")
    ridges = log_normal(rng, RIDGES_A_BAND * pattern.film, RIDGE_RADIUS, 0.35)
    film = scattered(rng, ridges, bands, extent, RIDGES, pattern, no_beads())
    tiny = log_normal(rng, BEADS_A_BAND * pattern.film, BEAD_RADIUS, 0.4)
    return joined(film, scattered(rng, tiny, bands, extent, TINY, pattern, film))


def _bands(pattern: WindowPattern) -> Array:
    """How much film there is, [ROWS, COLUMNS] in [0, 1]: streaky bands with soft ends."""
    x, y = (np.arange(COLUMNS) + 0.5) / COLUMNS, (np.arange(ROWS)[:, None] + 0.5) / ROWS
    cover = np.zeros((ROWS, COLUMNS))
    for number in range(pattern.film):
        rng = generator(pattern.seed, "band", number)
        middle, half = rng.uniform(0.02, 0.98), rng.uniform(*HALF_WIDTHS)
        begin, end = rng.uniform(-0.4, 0.5), rng.uniform(0.6, 1.4)
        swing = WANDER * np.sin(2 * np.pi * (rng.uniform(0.5, 1.5) * y + rng.uniform()))
        across = np.clip(1.5 - 1.5 * np.abs(x - middle - swing) / half, 0, 1)
        along = np.clip((y - begin) / 0.12, 0, 1) * np.clip((end - y) / 0.12, 0, 1)
        streaks = 0.45 + 0.55 * np.interp(np.arange(COLUMNS), np.arange(0, COLUMNS, 3), rng.uniform(size=COLUMNS // 3))
        cover = np.maximum(cover, across * along * streaks)
    return cover

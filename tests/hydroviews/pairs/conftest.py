from dataclasses import replace

import numpy as np
import pytest
from wet import lens

from hydroviews.pairs.lens_pool import WetLens
from hydroviews.rain.lens.patterns.window import draw_window


@pytest.fixture(scope="session")
def window() -> WetLens:
    """A pane with one square drop, whose lower half is bright."""
    matte = lens().matte
    sky = np.zeros_like(matte.mask)
    sky[30:40, 30:50] = 1
    return WetLens(draw_window(np.random.default_rng(0), 1), 0, replace(matte, sky=sky))


@pytest.fixture(scope="session")
def lenses(window) -> list[WetLens]:
    """A wet lens and a window."""
    return [lens(), window]

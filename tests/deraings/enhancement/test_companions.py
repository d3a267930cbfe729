"""Statistics of the lens count while the same drops are on it, and not where each photograph has new ones."""

import numpy as np
import pytest
from skimage import data

from deraings.enhancement.companions import lenses_of_companions
from deraings.enhancement.enhance import enhance, shipped
from hydroviews.metrics import psnr
from hydroviews.pairs.recipes.panes import draw_pane
from hydroviews.scene.images import to_uint8

HEIGHT, WIDTH, COUNT = 128, 160, 8


@pytest.fixture(scope="module")
def dry():
    """Views of a camera that moves along a picture."""
    picture = data.astronaut().astype(np.float32) / 255
    return [picture[8 * i : 8 * i + HEIGHT, 40 * i : 40 * i + WIDTH] for i in range(COUNT)]


def panes(seed):
    """Panes with drops and without mist, each with its own."""
    rng = np.random.default_rng(seed)
    while True:
        yield draw_pane(rng, WIDTH, HEIGHT, True, False)


def covered_pane(least=0.1, most=0.3):
    return (pane for pane in panes(3) if least < pane.cover.mean() < most)


def lenses(pictures, hidden=lambda _: None):
    pixels = [to_uint8(picture) for picture in pictures]
    return lenses_of_companions(COUNT, pixels.__getitem__, shipped(), hidden)


def test_photographs_with_the_same_drops_are_companions(dry):
    pane = next(covered_pane())
    assert all(lens.fine is not None for lens in lenses([pane.over(picture) for picture in dry]))


def test_dry_photographs_are_companions(dry):
    assert all(lens.fine is not None for lens in lenses(dry))


def test_new_drops_are_removed_from_each_photograph_alone(dry):
    wet = [pane.over(picture) for pane, picture in zip(covered_pane(), dry, strict=False)]
    found = lenses(wet)
    assert all(lens.fine is None for lens in found)
    gains = [
        psnr(enhance(rainy, lens=lens), clean) - psnr(rainy, clean)
        for rainy, lens, clean in zip(wet, found, dry, strict=True)
    ]
    assert np.mean(gains) > 0.5


def test_holes_of_masks_are_no_drops(dry):
    """Photographs show a dry lens if masks hide all that is new."""
    wet = [pane.over(picture) for pane, picture in zip(covered_pane(), dry, strict=False)]
    assert all(lens.fine is not None for lens in lenses(wet, lambda _: np.ones((HEIGHT, WIDTH), bool)))

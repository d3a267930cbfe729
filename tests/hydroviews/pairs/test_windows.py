import numpy as np
import pytest
from wet import lens, photograph

from hydroviews.pairs.windows import draw_window_pane
from hydroviews.scene.seeds import generator

AIR = np.full(3, 0.6, np.float32)
PICTURE = photograph().astype(np.float32) / 255


def test_drops_of_a_window_have_light_of_their_own(window):
    """Over black and over white the drop looks nearly alike, dark above and bright below."""
    black, white = np.zeros_like(PICTURE), np.ones_like(PICTURE)
    for seed in range(12):
        pane, _ = draw_window_pane(window, AIR, generator(seed), has_mist=False)
        seen = [pane.over(scene) for scene in (black, white)]
        assert seen[0][33:38, 35:45].mean() > seen[0][22:27, 35:45].mean() + 0.1
        difference = (seen[1] - seen[0])[23:27, 33:47].mean()  # scene's share is 0.15 at most, in linear light
        assert difference < 0.45
        assert (seen[1] - seen[0])[:10, :10].mean() > 0.9


def test_parts_of_a_window_come_alone(window):
    misty, small = draw_window_pane(window, AIR, generator(0), has_drops=False)
    assert not misty.mask.any()
    assert not small.mask.any()
    assert not misty.lit.any()
    assert misty.veil.max() > 0
    wet, _ = draw_window_pane(window, AIR, generator(0), has_mist=False)
    assert wet.mask.any()
    assert not wet.veil.any()
    with pytest.raises(ValueError, match="window"):
        draw_window_pane(lens(), AIR, generator(0))

"""Measured statistics of a pane, on pictures whose mist and spots are known."""

import cv2
import numpy as np
import pytest

from benchmarks.rain.window_look import measure, pictured, spot_radii


def scene() -> np.ndarray:
    noise = np.random.default_rng(0).uniform(0.2, 0.6, (40, 60)).astype(np.float32)
    grey = cv2.resize(noise, (300, 200), interpolation=cv2.INTER_CUBIC)
    return np.repeat(grey[..., None], 3, axis=-1)


def test_even_mist_has_its_slope_and_its_light_everywhere():
    look = measure(0.6 * scene() + 0.4 * 0.8, scene())
    assert [look[f"slope {share} %"] for share in (10, 50, 90)] == pytest.approx([0.6] * 3, abs=1e-3)
    assert look["veil"] == pytest.approx(0.8, abs=1e-3)
    assert look["changed"] == 0
    assert look["spots"] == 0


def test_spots_are_counted_and_have_their_radii():
    off = np.zeros((200, 300), np.float32)
    for i in range(5):
        cv2.circle(off, (30 + 50 * i, 50), 6, (0.5,), cv2.FILLED)
        cv2.circle(off, (30 + 50 * i, 120), 6, (-0.5,), cv2.FILLED)
    radii = spot_radii(off)
    assert len(radii) == 10
    assert np.allclose(radii, 6 / 300, rtol=0.05)


def test_pictures_are_scaled_and_cut():
    assert pictured(scene(), (150, 90)).shape == (90, 150, 3)
    assert pictured(scene(), (600, 500)).shape == (500, 600, 3)

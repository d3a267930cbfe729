"""Parts of a window that make up the whole, and statistics of panes whose mist and spots are known."""

import cv2
import numpy as np
import pandas as pd
import pytest

from benchmarks.rain.window_look import measure, pictured, spot_radii
from benchmarks.rain.windows import with_shares, without_drops, without_mist
from hydroviews.rain.compositing import water_over
from hydroviews.scene.seeds import generator

AIR = np.array([0.5, 0.6, 0.7], np.float32)


def test_drops_and_mist_of_a_window_make_up_the_whole():
    rng = generator(0, "window parts")
    mask, veil, *drops = rng.random((5, 6, 8)).astype(np.float32)
    light = {c: mask * drops[i] + (1 - mask) * veil * AIR[i] for i, c in enumerate("RGB")}
    layers, clean = {"M": mask, "V": veil, **light}, rng.random((6, 8, 3)).astype(np.float32)
    behind_mist = water_over(clean, without_drops(layers, AIR))
    assert np.allclose(behind_mist, (1 - veil)[..., None] * clean + veil[..., None] * AIR, atol=1e-6)
    assert np.allclose(water_over(behind_mist, without_mist(layers, AIR)), water_over(clean, layers), atol=1e-6)


def test_shares_are_of_the_gap_that_plain_splatting_leaves():
    rows = pd.DataFrame(
        [("clean", "3dgs", 30.0), ("drops", "3dgs", 20.0), ("drops, true cover hidden", "ours", 28.0)],
        columns=["photographs", "method", "PSNR"],
    )
    assert with_shares(rows)["share of the gap"].tolist()[1:] == pytest.approx([0.0, 0.8])
    assert with_shares(rows[rows["method"] == "ours"])["share of the gap"].isna().all()


def scene() -> np.ndarray:
    noise = np.random.default_rng(0).uniform(0.2, 0.6, (40, 60)).astype(np.float32)
    grey = cv2.resize(noise, (300, 200), interpolation=cv2.INTER_CUBIC)
    return np.repeat(grey[..., None], 3, axis=-1)


def test_even_mist_has_its_slope_and_its_light_everywhere():
    look = measure(0.6 * scene() + 0.4 * 0.8, scene())
    assert [look[f"slope {share} %"] for share in (10, 50, 90)] == pytest.approx([0.6] * 3, abs=1e-3)
    assert look["veil"] == pytest.approx(0.8, abs=1e-3)
    assert look["changed"] == look["spots"] == 0


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

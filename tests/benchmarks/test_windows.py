import numpy as np
import pandas as pd
import pytest

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

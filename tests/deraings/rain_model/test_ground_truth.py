"""What was found of the rain, scored against layers that are drawn here: the model never sees them."""

from pathlib import Path

import numpy as np
import panorama
import pytest

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.training.images import TrainingImages
from deraings.rain_model.drops import LensDropsConfig
from deraings.rain_model.ground_truth import mask_scores, plane_errors, score_rain
from deraings.rain_model.mist_config import MistConfig
from deraings.rain_model.model import RainConfig, RainModel
from deraings.rain_model.objective import RainObjective
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.rain.layers import write_layers
from hydroviews.rain.registry import find_effect
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import View

SIZE = panorama.HEIGHT, panorama.WIDTH
COUNT, STEPS = 14, 280
MIST = panorama.slanted_mist(0.4)
AIR = np.array([0.55, 0.6, 0.65], np.float32)
DROP = (slice(18, 30), slice(5, 17))  # of the lens, in pixels, where there is hardly any mist
WET = RainConfig(mist=MistConfig(start=0), drops=LensDropsConfig(min_share=0.01), rain_layer=None)


def views(folder: Path, count: int) -> list[View]:
    camera = Camera(SIZE[1], SIZE[0], 50.0, 50.0, SIZE[1] / 2, SIZE[0] / 2, np.eye(4))
    return [View(f"v{i}", camera, folder / f"v{i}.png") for i in range(count)]


def drop_alpha() -> np.ndarray:
    alpha = np.zeros(SIZE, np.float32)
    alpha[DROP] = 1
    return alpha


@pytest.fixture(scope="module")
def trained() -> RainModel:
    """A model that has seen photographs of a known scene through mist and one drop."""
    scene = panorama.views_of(panorama.paint(), COUNT)
    photographs = panorama.misted(scene, MIST, AIR)
    photographs[(slice(None), *DROP)] = panorama.shaded_drop(12, 12)
    objective, buffers = RainObjective(TrainingImages(panorama.eight_bit(photographs)), STEPS, WET), BufferPool()
    error = 0.02 * np.random.default_rng(3).standard_normal(scene.shape).astype(np.float32)
    for step in range(STEPS):
        objective(scene[step % COUNT] + error[step % COUNT], step % COUNT, step, buffers)
    return objective.model


def scores_against(model: RainModel, folder: Path, effect: str, layers: dict[str, np.ndarray]) -> dict[str, float]:
    write_json(folder / "pattern.json", {"effect": effect})
    for view in views(folder, COUNT):
        write_layers(folder / "layers" / f"{view.name}.exr", layers)
    return score_rain(model, folder, views(folder, COUNT))


def test_errors_of_a_plane():
    true = panorama.slanted_mist(0.4)
    assert plane_errors(true + 0.1, true) == pytest.approx({"rms": 0.1, "mean": 0.1, "correlation": 1})
    assert plane_errors(np.zeros_like(true), true)["correlation"] == 0
    with pytest.raises(ValueError, match="differ in size"):
        plane_errors(true[:5], true)


def test_scores_of_a_mask():
    true = np.zeros(SIZE, bool)
    true[:, :10] = True
    found = np.zeros(SIZE, bool)
    found[:, 5:20] = True
    assert mask_scores(found, true) == pytest.approx({"iou": 5 / 20, "precision": 5 / 15, "recall": 5 / 10})
    assert mask_scores(np.zeros_like(true), np.zeros_like(true)) == {"iou": 1, "precision": 1, "recall": 1}


def test_mist_and_drops_that_were_drawn_are_found(trained, tmp_path):
    scores = scores_against(trained, tmp_path, "raindrop", {"V": MIST, "M": drop_alpha()})
    assert scores["mist_rms"] < 0.06
    assert abs(scores["mist_mean"]) < 0.05
    assert scores["mist_correlation"] > 0.9
    assert scores["drops_iou"] > 0.8
    assert scores["drops_precision"] > 0.9
    assert scores["drops_recall"] > 0.85
    assert scores["drops_correlation"] > 0.85


def test_other_layers_than_those_drawn_are_not(trained, tmp_path):
    scores = scores_against(
        trained, tmp_path, "raindrop", {"V": MIST[:, ::-1].copy(), "M": drop_alpha()[::-1, ::-1].copy()}
    )
    assert scores["mist_rms"] > 0.15
    assert scores["mist_correlation"] < -0.8
    assert scores["drops_iou"] == 0


def test_even_rain_is_compared_with_the_median(trained, tmp_path):
    streaks = np.full(SIZE, 0.1, np.float32)
    streaks[:10] = 0.9  # fewer than half of the pixels
    assert scores_against(trained, tmp_path, "streak", {"S": streaks}) == {
        "rain_even_error": pytest.approx(-0.1, abs=1e-3)
    }


@pytest.mark.parametrize(
    ("effect", "names"),
    [("raindrop-b", {"D": "drops", "F": "mist"}), ("shower", {"lens.M": "drops", "lens.V": "mist", "storm.M": "rain"})],
)
def test_layers_of_other_names_are_what_their_effect_says(trained, tmp_path, effect, names):
    """Falling drops of a shower are water too, but none on the lens."""
    nothing, rain = np.zeros(SIZE, np.float32), np.full(SIZE, 0.1, np.float32)
    planes = {"drops": drop_alpha(), "mist": MIST, "rain": rain}
    layers = dict.fromkeys(find_effect(effect).planes, nothing) | {n: planes[part] for n, part in names.items()}
    scores = scores_against(trained, tmp_path / effect, effect, layers)
    expected = scores_against(trained, tmp_path / "known", "raindrop", {"V": MIST, "M": drop_alpha()})
    assert scores.pop("rain_even_error", -0.1) == pytest.approx(-0.1, abs=1e-3)
    assert scores == pytest.approx(expected, abs=1e-6)


def test_a_missing_layer_is_named(trained, tmp_path):
    write_json(tmp_path / "pattern.json", {"effect": "raindrop"})
    with pytest.raises(InputError, match=r"v0\.exr"):
        score_rain(trained, tmp_path, views(tmp_path, 3))

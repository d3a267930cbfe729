import numpy as np
import panorama
import pytest

from baselines.training.images import TrainingImages
from deraings.rain_model.ground_truth import mask_scores, plane_errors, score_rain
from deraings.rain_model.objective import RainObjective
from hydroviews.errors import InputError
from hydroviews.rain.layers import write_layers
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import View

SIZE = panorama.HEIGHT, panorama.WIDTH


def views(folder, count):
    camera = Camera(SIZE[1], SIZE[0], 50.0, 50.0, SIZE[1] / 2, SIZE[0] / 2, np.eye(4))
    return [View(f"v{i}", camera, folder / f"v{i}.png") for i in range(count)]


def test_errors_of_a_plane():
    true = panorama.slanted_veil(0.4)
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


def test_a_perfect_veil_has_no_error(tmp_path):
    scene = panorama.views_of(panorama.paint(), 3)
    objective = RainObjective(TrainingImages(panorama.eight_bit(scene)), 10)
    veil = objective.veil_share(0, SIZE)
    for view in views(tmp_path, 3):
        write_layers(
            tmp_path / "layers" / f"{view.name}.exr", {"V": veil, "M": np.zeros(SIZE), "S": np.full(SIZE, 0.1)}
        )
    scores = score_rain(objective, tmp_path, views(tmp_path, 3))
    assert scores["veil_rms"] < 1e-5
    assert scores["drops_iou"] == 1
    assert scores["falling_cover_error"] == pytest.approx(-0.1, abs=1e-3)


def test_a_missing_layer_is_named(tmp_path):
    scene = panorama.views_of(panorama.paint(), 3)
    objective = RainObjective(TrainingImages(panorama.eight_bit(scene)), 10)
    with pytest.raises(InputError, match=r"v0\.exr"):
        score_rain(objective, tmp_path, views(tmp_path, 3))

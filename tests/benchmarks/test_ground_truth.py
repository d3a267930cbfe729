"""What rain covers of a view, read from layers of several effects."""

import numpy as np
import pytest

from benchmarks.ground_truth import in_and_between_drops, true_covers
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.rain.layers import write_layers
from hydroviews.rain.registry import find_effect
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import View

HEIGHT, WIDTH = 6, 8
EXACT = {"drops": 0.75, "mist": 0.25, "rain": 0.125}  # as half floats


@pytest.fixture
def view(tmp_path):
    return View("v0", Camera(WIDTH, HEIGHT, 9.0, 9.0, WIDTH / 2, HEIGHT / 2, np.eye(4)), tmp_path / "v0.png")


@pytest.mark.parametrize(
    ("effect", "names"),
    [
        ("raindrop", {"M": "drops", "V": "mist"}),
        ("raindrop-b", {"D": "drops", "F": "mist"}),
        ("streak", {"S": "rain"}),
        ("shower", {"lens.M": "drops", "lens.V": "mist", "storm.M": "rain"}),  # falling drops are none on the lens
    ],
)
def test_planes_are_what_their_effect_says(view, tmp_path, effect, names):
    write_json(tmp_path / "pattern.json", {"effect": effect})
    planes = {name: EXACT.get(names.get(name), 0.0) for name in find_effect(effect).planes}
    layers = {name: np.full((2 * HEIGHT, 2 * WIDTH), value, np.float32) for name, value in planes.items()}
    write_layers(tmp_path / "layers" / "v0.exr", layers)
    covers = true_covers(tmp_path, view)
    assert all(cover.shape == (HEIGHT, WIDTH) for cover in covers.values())
    found = {part: float(cover.mean()) for part, cover in covers.items()}
    assert found == pytest.approx({part: EXACT[part] for part in names.values()})


def test_a_missing_layer_is_named(view, tmp_path):
    write_json(tmp_path / "pattern.json", {"effect": "raindrop"})
    with pytest.raises(InputError, match=r"v0\.exr"):
        true_covers(tmp_path, view)


def test_what_is_hidden_in_drops_and_elsewhere():
    """Means over views; one without drops counts elsewhere alone."""
    drops = np.zeros((HEIGHT, WIDTH), np.float32)
    drops[:2, :3] = 0.9
    hidden = np.where(drops > 0, np.float32(0.8), np.float32(0.1))
    dry = np.zeros_like(drops)
    shares = in_and_between_drops([(hidden, drops), (np.full_like(hidden, 0.3), dry)])
    assert shares == {"in drops": 0.8, "elsewhere": 0.2}

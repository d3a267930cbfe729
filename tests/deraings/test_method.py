"""The whole method: what it needs of the photographs, that it resumes, and that it comes back from disk."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from disturbed import fitted
from splats import photographed
from trainings import CONFIG

from baselines.gaussian_splatting import GaussianSplatting
from baselines.masking.pixel_weights import PixelWeights
from baselines.method import find_method
from baselines.splatting.objective import Objective
from baselines.training.images import TrainingImages, read_images
from baselines.training.torch_state import torch_threads
from deraings.enhancement import views as enhanced_views
from deraings.enhancement.architecture.network import EnhancementNetwork, NetworkConfig
from deraings.enhancement.enhance import Enhanced
from deraings.enhancement.views import EnhancedViews
from deraings.enhancement.weights import FILES, find_weights, load_enhancer
from deraings.lens.paleness import MistEvidence
from deraings.method import DeRainGS, DeRainGSConfig, DeRainGSPlus, RainModelOnly, WithoutAttention
from deraings.rain_model.config import RainConfig
from hydroviews.errors import InputError
from hydroviews.files.atomic import sha256
from hydroviews.scene.images import read_image

TINY = NetworkConfig(width=4, encoder=(1, 1, 1, 1), bottleneck=1, decoder=(1, 1, 1, 1), head_width=4, stem=2)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return photographed(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """Of a network that makes every picture darker by 0.1."""
    network = EnhancementNetwork(TINY)
    with torch.no_grad():
        network.head[0].bias.fill_(-0.1)
    path = tmp_path_factory.mktemp("weights") / "darker.safetensors"
    FILES.save(path, network, {"steps": 0, "data": "nothing"})
    return path


@pytest.fixture(scope="module")
def images(scene):
    return read_images(scene.train_views)


def views_of(scene, images, enhancer, folder):
    return EnhancedViews(images, [view.name for view in scene.train_views], enhancer, folder)


def test_photographs_are_enhanced_once_when_they_are_asked_for(scene, images, weights, tmp_path):
    enhancer = load_enhancer(weights)
    views = views_of(scene, images, enhancer, tmp_path)
    assert not list(tmp_path.iterdir())
    expected = np.clip(images.pixels(2) / 255 - 0.1, 0, 1)
    assert np.abs(views.image(2) - expected).max() < 0.01
    (kept,) = (tmp_path / views.digest).glob("*.png")
    before = kept.stat().st_mtime_ns
    assert np.array_equal(views.image(2), read_image(kept))
    files = views.files()
    assert kept.stat().st_mtime_ns == before
    times = [path.stat().st_mtime_ns for path in files]
    assert views_of(scene, images, enhancer, tmp_path).files() == files
    assert times == [path.stat().st_mtime_ns for path in files]
    with torch.no_grad():
        enhancer.network.head[0].bias.fill_(0.1)
    brighter = views_of(scene, images, enhancer, tmp_path)
    assert 255 * brighter.image(2).mean() > images.pixels(2).mean()
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("foggy", [False, True])
def test_mist_is_not_taken_off_where_it_is_foggy(scene, images, weights, tmp_path, monkeypatch, caplog, foggy):
    def enhance(image, enhancer, remove_mist, lens):
        return Enhanced(image * np.float32(0.5 + 0.5 * remove_mist), None, None)

    monkeypatch.setattr(MistEvidence, "foggy", foggy)
    monkeypatch.setattr(enhanced_views, "predict", enhance)
    method = DeRainGS(DeRainGSConfig(CONFIG, enhancement=str(weights)), 0)
    with caplog.at_level("INFO"):
        objective = method.objective(scene, tmp_path)
    factor = objective.images.pixels(0).mean() / images.pixels(0).mean()
    assert factor == pytest.approx(0.5 if foggy else 1, abs=0.01)
    assert ("leaving fog as it is" in method.found["enhancement"]) == foggy
    assert "enhancement weights from" in caplog.text
    assert ("foggy in the scene" in caplog.text) == foggy


@pytest.mark.parametrize("together", [True, False])
def test_each_photograph_is_enhanced_by_one_thread(scene, images, weights, tmp_path, monkeypatch, together):
    """The last bits depend on how many there are."""
    seen = []

    def enhance(image, *_, **__):
        seen.append(torch.get_num_threads())
        return Enhanced(image, None, None)

    monkeypatch.setattr(enhanced_views, "predict", enhance)
    with torch_threads(3):
        views = views_of(scene, images, load_enhancer(weights), tmp_path)
        made = views.files() if together else [views.file(0)]
        assert torch.get_num_threads() == 3
    assert seen == [1] * len(made)


def test_enhanced_photographs_hide_what_the_photographs_hide(scene, images, weights, tmp_path):
    hidden = np.zeros(images.pixels(0).shape[:2], bool)
    hidden[:20] = True
    masked = TrainingImages([images.pixels(index) for index in range(len(images))], [hidden] * len(images))
    found = views_of(scene, masked, load_enhancer(weights), tmp_path).training_images()
    assert len(found) == len(images)
    assert all(np.array_equal(found.ignored(index), hidden) for index in range(len(images)))
    expected = np.clip(masked.pixels(1)[~hidden] / 255 - 0.1, 0, 1)
    assert np.abs(found.pixels(1)[~hidden] / 255 - expected).max() < 0.01


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="not both"):
        DeRainGSConfig(CONFIG, enhancement="small", prior="small")
    with pytest.raises(InputError, match="call fit first"):
        DeRainGS(DeRainGSConfig(CONFIG), 0).learned()


def test_methods_are_found_and_differ_in_their_switches():
    assert find_method("deraings") is DeRainGS
    assert find_method("deraings-plus") is DeRainGSPlus
    paper, plus, less = (kind.configuration("demo") for kind in (DeRainGS, DeRainGSPlus, WithoutAttention))
    assert (plus.rain, paper.rain) == (RainConfig(), None)
    assert plus.prior
    assert paper.enhancement
    assert replace(plus, prior=None, weights_sha256=None) == RainModelOnly.configuration("demo")
    assert plus.weights_sha256 == sha256(find_weights("small")) == DeRainGS.configuration("standard").weights_sha256
    assert paper.splatting == plus.splatting == GaussianSplatting.configuration("demo")
    assert not less.masks.attention
    assert replace(less, masks=replace(less.masks, attention=True)) == paper


def test_what_is_hidden_is_the_union_of_rain_and_pixel_weights(scene, tmp_path):
    class Half(PixelWeights):
        def weigh(self, seen):
            return None

        def hidden(self, view, size, render):
            return np.full(size, 0.5, np.float32)

    class Corner(Objective):
        def hidden(self, view, size):
            return np.eye(*size, dtype=np.float32)

    class Both(GaussianSplatting):
        def objective(self, scene, folder):
            return Corner(read_images(scene.train_views), pixel_weights=Half())

    hidden = fitted(Both, CONFIG, scene, tmp_path).hidden(0, (20, 30))
    assert (hidden.dtype, hidden.shape) == (np.float32, (20, 30))
    assert np.array_equal(hidden, np.where(np.eye(20, 30) == 1, 1, 0.5))

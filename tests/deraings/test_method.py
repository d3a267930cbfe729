"""The whole method: what it needs of the photographs, that it resumes, and that it comes back from disk."""

from dataclasses import replace

import numpy as np
import pytest
import torch
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


def test_networks_learn_as_often_in_short_trainings():
    every = {name: config.masks.every for name, config in DeRainGS.profiles.items()}
    assert every == {"demo": 6, "quick": 12, "paper": 12}
    without = WithoutAttention.profiles["demo"].masks
    assert (without.every, without.attention) == (6, False)


def test_photographs_are_enhanced_once(scene, weights, tmp_path):
    images, enhancer = read_images(scene.train_views), load_enhancer(weights)
    names = [view.name for view in scene.train_views]
    enhanced = EnhancedViews(images, names, enhancer, tmp_path)
    enhanced.files()
    expected = np.clip(images.pixels(0) / 255 - 0.1, 0, 1)
    assert np.abs(enhanced.image(0) - expected).max() < 0.01
    (kept,) = tmp_path.iterdir()
    assert np.array_equal(enhanced.image(0), read_image(kept / f"{names[0]}.png"))
    times = [path.stat().st_mtime_ns for path in sorted(kept.iterdir())]
    assert EnhancedViews(images, names, enhancer, tmp_path).files() == enhanced.files()
    assert times == [path.stat().st_mtime_ns for path in sorted(kept.iterdir())]


def test_other_weights_enhance_anew(scene, weights, tmp_path):
    images, enhancer = read_images(scene.train_views), load_enhancer(weights)
    names = [view.name for view in scene.train_views]
    EnhancedViews(images, names, enhancer, tmp_path).files()
    with torch.no_grad():
        enhancer.network.head[0].bias.fill_(0.1)
    brighter = EnhancedViews(images, names, enhancer, tmp_path)
    assert 255 * brighter.image(0).mean() > images.pixels(0).mean()
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("foggy", [False, True])
def test_mist_is_not_taken_off_where_it_is_foggy(scene, weights, tmp_path, monkeypatch, caplog, foggy):
    monkeypatch.setattr(MistEvidence, "foggy", foggy)

    def enhance(image, enhancer, remove_mist, lens):
        return Enhanced(image * np.float32(0.5 + 0.5 * remove_mist), None, None)

    monkeypatch.setattr(enhanced_views, "predict", enhance)
    method = DeRainGS(DeRainGSConfig(CONFIG, enhancement=str(weights)), 0)
    with caplog.at_level("INFO"):
        objective = method.objective(scene, tmp_path)
    images = read_images(scene.train_views)
    factor = objective.images.pixels(0).mean() / images.pixels(0).mean()
    assert factor == pytest.approx(0.5 if foggy else 1, abs=0.01)
    assert ("leaving fog as it is" in method.found["enhancement"]) == foggy
    assert "enhancement weights from" in caplog.text
    assert ("foggy in the scene" in caplog.text) == foggy


def test_photographs_are_enhanced_only_when_they_are_asked_for(scene, weights, tmp_path):
    images = read_images(scene.train_views)
    views = EnhancedViews(images, [view.name for view in scene.train_views], load_enhancer(weights), tmp_path)
    assert not list(tmp_path.iterdir())
    expected = np.clip(images.pixels(2) / 255 - 0.1, 0, 1)
    assert np.abs(views.image(2) - expected).max() < 0.01
    (kept,) = (tmp_path / views.digest).glob("*.png")
    before = kept.stat().st_mtime_ns
    assert np.array_equal(views.image(2), views.image(2))
    assert kept.stat().st_mtime_ns == before


@pytest.mark.parametrize("together", [True, False])
def test_each_photograph_is_enhanced_by_one_thread(scene, weights, tmp_path, monkeypatch, together):
    """The last bits depend on how many there are."""
    images, names, seen = read_images(scene.train_views), [view.name for view in scene.train_views], []

    def enhance(image, *_, **__):
        seen.append(torch.get_num_threads())
        return Enhanced(image, None, None)

    monkeypatch.setattr(enhanced_views, "predict", enhance)
    with torch_threads(3):
        views = EnhancedViews(images, names, load_enhancer(weights), tmp_path)
        made = views.files() if together else [views.file(0)]
        assert torch.get_num_threads() == 3
    assert seen == [1] * len(made)


def test_enhanced_photographs_hide_what_the_photographs_hide(scene, weights, tmp_path):
    photographs = read_images(scene.train_views)
    hidden = np.zeros(photographs.pixels(0).shape[:2], bool)
    hidden[:20] = True
    count = len(photographs)
    images = TrainingImages([photographs.pixels(index) for index in range(count)], [hidden] * count)
    names = [view.name for view in scene.train_views]
    found = EnhancedViews(images, names, load_enhancer(weights), tmp_path).training_images()
    assert len(found) == count
    assert all(np.array_equal(found.ignored(index), hidden) for index in range(count))
    expected = np.clip(images.pixels(1)[~hidden] / 255 - 0.1, 0, 1)
    assert np.abs(found.pixels(1)[~hidden] / 255 - expected).max() < 0.01


def test_enhanced_photographs_are_learned_from_or_a_prior():
    with pytest.raises(ValueError, match="not both"):
        DeRainGSConfig(CONFIG, enhancement="small", prior="small")


def test_what_was_learned_is_refused_before_a_training():
    with pytest.raises(InputError, match="call fit first"):
        DeRainGS(DeRainGSConfig(CONFIG), 0).learned()


def test_methods_are_found_and_differ_in_their_switches():
    assert find_method("deraings") is DeRainGS
    assert find_method("deraings-plus") is DeRainGSPlus
    plus = DeRainGSPlus.configuration("demo")
    assert plus.rain == RainConfig()
    assert plus.prior
    assert replace(plus, prior=None, weights_sha256=None) == RainModelOnly.configuration("demo")
    assert plus.weights_sha256 == sha256(find_weights("small")) == DeRainGS.configuration("quick").weights_sha256
    paper = DeRainGS.configuration("demo")
    assert paper.enhancement
    assert paper.masks
    assert paper.rain is None
    assert paper.splatting == GaussianSplatting.configuration("demo")
    assert paper.splatting == plus.splatting
    less = WithoutAttention.configuration("demo")
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

    method = Both(CONFIG, 0)
    method.fit(scene, tmp_path)
    hidden = method.hidden(0, (20, 30))
    assert (hidden.dtype, hidden.shape) == (np.float32, (20, 30))
    assert np.array_equal(hidden, np.where(np.eye(20, 30) == 1, 1, 0.5))

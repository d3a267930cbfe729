"""Any method on enhanced photographs: as DeRainGS learns from them, masks in force, found by name, taken up again."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from disturbed import fitted
from splats import photographed
from tiny_network import TINY
from trainings import CONFIG, assert_identical

from baselines.gaussian_splatting import GaussianSplatting, GaussianSplattingClean
from baselines.method import WRAPPERS, find_method
from baselines.training.images import read_images
from deraings.enhanced_method import EnhancedConfig, enhanced_scene, enhanced_views, on_enhanced
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.weights import DEFAULT, FILES, find_weights
from deraings.method import DeRainGS, DeRainGSConfig
from hydroviews.errors import InputError
from hydroviews.files.atomic import sha256
from hydroviews.scene.lenses import Lens
from hydroviews.scene.masks import write_ignored

REPOSITORY = Path(__file__).parents[2]
ON_ENHANCED = "deraings.enhanced_method:on_enhanced"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Some views hide a corner."""
    folder = tmp_path_factory.mktemp("scene")
    scene = photographed(folder, n_views=9)
    ignored = np.zeros((36, 48), bool)
    ignored[:9, 30:] = True
    write_ignored(folder / "mask.png", ignored)
    masked = [replace(view, mask=folder / "mask.png" if i % 2 else None) for i, view in enumerate(scene.views)]
    return replace(scene, views=tuple(masked))


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """Of a network that has learned nothing, and so changes pictures in its own way."""
    torch.manual_seed(0)
    network = EnhancementNetwork(TINY)
    with torch.no_grad():
        for value in network.parameters():
            value += 0.02 * torch.randn(value.shape)
    path = tmp_path_factory.mktemp("weights") / "tiny.safetensors"
    FILES.save(path, network, {"steps": 0, "data": "nothing"})
    return path


def test_it_computes_what_deraings_does_without_masks(scene, weights, tmp_path):
    short, kind = replace(CONFIG, iterations=60), on_enhanced(GaussianSplatting)
    unmasked = fitted(DeRainGS, DeRainGSConfig(short, enhancement=str(weights)), scene, tmp_path / "unmasked")
    wrapped = fitted(kind, EnhancedConfig(short, str(weights), sha256(weights)), scene, tmp_path / "wrapped")
    plain = fitted(GaussianSplatting, short, scene, tmp_path / "plain")
    assert_identical(unmasked._trained, wrapped._inner._trained)
    camera = scene.views[0].camera
    assert not np.array_equal(wrapped.render(camera), plain.render(camera))
    assert wrapped.summary().used == f"enhancement {weights}"

    wrapped.save(tmp_path / "wrapped")
    loaded = kind.load(wrapped.config, 0, tmp_path / "wrapped")
    assert np.array_equal(loaded.render(camera), wrapped.render(camera))
    assert loaded.summary() == wrapped.summary()
    assert (tmp_path / "wrapped" / "splats.ply").is_file()


def test_a_finished_training_is_not_begun_again_and_other_weights_are_refused(scene, weights, tmp_path):
    kind = on_enhanced(GaussianSplatting)
    config = EnhancedConfig(replace(CONFIG, iterations=20), str(weights), sha256(weights))
    first = fitted(kind, config, scene, tmp_path)
    kept = sorted((tmp_path / "enhanced").rglob("*.png"))
    times = [path.stat().st_mtime_ns for path in kept]
    again = fitted(kind, config, scene, tmp_path)
    assert_identical(first._inner._trained, again._inner._trained)
    assert times == [path.stat().st_mtime_ns for path in kept]
    with pytest.raises(InputError, match="of another run, with a different images"):
        fitted(kind, replace(config, enhancement=DEFAULT), scene, tmp_path)


def test_what_is_hidden_stays_hidden_behind_a_lens_too(scene, weights, tmp_path):
    lens = Lens("SIMPLE_RADIAL", 48, 36, (43.2, 24.0, 18.0, 0.05))
    views = [replace(v, camera=lens.pinhole().camera(v.camera.world_to_camera), lens=lens) for v in scene.views]
    seen = replace(scene, views=tuple(views))
    enhanced = enhanced_scene(seen, enhanced_views(seen, read_images(seen.train_views), str(weights), tmp_path))
    for before, after in zip(seen.train_views, enhanced.train_views, strict=True):
        assert after.lens is None
        assert after.image().shape == before.image().shape
        assert not np.array_equal(after.image(), before.image())
        assert (after.ignored() is None) == (before.ignored() is None)
        assert before.ignored() is None or np.array_equal(after.ignored(), before.ignored())
    assert enhanced.test_views == seen.test_views


def test_it_is_found_by_name():
    registered = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["entry-points"][WRAPPERS]
    assert registered["enhance"] == ON_ENHANCED
    wrapped = find_method(f"3dgs+{ON_ENHANCED}")
    assert wrapped is on_enhanced(GaussianSplatting)
    assert (wrapped.trains_on, on_enhanced(GaussianSplattingClean).trains_on) == ("rainy", "clean")
    config = wrapped.configuration("demo")
    assert config == EnhancedConfig(GaussianSplatting.configuration("demo"), DEFAULT, sha256(find_weights(DEFAULT)))
    assert wrapped.with_max_iterations(config, 7).method.iterations == 7
    with pytest.raises(InputError, match="no-such-profile"):
        wrapped.configuration("no-such-profile")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("3dgs+fly", r"no such wrapper\n.*fly\n.*package.module:function"),
        ("3dgs+", "no such wrapper"),
        ("nothing+enhance", r"no such method\n.*nothing"),
        ("3dgs+json:JSONDecoder", "is not a wrapper"),
        ("3dgs+no.module:function", "cannot import no.module:function"),
        ("3dgs+builtins:repr", r"builtins:repr is not a method\n.*class"),
    ],
)
def test_what_is_no_wrapper_is_refused(name, message):
    with pytest.raises(InputError, match=message):
        find_method(name)

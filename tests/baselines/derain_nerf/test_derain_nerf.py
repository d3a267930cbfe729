"""What drops hide is not learned from; what they leave is."""

from dataclasses import replace
from pathlib import Path

import balls
import numpy as np
import pytest
import torch
from disturbed import fitted
from tiny_attention import GENERATOR

from baselines.derain_nerf import method as derain_nerf
from baselines.derain_nerf.method import (
    MASKS,
    DerainNeRF,
    DerainNeRFConfig,
    DropDetectionConfig,
    attention_of,
    drop_masks,
    hidden,
)
from baselines.derain_nerf.raindrop_attention.detection import Found
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.derain_nerf.raindrop_attention.weights import FILES
from baselines.training.images import TrainingImages
from hydroviews.errors import InputError

SHORT = replace(balls.SMALL, iterations=20, rays=64, anneal=10)
DROP = np.array([1.0, 0.0, 1.0], np.float32)  # no colour of the scene


def pasted(image: np.ndarray, _: int = 0) -> np.ndarray:
    """Drops at the same places of every picture."""
    image = image.copy()
    for top, left in ((3, 5), (9, 13), (15, 21), (2, 24)):
        image[top : top + 6, left : left + 5] = DROP
    return image


MASK = (pasted(np.zeros((24, 32, 3), np.float32)) == DROP).all(axis=-1)


def untrained(folder: Path) -> DropDetectionConfig:
    path = folder / "untrained.safetensors"
    FILES.save(path, DerainGenerator(GENERATOR), {})
    return DropDetectionConfig(weights=str(path), widened=0)


@pytest.fixture
def drops(tmp_path, monkeypatch) -> DropDetectionConfig:
    """Settings under which exactly the pasted drops are found."""
    monkeypatch.setattr(derain_nerf, "detect", lambda image, _: Found(MASK.astype(np.float32), image))
    return untrained(tmp_path)


def test_masks_bring_back_what_drops_cost(tmp_path, drops):
    scene, config = balls.photographed(tmp_path, change=pasted), replace(balls.SMALL, iterations=150, anneal=50)
    masked = fitted(DerainNeRF, DerainNeRFConfig(config, drops), scene, tmp_path / "masked")
    plain = fitted(balls.Plain, config, scene, tmp_path / "plain")
    with_masks, without = (balls.psnr(method.render, scene.test_views) for method in (masked, plain))
    assert with_masks > max(16, without + 3)
    assert f"{MASK.mean():.1%}" in masked.summary().used
    assert np.array_equal(masked.hidden(0, MASK.shape), MASK.astype(np.float32))
    assert masked.hidden(0, (MASK.shape[0] // 2, MASK.shape[1] // 2)).mean() == pytest.approx(MASK.mean(), abs=1e-6)
    assert plain.hidden(0, MASK.shape) is None


def test_hidden_pixels_do_not_count(tmp_path, drops):
    def grey(image, _):
        return np.where(MASK[..., None], 0.5, image)

    scenes = [balls.photographed(tmp_path / change.__name__, change=change) for change in (pasted, grey)]
    config = DerainNeRFConfig(SHORT, drops)
    for kind, settings, alike in ((DerainNeRF, config, True), (balls.Plain, SHORT, False)):
        methods = [fitted(kind, settings, scene, tmp_path / f"{kind.__name__}-{i}") for i, scene in enumerate(scenes)]
        one, other = (method._fitted.trained.model.parameters() for method in methods)
        assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True)) == alike
    with pytest.raises(InputError, match="another run"):
        fitted(DerainNeRF, replace(config, drops=replace(drops, widened=1)), scenes[0], tmp_path / "DerainNeRF-0")


def test_masks_are_found_once_for_photographs_and_weights(tmp_path, monkeypatch, drops):
    def found(level):
        pictures = [np.full((24, 32, 3), value, np.uint8) for value in (level, 9)]
        return np.array(drop_masks(TrainingImages(pictures), ["a", "b"], drops, tmp_path / MASKS))

    first = found(0)
    assert (first == MASK).all()
    monkeypatch.setattr(derain_nerf, "detect", lambda *_: pytest.fail("asked again"))
    assert np.array_equal(found(0), first)
    with pytest.raises(pytest.fail.Exception, match="asked again"):
        found(1)


@pytest.mark.parametrize(("widened", "pixels"), [(0, 1), (1, 5), (2, 17)])
def test_what_is_hidden_is_widened(widened, pixels):
    attention = np.zeros((9, 9), np.float32)
    attention[4, 4], attention[0, 0] = 0.5, 0.49
    assert hidden(attention, DropDetectionConfig(threshold=0.5, widened=widened)).sum() == pixels


def test_large_pictures_are_looked_at_as_small_ones(monkeypatch):
    seen, image = [], np.full((30, 90, 3), 0.25, np.float32)

    def look(image, _):
        seen.append(image.shape)
        return Found(np.full(image.shape[:2], image[0, 0, 0], np.float32), image)

    monkeypatch.setattr(derain_nerf, "detect", look)
    for longest in (45, 90, 480):
        attention = attention_of(image, DerainGenerator(GENERATOR), longest)
        assert attention.shape == (30, 90)
        np.testing.assert_allclose(attention, 0.25)
    assert seen == [(15, 45, 3), (30, 90, 3), (30, 90, 3)]


def test_other_weights_are_another_configuration_and_unknown_ones_are_refused(tmp_path, monkeypatch):
    def use(drops):
        monkeypatch.setattr(DerainNeRF, "profiles", {"demo": DerainNeRFConfig(SHORT, drops)})
        return DerainNeRF.configuration("demo")

    assert len(use(untrained(tmp_path)).drops.weights_sha256) == 64
    with pytest.raises(InputError, match="none of that name"):
        use(DropDetectionConfig(weights="enormous"))


def test_a_network_looks_at_the_photographs(tmp_path):
    """The code that finds drops itself, on a picture of its own."""
    images = TrainingImages([np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)])
    for threshold, everywhere in ((0.0, True), (1.0, False)):
        (mask,) = drop_masks(images, ["a"], replace(untrained(tmp_path), threshold=threshold), tmp_path)
        assert (mask == everywhere).all()

"""A variant as a PyTorch data set: the same items from a built scene and from an archive."""

import pickle

import numpy as np
import pytest
import torch
from shared_data_set import built_in
from synthetic import capture_in

from hydroviews.dataset.build import build
from hydroviews.dataset.sharing.pack import pack
from hydroviews.dataset.variants import open_variant
from hydroviews.errors import InputError
from hydroviews.rain.compositing import add_water
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import Pattern
from hydroviews.scene.images import read_image
from hydroviews.torch import RainyViews


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return built_in(tmp_path_factory.mktemp("shared"))


@pytest.fixture(scope="module")
def archives(built):
    paths = [path for path, _ in pack(built, built.parents[1] / "out")]
    return {path.stem.removeprefix("yard-"): path for path in paths}


def same(one, other):
    assert one.keys() == other.keys()
    for key, value in one.items():
        if isinstance(value, dict):
            same(value, other[key])
        else:
            assert value == other[key] if isinstance(value, str) else torch.equal(value, other[key])


@pytest.mark.parametrize("variant", ["streak-1", "storm-1", "clean"])
@pytest.mark.parametrize("split", ["train", "test"])
def test_built_and_packed_give_the_same_items(built, archives, variant, split):
    there, packed = RainyViews(built, variant, split), RainyViews(archives[variant], split=split)
    assert len(there) == len(packed) == (7 if split == "train" else 2)
    for i in range(len(there)):
        same(there[i], packed[i])


def test_an_item_is_what_lies_on_disk(built):
    views, scene = RainyViews(built, "storm-1"), open_variant(built, "storm-1")
    for item, view in zip((views[i] for i in range(len(views))), scene.train_views, strict=True):
        assert item["name"] == view.name
        assert item["rainy"].shape == item["clean"].shape == (3, 36, 48)
        assert all(item[key].dtype == torch.float32 for key in ("rainy", "clean", "cover", "intrinsics"))
        assert np.array_equal(item["rainy"].numpy().transpose(1, 2, 0), view.image())
        assert np.array_equal(item["clean"].numpy().transpose(1, 2, 0), read_image(built / f"clean/{view.name}.png"))
        assert np.allclose(item["intrinsics"].numpy(), view.camera.matrix)
        assert np.allclose(item["world_to_camera"].numpy(), view.camera.world_to_camera)


def test_the_cover_is_what_the_composite_hides(built):
    """Black water over white: what is left of the white, in linear light, is what the cover leaves."""
    item = RainyViews(built, "storm-1")[0]
    layers = read_layers(built / "storm-1" / "layers" / f"{item['name']}.exr")
    black = {name: plane * (name not in "RGB") for name, plane in layers.items()}
    left = add_water(np.ones((36, 48, 3), np.float32), black)
    linear = np.where(left <= 0.04045, left / 12.92, ((left + 0.055) / 1.055) ** 2.4)[..., 0]
    assert np.allclose(1 - linear, item["cover"][0], atol=2e-6)
    assert 0 < item["cover"].max() <= 1


def test_light_and_noise_are_no_cover(tmp_path):
    built = build(capture_in(tmp_path / "yard"), tmp_path / "data", patterns=(Pattern("dark", 1), Pattern("haze", 1)))
    assert RainyViews(built, "dark-1")[0]["cover"].max() == 0
    hazy = RainyViews(built, "haze-1")[0]
    assert torch.allclose(hazy["cover"][0], hazy["layers"]["H"], atol=1e-6)
    assert hazy["cover"].max() > 0


def test_an_effect_whose_package_is_not_there_leaves_the_cover_out(built, monkeypatch, caplog):
    def missing(name):
        raise InputError(f"{name}: not installed")

    monkeypatch.setattr("hydroviews.torch.find_effect", missing)
    item = RainyViews(built, "streak-1")[0]
    assert "cover" not in item
    assert item["layers"].keys() == {"S"}
    assert "streak-1: items have no cover: streak: not installed" in caplog.text


@pytest.mark.parametrize("kind", ["built", "packed"])
def test_workers_get_copies(built, archives, kind):
    views = RainyViews(built, "streak-1") if kind == "built" else RainyViews(archives["streak-1"])
    same(pickle.loads(pickle.dumps(views))[2], views[2])
    loader = torch.utils.data.DataLoader(views, batch_size=4, num_workers=2, multiprocessing_context="fork")
    batches = list(loader)
    assert [name for batch in batches for name in batch["name"]] == list(views.names)
    assert batches[0]["rainy"].shape == (4, 3, 36, 48)
    assert torch.equal(batches[0]["layers"]["S"][1], views[1]["layers"]["S"])


def test_changed_files_are_refused(tmp_path):
    built = built_in(tmp_path, patterns=("streak-1",))
    [(path, _)] = pack(built, tmp_path / "out", patterns=["streak-1"])
    views = RainyViews(path)
    content = bytearray(path.read_bytes())
    start, size = views._files.places[f"clean/{views.names[1]}.png"]
    content[start + size // 2] ^= 1
    path.write_bytes(content)
    views[0]
    with pytest.raises(InputError, match="not what the manifest says"):
        views[1]
    image = built / "streak-1" / "images" / f"{views.names[0]}.png"
    image.unlink()
    image.write_bytes(b"other")
    with pytest.raises(InputError, match="changed since it was built"):
        RainyViews(built, "streak-1")[0]


def test_a_capture_taken_in_rain_has_no_clean_views(tmp_path):
    says = {"rain": "captured", "licence": "CC0-1.0", "shareable": True}
    built = built_in(tmp_path, patterns=(), says=says)
    [(path, _)] = pack(built, tmp_path / "out")
    assert path.name == "yard-captured-0.zip"
    for views in (RainyViews(built, "captured-0"), RainyViews(path)):
        assert views[0].keys() == {"name", "rainy", "intrinsics", "world_to_camera"}


def test_what_is_not_there_is_refused_by_name(built, tmp_path):
    layers = [path for path, _ in pack(built, tmp_path / "out", patterns=["storm-1"], layers_only=True)]
    for given, message in (
        ((built, "streak-2"), "no such variant of"),
        ((built,), "no such variant of"),
        ((built, "streak-1", "sparse"), "no such split"),
        ((tmp_path, "streak-1"), "no finished scene"),
    ):
        with pytest.raises(InputError, match=message):
            RainyViews(*given)
    with pytest.raises(InputError, match="no pictures of storm-1 in it"):
        RainyViews(layers[0])

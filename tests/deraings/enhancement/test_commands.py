from dataclasses import replace

import cv2
import numpy as np
import pytest
from tiny_network import TINY

from baselines.derain_nerf.raindrop_attention import __main__ as attention
from deraings.enhancement import __main__ as commands
from deraings.enhancement.__main__ import (
    TrainingRequest,
    describe_command,
    enhance_command,
    export_command,
    train_command,
)
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.before_after import before_and_after
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.data import Data, described, started_from
from deraings.enhancement.weights import FILES
from hydroviews.errors import InputError
from hydroviews.scene.images import read_image, to_uint8, write_png


def pictures(folder, count: int = 2):
    rng = np.random.default_rng(0)
    for i in range(count):
        write_png(folder / f"{i}.png", rng.integers(0, 256, (40, 50, 3)).astype(np.uint8))


@pytest.fixture
def weights(tmp_path):
    """Of a network that changes nothing."""
    path = tmp_path / "weights.safetensors"
    FILES.save(path, EnhancementNetwork(TINY), {"data": "nothing", "steps": 0})
    return path


def test_a_folder_of_pictures_is_enhanced_and_drawn_before_and_after(tmp_path, weights, capsys):
    pictures(tmp_path / "in", 3)
    sheet = tmp_path / "sheet.png"
    enhance_command(tmp_path / "in", tmp_path / "out", str(weights), sheet=sheet)
    printed = capsys.readouterr().out
    assert str(weights) in printed
    assert str(sheet) in printed
    shown = [(f"{i}.png", *(read_image(tmp_path / folder / f"{i}.png") for folder in ("in", "out"))) for i in range(3)]
    assert all(np.array_equal(before, after) for _, before, after in shown)  # nothing is changed by these weights
    expected = before_and_after("Enhancement", "3 of 3 photographs", shown)
    np.testing.assert_array_equal(to_uint8(read_image(sheet)), expected)


def test_a_damaged_picture_is_refused_before_any_is_enhanced(tmp_path, weights, capfd):
    pictures(tmp_path / "in")
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3)).astype(np.uint8)
    encoded = cv2.imencode(".jpg", noise)[1]
    encoded[len(encoded) // 2 :][:6000] = 0
    (tmp_path / "in" / "2.jpg").write_bytes(encoded.tobytes())
    with pytest.raises(InputError, match=r"2\.jpg: a damaged JPEG"):
        enhance_command(tmp_path / "in", tmp_path / "out", str(weights))
    assert not (tmp_path / "out").exists()
    assert "JPEG" not in capfd.readouterr().err  # the decoder's own words


@pytest.mark.parametrize("name", ["sheet.jpg", "out/sheet.png"])
def test_a_sheet_is_not_taken_for_a_picture(tmp_path, weights, name):
    pictures(tmp_path / "in")
    with pytest.raises(InputError, match="--sheet"):
        enhance_command(tmp_path / "in", tmp_path / "out", str(weights), sheet=tmp_path / name)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "removed", "known"),
    [({}, True, True), ({"keep_fog": True}, False, True), ({"apart": True}, True, False)],
)
def test_fog_can_be_kept_and_pictures_be_looked_at_alone(tmp_path, weights, monkeypatch, options, removed, known):
    pictures(tmp_path / "in")
    asked = []

    def enhance(image, enhancer, remove_mist, lens):
        asked.append((remove_mist, lens is not None))
        return image

    monkeypatch.setattr(commands, "enhance", enhance)
    enhance_command(tmp_path / "in", tmp_path / "out", str(weights), **options)
    assert asked == [(removed, known)] * 2


def test_no_picture_is_lost_when_others_are_enhanced(tmp_path, weights):
    pictures(tmp_path / "in")
    with pytest.raises(InputError, match="written over"):
        enhance_command(tmp_path / "in", tmp_path / "in", str(weights))
    write_png(tmp_path / "in" / "1.jpg", np.zeros((8, 8, 3), np.float32))
    with pytest.raises(InputError, match=r"several pictures would become 1\.png"):
        enhance_command(tmp_path / "in", tmp_path / "out", str(weights))
    (tmp_path / "phone").mkdir()
    (tmp_path / "phone" / "a.heic").write_bytes(b"")
    with pytest.raises(InputError, match=r"no pictures\n.*1 \.heic"):
        enhance_command(tmp_path / "phone", tmp_path / "out", str(weights))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("program", [commands, attention])
@pytest.mark.parametrize("name", ["weights.safetensors", "weights.json", "curve.csv"])
def test_files_of_the_users_where_networks_are_trained_stay(tmp_path, program, name):
    mine, photographs = tmp_path / "trained" / name, tmp_path / "photographs"
    mine.parent.mkdir()
    mine.write_text("mine")
    data = Data((photographs,)) if program is commands else photographs
    with pytest.raises(InputError, match=f"{name}: not written by HydroViews, and in the way"):
        program.train_command(program.TrainingRequest(data, out=mine.parent))
    assert mine.read_text() == "mine"


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("w.safetensors", lambda f, weights: commands.average_command((weights,), (f,), f / "w.safetensors")),
        ("w.json", lambda f, weights: commands.average_command((weights,), (f,), f / "w.safetensors")),
        ("plot.svg", lambda f, weights: commands.validate_command((f,), weights, f / "cache", plot=f / "plot.svg")),
    ],
)
def test_files_of_the_users_where_a_mean_or_a_plot_is_written_stay(tmp_path, weights, name, command):
    (tmp_path / name).write_text("mine")
    with pytest.raises(InputError, match=f"{name}: not written by HydroViews"):
        command(tmp_path, str(weights))
    assert (tmp_path / name).read_text() == "mine"


def test_describe_counts(capsys):
    describe_command("small", 400, 300)
    assert "1,207,328" in capsys.readouterr().out


def test_what_cannot_be_trained_or_exported_is_refused(tmp_path):
    pictures(tmp_path / "photographs")
    with pytest.raises(InputError, match="nothing has been trained"):
        export_command(TrainingRequest(Data((tmp_path / "photographs",)), out=tmp_path / "empty"))
    with pytest.raises(InputError, match="cannot cut parts of 192x192 pixels"):
        train_command(TrainingRequest(Data((tmp_path / "photographs",), sides=(384, 240)), out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()
    for wrong in ({"sides": ()}, {"lenses": 0}, {"without": ("fog",)}):
        with pytest.raises(InputError, match=r"nothing to learn from|fog"):
            Data((tmp_path,), **wrong)


def test_what_a_training_begins_with_stands_in_its_data(tmp_path, weights):
    pictures(tmp_path / "photographs")
    data, config = Data((tmp_path / "photographs",)), TrainingConfig(network=TINY)
    assert "begun" not in described(data, started_from(data, config))
    data = replace(data, start=str(weights))
    begun = described(data, started_from(data, config))
    assert "begun with weights.safetensors (0 steps, " in begun
    FILES.save(weights, EnhancementNetwork(TINY), {"data": "others", "steps": 0})
    assert described(data, started_from(data, config)) != begun


def test_all_that_is_learned_from_stands_in_the_data(tmp_path):
    pictures(tmp_path / "photographs")
    for folder in ("input", "target"):
        pictures(tmp_path / "pairs" / folder)
    data = Data((tmp_path / "photographs",), sides=(480, 288), lenses=7, pairs=(tmp_path / "pairs",))
    before = described(data, None)
    assert before == described(data, None)
    assert "480 or 288 pixels wide or high; 7 wet lenses and 6 windows a frame" in before
    assert described(replace(data, without=("pane", "streak")), None).endswith("; no pane and no streak")
    found = [before]
    for changed in (next((tmp_path / "pairs").rglob("*.png")), tmp_path / "photographs" / "1.png"):
        write_png(changed, np.zeros((99, 99, 3), np.float32))
        found.append(described(data, None))
    assert len(set(found)) == 3

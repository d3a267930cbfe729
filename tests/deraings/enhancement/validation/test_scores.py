"""Scores of networks whose planes, covers and pictures are known."""

import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import torch
from tiny_network import TINY
from wet import photograph

from baselines.supervised.validation import as_json
from deraings.enhancement import __main__ as commands
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.enhance import Enhanced
from deraings.enhancement.validation import scores as validation
from deraings.enhancement.validation.calibration import calibration
from deraings.enhancement.validation.detection import detection
from deraings.enhancement.validation.pictures import (
    TrueMist,
    ValidationPicture,
    rainy_picture,
    setting_of,
    validation_set,
)
from deraings.enhancement.validation.scores import as_columns, scores, scores_by_companions, table
from deraings.enhancement.weights import FILES
from hydroviews.errors import InputError
from hydroviews.rain.patterns import Pattern
from hydroviews.scene.images import to_linear, to_srgb, write_png

SIDE = 32
ALONE = np.zeros((0, SIDE, SIDE, 3), np.uint8)  # companions
WHITE = np.full(3, 0.7, np.float32)


@pytest.fixture
def network():
    """One that changes nothing, and finds no mist."""
    return EnhancementNetwork(TINY).requires_grad_(False)


@pytest.fixture
def clean():
    return np.random.default_rng(0).uniform(0.2, 0.8, (SIDE, SIDE, 3)).astype(np.float32)


def half_covered():
    cover = np.zeros((SIDE, SIDE), np.float32)
    cover[:, : SIDE // 4] = 1
    return cover


def picture(clean, **truth):
    rainy = np.clip(clean + np.float32(0.1), 0, 1)
    return ValidationPicture("rain", rainy, clean, truth.pop("companions", ALONE), **truth)


def seeing(network, cover, light, streaks=-9.0, drops=-9.0):
    """The network, with the same mist and the same cover found everywhere in every picture."""
    values = [math.atanh(cover / 0.97), *(math.log(value / (1 - value)) for value in light)]
    for branch in (network.mist, network.lens_mist):
        branch.end.bias.copy_(torch.tensor(values))
    network.cover.head.weight.zero_()
    network.cover.head.bias.copy_(torch.tensor([streaks, drops, -9.0]))
    return network


def rows_found(monkeypatch, network, pictures, covers, **options):
    """Scores of a network that finds these covers [H, W, 3], one after another."""
    found = iter(covers)
    monkeypatch.setattr(validation, "predict", lambda image, *_, **__: Enhanced(image, next(found), None))
    return scores(network, pictures, **options)


def cover_of(drops, streaks=None):
    nothing = np.zeros_like(drops)
    return np.stack([nothing if streaks is None else streaks, drops, nothing], axis=-1)


def test_scores_are_means_by_kind(network):
    clean = np.full((SIDE, SIDE, 3), 0.5, np.float32)
    pictures = [ValidationPicture("mist", clean + np.float32(more), clean, ALONE) for more in (0.1, 0.01)]
    (row,) = scores(network, pictures)
    assert (row.kind, row.pictures) == ("mist", 2)
    assert (row.before, row.after) == (pytest.approx(30, abs=1e-3), pytest.approx(30, abs=1e-3))
    assert row.brightness == pytest.approx(255 * 0.055, abs=1e-3)
    assert as_columns([row]) == {"mist": row.after}
    assert "| 30.00 | 30.00 |" in table([row])
    assert "| 14.03/255 |" in table([row])


@pytest.mark.parametrize(
    ("found", "light", "least", "most"),
    [(0.4, WHITE, 80, math.inf), (0.3, WHITE, 20, 40), (0.4, 0.9 * WHITE, 20, 40), (0.02, WHITE, 10, 40)],
)
def test_true_planes_leave_the_clean_picture_and_wrong_ones_do_not(network, clean, found, light, least, most):
    mist = TrueMist(np.full((SIDE, SIDE), 0.4, np.float32), WHITE)
    (row,) = scores(seeing(network, found, light), [picture(clean, mist=mist, drops=half_covered())])
    assert least < row.planes < most
    assert row.misted < row.planes
    assert row.misted < 30


def test_mist_that_is_not_there_is_an_error_of_the_planes(network, clean):
    none = TrueMist(np.zeros((SIDE, SIDE), np.float32), np.zeros(3, np.float32))
    (row,) = scores(seeing(network, 0.2, WHITE), [ValidationPicture("clean", clean, clean, ALONE, mist=none)])
    assert math.isinf(row.misted)
    assert row.planes < 35


def test_mist_lies_over_pictures_in_linear_light(clean):
    cover = np.linspace(0, 1, SIDE * SIDE, dtype=np.float32).reshape(SIDE, SIDE)
    share = cover[..., None]
    misted = TrueMist(cover, WHITE).over(clean)
    np.testing.assert_allclose(misted, to_srgb((1 - share) * to_linear(clean) + share * WHITE), atol=1e-5)
    assert np.array_equal(TrueMist(0 * cover, WHITE).over(clean), clean)


def test_a_perfect_cover_has_average_precision_one_and_an_inverted_one_far_less(monkeypatch, network, clean):
    drops = half_covered()
    pictures = [picture(clean, drops=drops, streaks=drops.T)] * 2
    (best,) = rows_found(monkeypatch, network, pictures, [cover_of(drops, drops.T)] * 2)
    assert (best.drops, best.drops_precision, best.drops_recall) == (1, 1, 1)
    assert (best.streaks, best.streaks_precision, best.streaks_recall) == (1, 1, 1)
    (worst,) = rows_found(monkeypatch, network, pictures, [cover_of(1 - drops, 1 - drops.T)] * 2)
    assert worst.drops == pytest.approx(drops.mean())
    assert (worst.drops_precision, worst.drops_recall) == (0, 0)


def test_detection_against_counting():
    truth, found = (np.array([values], np.float32) for values in ([1, 0.6, 0.4, 0], [0.9, 0.3, 0.8, 0.7]))
    counted = detection([found, None, truth], [truth, truth, None], 0.5)
    assert counted.average_precision == pytest.approx(0.5 * 1 + 0.5 * 2 / 4)
    assert (counted.precision, counted.recall) == (pytest.approx(1 / 3), pytest.approx(1 / 2))
    lower = detection([found], [truth], 0.35)
    assert (lower.precision, lower.recall) == (pytest.approx(2 / 3), pytest.approx(2 / 3))
    assert all(math.isnan(value) for value in detection([found], [0 * truth], 0.5))
    assert all(math.isnan(value) for value in detection([None], [truth], 0.5))


def test_a_mean_over_views_sees_drops_that_each_view_sees_badly(monkeypatch, network, clean):
    rng, drops = np.random.default_rng(0), half_covered()
    covers = [cover_of(np.clip(drops * 0.3 + rng.uniform(0, 0.7, drops.shape), 0, 1)) for _ in range(5)]
    others = np.full((6, SIDE, SIDE, 3), 100, np.uint8)
    wet = [picture(clean, drops=drops, companions=others)]
    (row,) = rows_found(monkeypatch, network, wet, covers, companions=6, views=4)
    assert 1 >= row.drops_over_views > row.drops + 0.02
    (row,) = rows_found(monkeypatch, network, wet, covers[:1], companions=6, views=0)
    assert math.isnan(row.drops_over_views)
    (row,) = rows_found(monkeypatch, network, wet, covers[:1], companions=0)
    assert math.isnan(row.drops_over_views)


def test_scores_with_companions_are_of_a_network_that_knows_them(network):
    clean, others = np.full((SIDE, SIDE, 3), 0.5, np.float32), np.full((3, SIDE, SIDE, 3), 100, np.uint8)
    torch.nn.init.ones_(network.lens_fine[-1].weight)
    torch.nn.init.normal_(network.head[0].weight, std=0.1)
    seen = [picture(clean, companions=others, drops=half_covered())]
    found = scores_by_companions(network, seen, (0, 1, 3))
    after = [row.after for (row,) in found.values()]
    assert after[0] == scores(network, seen)[0].after
    assert len(set(after)) == 3
    assert [math.isfinite(row.drops_over_views) for (row,) in found.values()] == [False, False, True]


def test_what_nobody_knows_has_no_number(network, clean):
    rows = scores(network, [ValidationPicture("clean", clean, clean, ALONE)])
    kept = as_json(rows, decimals=3)[0]
    assert all(kept[name] is None for name in ("before", "misted", "planes", "drops", "drops_over_views", "streaks"))
    assert "| clean | 1 |  |  |  |  |  |  |  |  |  | the same |" in table(rows)


def rainy(tmp_path, effect, count=1, flat=False):
    """A validation picture of the medium grade; `flat`: of a picture of one colour."""
    write_png(tmp_path / "a.png", photograph())
    image = np.full(photograph().shape, 0.4, np.float32) if flat else photograph().astype(np.float32) / 255
    others = np.stack([photograph(1)] * count)
    setting = setting_of(tmp_path / "a.png", image, 0)
    return rainy_picture(image, others, Pattern(effect, 1), setting, tmp_path / "baked")


@pytest.mark.parametrize("effect", ["streak", "streak-b", "raindrop-b"])
def test_streaks_are_new_in_each_companion_drops_stay_and_both_are_known(tmp_path, effect):
    seen = rainy(tmp_path, effect, 2)
    assert seen.kind == f"{effect}-medium"
    assert np.array_equal(seen.companions[0], seen.companions[1]) == (effect == "raindrop-b")
    assert seen.mist is None  # of raindrop-b: its mist is added in encoded values
    if effect == "raindrop-b":
        assert 0.01 < (seen.drops > 0.5).mean() < 0.5
        assert seen.streaks is None
    else:
        assert seen.drops is None
        harm = np.abs(seen.rainy - seen.clean).mean(axis=2)
        assert harm[seen.streaks > 0.3].mean() > 1.5 * harm[seen.streaks < 0.1].mean()


@pytest.mark.blender
@pytest.mark.parametrize("effect", ["raindrop", "window"])
def test_baked_drops_are_known_with_their_mist(tmp_path, effect):
    """The picture has one colour, so that the blur behind a window's mist changes nothing."""
    seen = rainy(tmp_path, effect, flat=True)
    assert (seen.drops > 0.5).any()
    dry = seen.drops == 0
    assert dry.any()
    np.testing.assert_allclose(seen.mist.over(seen.clean)[dry], seen.rainy[dry], atol=3e-3)


def test_a_set_has_every_pattern_of_every_photograph(tmp_path):
    for index in range(2):
        write_png(tmp_path / f"{index}.png", photograph(index, 256, 384))
    patterns = [Pattern("streak", 2), Pattern("raindrop-b", 1)]
    found = validation_set([tmp_path / "0.png", tmp_path / "1.png"], 0, tmp_path, 1, patterns)
    assert [one.kind for one in found] == 2 * ["clean", "streak-heavy", "raindrop-b-medium"]
    assert all(one.companions.shape == (1, 256, 384, 3) for one in found)
    assert not found[0].mist.cover.any()


def test_families_of_the_recipes_judge_as_well(tmp_path):
    write_png(tmp_path / "0.png", photograph(0, 256, 384))
    found = validation_set([tmp_path / "0.png"], 0, tmp_path, 0, (), ("pane", "lines", "lines+pane"), 192)
    assert [one.kind for one in found] == ["clean", "pane", "lines", "lines+pane"]
    _, pane, lines, mixed = found
    assert all(one.rainy.shape == (128, 192, 3) for one in found)
    assert all(np.abs(one.rainy - one.clean).mean() > 0.005 for one in found[1:])
    assert pane.streaks is None
    assert lines.drops is None
    assert mixed.streaks is not None
    again = validation_set([tmp_path / "0.png"], 0, tmp_path, 0, (), ("lines+pane",), 192)[1]
    np.testing.assert_array_equal(again.rainy, mixed.rainy)
    with pytest.raises(InputError, match="drizzle"):
        validation_set([tmp_path / "0.png"], 0, tmp_path, 0, (), ("drizzle",))


def test_the_command_judges_by_rain_that_the_user_names_and_draws_errors(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(commands, "PATTERNS", (Pattern("streak", 0),))
    for index in range(2):
        write_png(tmp_path / "photographs" / f"{index}.png", photograph(index, 256, 384))
    FILES.save(tmp_path / "w.safetensors", EnhancementNetwork(replace(TINY, error=True)), {"data": "", "steps": 0})
    settings = ((tmp_path / "photographs",), str(tmp_path / "w.safetensors"), tmp_path / "cache")
    plot = tmp_path / "plot.svg"
    commands.validate_command(*settings, companions=(0, 1), patterns=("streak-b-1",), side=192, plot=plot)
    shown = capsys.readouterr().out
    assert "\n0 companions\n" in shown
    assert "\n1 companions\n" in shown
    assert shown.count("| streak-light | 1 |") == shown.count("| streak-b-medium | 1 |") == 2
    drawn = ElementTree.parse(plot).getroot()
    assert len(drawn.findall("{http://www.w3.org/2000/svg}polyline")) == 3  # clean, and both kinds of streaks
    assert "streak-light" in "".join(drawn.itertext())
    with pytest.raises(InputError, match="drizzle"):
        commands.validate_command(*settings, patterns=("drizzle-1",))


def test_calibration_is_of_tenths_in_order_of_the_predicted_error():
    predicted = np.random.default_rng(0).random((50, 40), np.float32)
    expected, found = calibration([predicted[:25], predicted[25:]], [2 * predicted[:25], 2 * predicted[25:]])
    assert len(expected) == len(found) == 10
    assert np.allclose(found, 2 * np.array(expected), atol=1e-4)
    assert np.allclose(expected, np.arange(0.05, 1, 0.1), atol=0.03)


def test_an_error_that_is_predicted_right_ranks_first():
    rng = np.random.default_rng(0)
    clean, error = rng.random((30, 30, 3), np.float32), rng.random((30, 30), np.float32)
    picture = clean + error[..., None]
    assert validation.doubt(Enhanced(picture, None, error), clean) == pytest.approx((1, 1), abs=1e-3)
    assert validation.doubt(Enhanced(picture, None, 2 * error[::-1].copy()), clean)[0] < 0.5
    assert np.isnan(validation.doubt(Enhanced(picture, None, None), clean)).all()

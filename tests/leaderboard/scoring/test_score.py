"""Views are scored two at a time; the numbers are those of one after another."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from synthetic import capture_in

from hydroviews import metrics
from hydroviews.cli import threads
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from hydroviews.scene.images import read_image, write_png
from leaderboard.scoring import score
from leaderboard.scoring.score import score_views


@pytest.fixture
def rendered(tmp_path, monkeypatch):
    """Views of a capture, and a folder with renders of them."""
    monkeypatch.setattr(threads, "processors", lambda: 2)
    views, rng = capture_in(tmp_path / "yard", n_views=5).views, np.random.default_rng(0)
    for view in views:
        noisy = view.image() + 0.05 * rng.standard_normal((36, 48, 3))
        write_png(tmp_path / "renders" / f"{view.name}.png", np.clip(noisy, 0, 1).astype(np.float32))
    return views, tmp_path / "renders"


def test_scores_are_those_of_one_view_after_another(rendered):
    views, renders = rendered
    reasons = {}
    rows = score_views(renders, views, reasons)
    assert [row["view"] for row in rows] == [view.name for view in views]
    assert not reasons
    for row, view in zip(rows, views, strict=True):
        pair = read_image(renders / f"{view.name}.png"), view.image()
        for metric in metrics.METRICS:
            assert metric.text(row[metric.name]) == metric.text(metric.function(*pair))
            assert row[metric.name] == pytest.approx(metric.function(*pair), rel=1e-5)


def test_a_metric_that_cannot_be_had_is_not_asked_for_every_view(rendered, monkeypatch):
    asked = []

    def fails(image, target, ignored):
        asked.append(1)
        raise InputError("no weights", fix="go online")

    monkeypatch.setattr(score, "find_metrics", lambda: (replace(metrics.METRICS[0], function=fails),))
    views, renders = rendered
    reasons = {}
    assert [row["psnr"] for row in score_views(renders, views, reasons)] == [None] * 5
    assert reasons == {"psnr": "no weights"}
    assert len(asked) <= threads.AT_ONCE


def test_a_view_without_a_score_leaves_the_others_theirs(rendered, monkeypatch):
    views, renders = rendered
    hidden = {view.image().tobytes(): view.name for view in (views[1], views[3])}

    def of_some(image, target, ignored):
        if target.tobytes() in hidden:
            raise ValueError(f"all of {hidden[target.tobytes()]} is hidden")
        return 1.0

    monkeypatch.setattr(score, "find_metrics", lambda: (replace(metrics.METRICS[0], function=of_some),))
    reasons = {}
    assert [row["psnr"] for row in score_views(renders, views, reasons)] == [1.0, None, 1.0, None, 1.0]
    assert reasons == {"psnr": f"all of {views[1].name} is hidden"}


@pytest.mark.parametrize(
    ("value", "reason"),
    [(float("nan"), "not a number for 1 of 2 views"), (float("inf"), "infinite: a render equals its clean view")],
)
def test_a_mean_that_is_no_number_has_its_own_reason(monkeypatch, value, reason):
    monkeypatch.setattr(score, "find_metrics", lambda: metrics.METRICS[:1])
    reasons = {}
    assert score.mean_scores([{"psnr": 20.0}, {"psnr": value}], reasons) == {}
    assert reasons == {"psnr": reason}


@pytest.mark.parametrize(
    ("pixels", "found"),
    [
        (np.zeros((10, 12, 3), np.uint8), "8 bits, 3 channels, 12x10 pixels"),
        (np.full((36, 48, 3), 30_000, np.uint16), "16 bits, 3 channels, 48x36 pixels"),
        (np.full((36, 48, 4), 128, np.uint8), "8 bits, 4 channels, 48x36 pixels"),
    ],
    ids=["another size", "16 bits", "alpha"],
)
def test_a_render_that_is_not_as_renders_are_is_refused(rendered, pixels, found):
    views, renders = rendered
    write_bytes(renders / f"{views[3].name}.png", cv2.imencode(".png", pixels)[1].tobytes())
    with pytest.raises(score.UnusableRun) as refused:
        score_views(renders, views, {})
    assert f"found: {found}\n  expected: 8 bits, 3 channels, 48x36 pixels" in str(refused.value)
    assert score.AGAIN in str(refused.value)

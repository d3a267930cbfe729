"""How methods are found: the errors for an unknown name and for a module that fails; what their results must be."""

import sys

import numpy as np
import pytest

from baselines.clean_wrapper import on_clean
from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import METHODS, TrainingSummary, check_render, citation_of, find_method
from hydroviews.cli.plugins import registered
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from leaderboard.evaluate import needed_patterns


def refusal(name: str) -> str:
    with pytest.raises(InputError) as error:
        find_method(name)
    return str(error.value)


class Inherits(GaussianSplatting):
    """A stranger's method on our trainer."""


def test_every_registered_method_states_what_it_follows():
    found = {name: citation_of(name) for name in registered(METHODS)}
    assert [name for name, citation in found.items() if not (citation and citation.title)] == []
    for citation in found.values():
        assert all(address.startswith("https://") for address in (citation.link, citation.code) if address)
        assert citation.paper or citation.link or "this project" in citation.title
    assert citation_of("3dgs+clean") == citation_of("3dgs") == citation_of("3dgs-clean")


def test_a_method_on_our_trainer_is_not_cited_as_ours():
    assert citation_of(f"{__name__}:Inherits") is None


@pytest.mark.parametrize(
    ("modules", "told", "untold"),
    [
        pytest.param(
            {"inner": "def half(x):\n    return 1 / x\n", "board": "from inner import half\nHALF = half(0)\n"},
            [
                "cannot import board:Mine",
                'board.py", line 2',
                'inner.py", line 2',
                "ZeroDivisionError: division by zero",
            ],
            ["importlib", "method.py"],
            id="an error in one's own modules",
        ),
        pytest.param({"board": "fine = 1\nx = = 2\n"}, ['board.py", line 2', "SyntaxError"], [], id="in the grammar"),
        pytest.param({}, ["cannot import"], ["Traceback"], id="no module"),
        pytest.param({"board": ""}, ["cannot import"], ["Traceback"], id="no class"),
        pytest.param(
            {"board": "from pathlib import Path\nclass Mean: ...\nclass _Base: ...\ndef helper(): ...\n"},
            ["expected: one of Mean, helper"],
            ["Path", "_Base"],
            id="another class",
        ),
    ],
)
def test_what_keeps_a_users_method_from_being_imported_is_told(tmp_path, monkeypatch, modules, told, untold):
    monkeypatch.syspath_prepend(str(tmp_path))
    for name, text in modules.items():
        (tmp_path / f"{name}.py").write_text(text)
    try:
        found = refusal("board:Mine").replace(str(tmp_path), "")
    finally:
        for name in ("board", "inner"):
            sys.modules.pop(name, None)
    assert [words for words in told if words not in found] == []
    assert [words for words in untold if words in found] == []


STARTED = "what to do: board:Mean, started from the folder that board.py lies in"


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("board.Mean", "did you mean board:Mean?"),
        ("board.py:Mean", STARTED),
        ("my/board.py:Mean", STARTED),
        ("my/board:Mean", "what to do: board:Mean, started from"),
        ("board.py", "what to do: board:Class, started from"),
        ("deraing-plus", "did you mean deraings-plus?"),
        ("3dgs+claen", "did you mean clean?"),
    ],
)
def test_what_is_nearly_a_name_is_understood(name, told):
    assert told in refusal(name)


GREY = np.full((2, 5, 3), 0.5, np.float32)


def with_value(value: float) -> np.ndarray:
    image = GREY.copy()
    image[0, :3, 1] = value
    return image


@pytest.mark.parametrize(
    ("image", "found"),
    [
        (None, r"rendered NoneType \(\), expected float32 \(2, 5, 3\)"),
        (GREY[:, :4], r"rendered float32 \(2, 4, 3\)"),
        (GREY[..., 0], r"rendered float32 \(2, 5\)"),
        ((255 * GREY).astype(np.uint8), "rendered uint8"),
        (GREY.astype(np.float64), "rendered float64"),
        (GREY.astype(np.complex64), "rendered complex64"),
        (GREY > 0, "rendered bool"),
        (255 * GREY, "rendered above 1 in 10 of 10 pixels"),
        (with_value(-0.1), "rendered below 0 in 3 of 10 pixels"),
        (with_value(np.nan), r"rendered NaN in 3 of 10 pixels, expected finite values in \[0, 1\]"),
        (with_value(np.inf), "rendered infinite in 3, above 1 in 3 of 10 pixels"),
    ],
)
def test_a_render_that_is_not_what_was_promised_is_refused(image, found):
    camera = Camera(5, 2, 4.0, 4.0, 2.5, 1.0, np.eye(4))
    check_render(GREY, camera)
    with pytest.raises(ValueError, match=found):
        check_render(image, camera)


def test_scalars_of_libraries_are_numbers():
    summary = TrainingSummary(np.float32(1.5), np.int64(3), np.array(2.0), "cpu")
    assert summary == TrainingSummary(1.5, 3, 2.0, "cpu")
    assert [type(value) for value in (summary.train_seconds, summary.n_primitives)] == [float, int]
    with pytest.raises(ValueError, match=r"train_seconds is '3' of type str, expected a number"):
        TrainingSummary("3", 3, 2.0, "cpu")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("train_seconds", value) for value in (float("nan"), None, -1.0)),
        *(("n_primitives", value) for value in (2.5, "many")),
        ("model_mb", float("inf")),
        ("device", ""),
        ("used", None),
    ],
)
def test_a_summary_holds_finite_numbers_and_words(field, value):
    fields = {"train_seconds": 1.5, "n_primitives": 0, "model_mb": None, "device": "cpu"}
    TrainingSummary(**fields)
    with pytest.raises(ValueError, match=f"summary: .*{field}|no device"):
        TrainingSummary(**{**fields, field: value})


def test_any_method_may_be_shown_the_clean_views_alone():
    method = find_method("3dgs+clean")
    assert method is on_clean(GaussianSplatting) is find_method("3dgs-clean")
    assert find_method("3dgs-budget-clean") is find_method("3dgs-budget+clean")
    assert issubclass(method, GaussianSplatting)
    assert (method.trains_on, GaussianSplatting.trains_on) == ("clean", "rainy")
    assert needed_patterns("3dgs+clean", ["streak-1", "raindrop-1"]) == ["clean"]

"""How methods are found: the errors for an unknown name and for a module that fails; what their results must be."""

import numpy as np
import pytest

from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import METHODS, TrainingSummary, check_render, citation_of, find_method
from hydroviews.cli.plugins import registered
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Writes modules of a user's that can be imported."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(name: str, text: str) -> str:
        (tmp_path / f"{name}.py").write_text(text)
        return str(tmp_path / f"{name}.py")

    return write


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


def test_an_error_in_ones_own_module_keeps_its_traceback(module):
    inner = module("board_inner", "def half(x):\n    return 1 / x\n")
    outer = module("board_outer", "from board_inner import half\nHALF = half(0)\n")
    told = refusal("board_outer:Mine")
    assert "METHOD=board_outer:Mine: cannot import board_outer:Mine" in told
    assert f'File "{outer}", line 2' in told
    assert f'File "{inner}", line 2' in told
    assert "ZeroDivisionError: division by zero" in told
    assert "importlib" not in told
    assert "method.py" not in told


def test_a_mistake_in_the_grammar_is_shown_where_it_is(module):
    path = module("board_grammar", "fine = 1\nx = = 2\n")
    told = refusal("board_grammar:Mine")
    assert f'File "{path}", line 2' in told
    assert "SyntaxError" in told


def test_a_module_or_class_that_there_is_not_has_no_traceback(module):
    module("board_empty", "")
    for name in ("no.module:Mine", "board_empty:Mine"):
        told = refusal(name)
        assert "cannot import" in told
        assert "Traceback" not in told


def test_a_class_that_there_is_not_names_those_there_are(module):
    module("board_two", "from pathlib import Path\nclass Mean: ...\nclass _Base: ...\ndef helper(): ...\n")
    assert "expected: one of Mean, helper" in refusal("board_two:Meen")


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("board.Mean", "did you mean board:Mean?"),
        ("board.py:Mean", "what to do: board:Mean, started from the folder that board.py lies in"),
        ("my/board.py:Mean", "what to do: board:Mean, started from the folder that board.py lies in"),
        ("my/board:Mean", "what to do: board:Mean, started from"),
        ("board.py", "what to do: board:Class, started from"),
    ],
)
def test_a_dot_or_a_file_in_place_of_a_module_is_understood(name, told):
    assert told in refusal(name)


@pytest.mark.parametrize(("name", "meant"), [("deraing-plus", "deraings-plus"), ("3dgs+claen", "clean")])
def test_a_misspelt_name_suggests_the_nearest(name, meant):
    assert f"did you mean {meant}?" in refusal(name)


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
    "changes",
    [
        {"train_seconds": float("nan")},
        {"train_seconds": None},
        {"train_seconds": -1.0},
        {"n_primitives": 2.5},
        {"n_primitives": "many"},
        {"model_mb": float("inf")},
        {"device": ""},
        {"used": None},
    ],
)
def test_a_summary_holds_finite_numbers_and_words(changes):
    fields = {"train_seconds": 1.5, "n_primitives": 0, "model_mb": None, "device": "cpu"}
    TrainingSummary(**fields)
    with pytest.raises(ValueError, match=f"summary: .*{next(iter(changes))}|no device"):
        TrainingSummary(**{**fields, **changes})

"""How methods are found: the errors for an unknown name and for a module that fails."""

import pytest

from baselines.method import find_method
from hydroviews.errors import InputError


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


@pytest.mark.parametrize(("name", "meant"), [("deraing-plus", "deraings-plus"), ("3dgs+claen", "clean")])
def test_a_misspelt_name_suggests_the_nearest(name, meant):
    assert f"did you mean {meant}?" in refusal(name)


def test_a_name_like_no_other_suggests_nothing():
    assert "did you mean" not in refusal("zzz")

import ast
from functools import cache
from pathlib import Path

import pytest

import hydroviews
from hydroviews.dataset.drawing_code import OURS, SOURCES, _digest_of_ours, drawing_code, python_files, syntax_digest

SOURCE = b'''"""A module."""
# a comment
LIMIT = 3  # pixels


class Drop:
    """A drop."""

    def radius(self, side: float) -> float:
        """In pixels."""
        return f"{side * LIMIT:.2f}" if side else -0.5
'''
GOLDEN = "8d3d2c215042123799c1189255be260b358930ed1c13ca8eab55ceedc5f824dc"  # of Python 3.11


COMMENTS_DOCSTRINGS_AND_LAYOUT = [
    (b"\n", b"\r\n"),
    (b"# a comment", b"# another\n\n"),
    (b"A drop.", b"A drop of water."),
    (b'        """In pixels."""\n', b""),
    (b"(self, side: float)", b"(\n        self,\n        side: float,\n    )"),
]
CODE = [(b"LIMIT = 3", b"LIMIT = 4"), (b"-0.5", b"0.5"), (b"side * LIMIT", b"side + LIMIT"), (b".2f", b".3f")]


@pytest.mark.parametrize(("old", "new"), [*COMMENTS_DOCSTRINGS_AND_LAYOUT, *CODE])
def test_code_alone_counts(old, new):
    assert (syntax_digest(SOURCE.replace(old, new)) != syntax_digest(SOURCE)) == ((old, new) in CODE)


def test_the_digest_of_a_source_is_the_same_on_every_python():
    assert syntax_digest(SOURCE) == GOLDEN


def test_an_edit_anywhere_in_what_draws_is_seen(monkeypatch):
    monkeypatch.setattr("hydroviews.dataset.drawing_code.syntax_digest", cache(syntax_digest))  # most are not edited
    digests = {drawing_code()}
    read = Path.read_bytes
    for edited in ("rain/streaks/recipe.py", "blender/cycles.py", "scene/images.py", "dataset/clean_views.py"):
        with monkeypatch.context() as patch:
            patch.setattr("hydroviews.dataset.drawing_code._digest_of_ours", _digest_of_ours.__wrapped__)
            patch.setattr(Path, "read_bytes", lambda p, e=edited: read(p) + (b"\nX = 1\n" if p == OURS / e else b""))
            digests.add(drawing_code())
    assert len(digests) == 5


# What files that draw import and need not belong to them: errors, messages, files on disk, tables, readers of captures.
HARMLESS = """
    errors files cli.logs cli.plugins cli.processes captures.exif_orientation captures.panoramas dataset.drawing_code
    dataset.statistics files.atomic files.cache files.cached_weights files.full_disk files.known_bytes files.ownership
    files.package_index files.settings_guard files.temporary formats.capture_json formats.photographs formats.read
    formats.writers
"""


def test_whatever_what_draws_imports_draws_too():
    missing = {}
    for path in python_files(SOURCES):
        for module in imported(path):
            name = module.removeprefix("hydroviews").strip(".").replace(".", "/")
            covered = any(f"{name}.py" == s or f"{name}/".startswith(f"{s}/") for s in SOURCES)
            if not covered and module.removeprefix("hydroviews.") not in HARMLESS.split():
                missing.setdefault(module, path)
    assert missing == {}


def imported(path: Path) -> set[str]:
    nodes = list(ast.walk(ast.parse(path.read_text())))
    names = {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module}
    names |= {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return {name for name in names if name.startswith(f"{hydroviews.__name__}.")}

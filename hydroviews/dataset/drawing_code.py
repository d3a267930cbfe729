"""Which code drew a data set: a digest of every source whose code decides pixels.

It is taken of syntax trees: comments, docstrings, layout and line endings do not count, nor where the package is
installed or by which Python it is read. Any other edit does, be it one that leaves pixels as they are, such as a new
name: that is the price for nobody having to remember to raise a number. Versions of libraries
are not part of it, nor are readers of captures: what they read is in the request's fingerprint of the capture.
"""

import ast
import hashlib
import inspect
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import hydroviews
from hydroviews.rain.effect import Effect

VERSION = f"hydroviews {hydroviews.__version__}"  # for people
SOURCES = (  # files and folders below the package
    "blender",
    "captures/sfm",
    "dataset/clean_views.py",
    "dataset/rainy_variant.py",
    "formats/colmap.py",
    "formats/colmap_format.py",
    "formats/geometry.py",
    "rain",
    "scene",
)
OURS = Path(hydroviews.__file__).parent


def drawing_code(effect: Effect | None = None) -> str:
    """The digest, 16 hexadecimal digits.

    Args:
        effect: whose file is added if it is not the package's own; what that file imports is not.
    """
    digest = _digest_of_ours()
    if effect is None or type(effect).__module__.partition(".")[0] == hydroviews.__name__:
        return digest
    source = Path(inspect.getfile(type(effect)))
    return hashlib.sha256(f"{digest}\n{syntax_digest(source.read_bytes())}".encode()).hexdigest()[:16]


@cache
def _digest_of_ours() -> str:
    return sources_digest(SOURCES)


def sources_digest(names: Sequence[str]) -> str:
    """The digest of files and folders below the package, 16 hexadecimal digits."""
    files = python_files(names)
    lines = [f"{path.relative_to(OURS).as_posix()} {syntax_digest(path.read_bytes())}" for path in files]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def python_files(names: Sequence[str]) -> list[Path]:
    """Every source in files and folders below the package, sorted."""
    places = [OURS / name for name in names]
    return sorted(path for place in places for path in (place.rglob("*.py") if place.is_dir() else [place]))


def syntax_digest(source: bytes) -> str:
    """SHA-256 of a file's syntax tree without docstrings."""
    words: list[str] = []
    _write_out(ast.parse(source), words)
    return hashlib.sha256("".join(f"{word}\n" for word in words).encode()).hexdigest()


def _write_out(node: Any, words: list[str]) -> None:
    """Add a tree's words, as `ast.dump` would but that its output differs between versions of Python.

    Every process that builds or runs something waits for this: a generator would hand each word up through all levels.
    """
    if isinstance(node, ast.AST):
        words.append(type(node).__name__)
        for name in node._fields:
            value = _without_docstring(node) if name == "body" else getattr(node, name, None)
            if value is not None and value != []:  # new versions have new fields, which old code leaves empty
                words.append(name)
                _write_out(value, words)
    elif isinstance(node, list):
        words.append(f"[{len(node)}")
        for item in node:
            _write_out(item, words)
    else:
        words.append(repr(node))


def _without_docstring(node: Any) -> Any:
    documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
    return node.body[1:] if documented and ast.get_docstring(node, clean=False) is not None else node.body

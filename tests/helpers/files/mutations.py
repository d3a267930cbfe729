"""Bytes and JSON gone wrong, drawn by hypothesis; and a watch over what reading them touches."""

import re
import resource
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hypothesis import strategies as st

NUMBERS = (b"-1", b"0", b"nan", b"-inf", b"1e308", b"1e-308", b"9" * 20, b"9" * 400, b"2.5", b"true", b"null")
TEXTS = (b"../../secret", b"/etc/passwd", b"\xff\xfe", b"\0", b"\n", b"#", b"[" * 5000, b'"', b"n" * 300, b"\\ud800")
DOUBLES = tuple(struct.pack("<d", value) for value in (float("nan"), float("inf"), -1e308, 1e-308, 0.0, -1.0))
COUNTS = tuple(struct.pack("<Q", value) for value in (0, 1, 2**31, 2**40, 2**63, 2**64 - 1))
TOKENS = (*NUMBERS, *TEXTS, *DOUBLES, *COUNTS)
WORD = re.compile(rb"[^\s,:\[\]{}]+")  # of text: what may be replaced as a whole

MEMORY = 2**30  # bytes that reading a small file may take


@st.composite
def mutated(draw: st.DrawFn, content: bytes) -> bytes:
    """The content with one to three mistakes in it."""
    for _ in range(draw(st.integers(1, 3))):
        content = draw(st.sampled_from((_overwritten, _inserted, _cut, _removed, _doubled, _reworded)))(draw, content)
    return content


def _place(draw: st.DrawFn, content: bytes) -> int:
    return draw(st.integers(0, len(content)))


def _overwritten(draw: st.DrawFn, content: bytes) -> bytes:
    at, token = _place(draw, content), draw(st.one_of(st.sampled_from(TOKENS), st.binary(min_size=1, max_size=4)))
    return content[:at] + token + content[at + len(token) :]


def _inserted(draw: st.DrawFn, content: bytes) -> bytes:
    at = _place(draw, content)
    return content[:at] + draw(st.sampled_from(TOKENS)) + content[at:]


def _cut(draw: st.DrawFn, content: bytes) -> bytes:
    return content[: _place(draw, content)]


def _removed(draw: st.DrawFn, content: bytes) -> bytes:
    at = _place(draw, content)
    return content[:at] + content[at + draw(st.integers(1, 64)) :]


def _doubled(draw: st.DrawFn, content: bytes) -> bytes:
    at, length = _place(draw, content), draw(st.integers(1, 200))
    return content[: at + length] + content[at:]


def _reworded(draw: st.DrawFn, content: bytes) -> bytes:
    words = list(WORD.finditer(content))
    if not words:
        return content
    word = draw(st.sampled_from(words))
    token = draw(st.sampled_from((*NUMBERS, *TEXTS)))
    quoted = b'"' + token + b'"' if word[0].startswith(b'"') and draw(st.booleans()) else token
    return content[: word.start()] + quoted + content[word.end() :]


WORDS = ("", "../../secret.png", "/etc/passwd", "images/0.png", "n" * 300, "OPENCV_FISHEYE", "\ud800")
LARGE = (10**299, -(10**299), 2**64)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.sampled_from(LARGE) | st.floats() | st.sampled_from(WORDS),
    lambda inner: st.lists(inner, max_size=4) | st.fixed_dictionaries({"w": inner}),
    max_leaves=6,
)


@st.composite
def with_odd_value(draw: st.DrawFn, value: object) -> object:
    """A JSON value with another one somewhere in it."""
    if not isinstance(value, dict | list) or not value or draw(st.integers(0, 5)) == 0:
        return draw(json_values)
    key = draw(st.sampled_from(sorted(value) if isinstance(value, dict) else range(len(value))))
    changed = value.copy()
    changed[key] = draw(with_odd_value(value[key]))
    return changed


_watched: list[tuple[str, str]] = []  # folder that may be touched; and the one around it, that may not
_strayed: list[str] = []


def _watch(event: str, arguments: tuple) -> None:
    if not _watched or event not in ("open", "os.listdir", "os.scandir", "os.remove", "os.rename", "os.mkdir"):
        return
    inside, around = _watched[-1]
    path = f"{arguments[0]}/"
    if path.startswith(("/etc/", around)) and not path.startswith(inside):
        _strayed.append(f"{event} {path}")


sys.addaudithook(_watch)


@contextmanager
def guarded(folder: Path) -> Iterator[None]:
    """Fails where a file beside `folder` or in /etc is touched, or more than MEMORY is reserved, before the end."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, before[1]))
    _watched.append((f"{folder}/", f"{folder.parent}/"))
    try:
        yield
    finally:
        _watched.pop()
        resource.setrlimit(resource.RLIMIT_AS, before)
        strayed = [*_strayed]
        _strayed.clear()
    assert not strayed

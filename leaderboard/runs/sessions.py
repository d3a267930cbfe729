"""Every start of a run's training: by which code, on which data, and how long it took before and after the steps."""

import json
import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pydantic
from pydantic import TypeAdapter
from pydantic.dataclasses import dataclass

from baselines.training.loop import timed_loops
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from leaderboard.records import STRICT, VERSIONS_IN_ORDER, Number, code_version, in_words

logger = logging.getLogger(__name__)

SESSIONS = "sessions.json"  # in a run's folder
CONFIG = "config.json"  # the run's settings, beside it


@dataclass(frozen=True, config=STRICT)
class Session:
    """One start of a training."""

    version: str  # of the code
    data_sha256: str
    before_s: Number | None = None  # until the first training step; None where none was taken, or it was killed
    after_s: Number | None = None  # since the last one


_LIST = TypeAdapter(list[Session])


@contextmanager
def training_session(folder: Path) -> Iterator[None]:
    """Around `Method.fit`: notes code and data when it begins, and how long it was not training when it ends."""
    begun = Session(code_version(), read_json(folder / CONFIG)["data_sha256"])
    earlier = read_sessions(folder)
    _write(folder, [*earlier, begun])
    start = time.perf_counter()
    with timed_loops() as loops:
        try:
            yield
        finally:
            if loops:
                before, after = loops[0][0] - start, time.perf_counter() - loops[-1][1]
                ended = Session(begun.version, begun.data_sha256, round(before, 1), round(after, 1))
                _write(folder, [*earlier, ended])


def read_sessions(folder: Path) -> list[Session]:
    """The sessions of a run so far; none, with a warning, where the file is damaged."""
    path = folder / SESSIONS
    if not path.is_file():
        return []
    try:
        return _LIST.validate_json(json.dumps(read_json(path)))
    except InputError as error:
        logger.warning("%s: earlier sessions are not counted: %s", path, str(error).splitlines()[0])
    except pydantic.ValidationError as error:
        logger.warning("%s: earlier sessions are not counted: %s", path, in_words(error))
    return []


def noted(sessions: list[Session]) -> dict[str, Any]:
    """What a record says of all sessions: their number, the versions of the code in order, seconds not in training."""
    versions = [session.version for session in sessions]
    changed = [version for i, version in enumerate(versions) if i == 0 or version != versions[i - 1]]
    return {
        "version": VERSIONS_IN_ORDER.join(changed),
        "sessions": len(sessions),
        "before_s": _total([session.before_s for session in sessions]),
        "after_s": _total([session.after_s for session in sessions]),
    }


def _total(seconds: list[float | None]) -> float | None:
    known = [value for value in seconds if value is not None]
    return round(sum(known), 1) if known else None


def _write(folder: Path, sessions: list[Session]) -> None:
    write_json(folder / SESSIONS, _LIST.dump_python(sessions))

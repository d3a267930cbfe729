"""Published weights of networks, fetched once and kept as safetensors in the cache."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from hydroviews.errors import InputError
from hydroviews.files.locks import BUSY, locked


def cached_weights(
    path: Path, lock: str, fetch: Callable[[Path], Path], convert: Callable[[Path, Path], None]
) -> dict[str, Tensor]:
    """The weights of a file in the cache, which is made first where it is not there yet; one process at a time.

    Args:
        path: of the file.
        lock: name beside it that those share who make the same files.
        fetch: gets a folder, downloads an archive into it and gives its path.
        convert: gets the archive and the cache's folder, and writes `path` there.

    Raises:
        InputError: the archive cannot be fetched or has another hash, or the file is damaged.
    """
    if not path.is_file():
        with locked(path.with_name(lock), BUSY):
            if not path.is_file():  # nobody has fetched it meanwhile
                with tempfile.TemporaryDirectory() as folder:
                    convert(fetch(Path(folder)), path.parent)
    try:
        return load_file(path)
    except SafetensorError as error:
        raise InputError(f"{path}: damaged weights", found=error, fix="remove it and try again") from None

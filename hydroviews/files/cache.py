"""The folder of what is fetched or compiled once for all runs."""

import os
from pathlib import Path

import platformdirs


def cache_folder() -> Path:
    """$HYDROVIEWS_CACHE, or `hydroviews` in the user's cache folder."""
    if explicit := os.environ.get("HYDROVIEWS_CACHE"):
        return Path(explicit)
    return platformdirs.user_cache_path("hydroviews", appauthor=False)

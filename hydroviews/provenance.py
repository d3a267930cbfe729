"""What a capture's folder says of how it was taken: `capture.json`.

A capture taken in rain has {"rain": "captured"} in it. There is no clean ground truth then: its photographs are
the one variant CAPTURED of the built scene, which has no clean views. {"metres_per_unit": 0.25} says how large the
capture is, which rain in space wants to know; both may be left out.
"""

import math
from pathlib import Path
from typing import Any

from hydroviews.errors import InputError
from hydroviews.files import read_json

FILE = "capture.json"
CAPTURED = "captured-0"  # the variant that rain fell on when it was photographed
RAINY = {"rain": "captured"}


def read_provenance(folder: Path) -> dict[str, Any]:
    """The content of a capture's `capture.json`, empty where there is none.

    Raises:
        InputError: it is not a JSON object.
    """
    path = folder / FILE
    if not path.is_file():
        return {}
    content = read_json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: not a capture's description", found=type(content).__name__, expected='{"rain": ...}')
    return content


def captured_rainy(folder: Path) -> bool:
    """Whether it rained when the capture was taken, as its `capture.json` or its being a CAPTURED variant says.

    Raises:
        InputError: see `read_provenance`; or it says something else of the rain than "captured" or "none".
    """
    rain = read_provenance(folder).get("rain", "none")
    if rain not in ("captured", "none"):
        raise InputError(f"{folder / FILE}: unknown rain", found=rain, expected='"captured" or "none"')
    return bool(rain == "captured") or folder.resolve().name == CAPTURED


def metres_per_unit(folder: Path) -> float | None:
    """How many metres a unit of the capture's cameras and points has, as its `capture.json` says; None if it does not.

    Raises:
        InputError: see `read_provenance`; or it says something else than a positive number.
    """
    scale = read_provenance(folder).get("metres_per_unit")
    if scale is None:
        return None
    if isinstance(scale, bool) or not isinstance(scale, int | float) or not (math.isfinite(scale) and scale > 0):
        raise InputError(f"{folder / FILE}: metres_per_unit", found=scale, expected="a number above 0")
    return float(scale)

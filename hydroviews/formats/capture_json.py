"""What a capture's folder says of how it was taken: `capture.json`.

A capture taken in rain has {"rain": "captured"} in it. There is no clean ground truth then: its photographs are
the one variant CAPTURED of the built scene, which has no clean views. Three numbers may help rain to suit the capture:
"metres_per_unit" says how large it is, which rain in space wants to know; "clean_error" how well it is learned from
clean views, which grades depend on: the mean squared error of plain 3DGS on held-out views over the views' mean
squared fine detail; "drops_cost" by which factor sharp drops do more harm to it than predicted (see `rain.severity`).
All may be left out.
"""

import math
from pathlib import Path
from typing import Any

from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json

FILE = "capture.json"
CAPTURED = "captured-0"  # the variant that rain fell on when it was photographed
RAINY = {"rain": "captured"}


def read_capture_json(folder: Path) -> dict[str, Any]:
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
        InputError: see `read_capture_json`; or it says something else of the rain than "captured" or "none".
    """
    rain = read_capture_json(folder).get("rain", "none")
    if rain not in ("captured", "none"):
        raise InputError(f"{folder / FILE}: unknown rain", found=rain, expected='"captured" or "none"')
    return bool(rain == "captured") or folder.resolve().name == CAPTURED


def described_number(folder: Path, name: str) -> float | None:
    """The positive number of that name in a capture's `capture.json`; None if there is none.

    Raises:
        InputError: see `read_capture_json`; or it says something else than a positive number.
    """
    number = read_capture_json(folder).get(name)
    if number is None:
        return None
    if isinstance(number, bool) or not isinstance(number, int | float) or not (math.isfinite(number) and number > 0):
        raise InputError(f"{folder / FILE}: {name}", found=number, expected="a number above 0")
    return float(number)

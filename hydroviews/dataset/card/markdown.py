"""Words for data cards."""

from collections.abc import Mapping, Sequence
from typing import Any

from hydroviews.formats.capture_json import CAPTURED

WORDS = {  # by effect: parameter and how it is said
    "raindrop": {
        "coverage": "large drops over {:.0%} of the picture",
        "radius_median": "of a median radius of {:.3f} picture sides",
        "droplets": "{} droplets between them",
        "rivulets": "rivulets: {}",
        "mist": "mist that hides {:.0%} where it is densest",
        "key_frames": "a film of {} key frames",
        "lens_renderer": "drawn by {}",
    },
    "streak": {
        "n": "noise level n = {:g}",
        "length": "kernel length l = {:g} pixels",
        "angle": "angle theta = {:.1f} degrees, 90 is vertical",
        "width": "thickness w = {:g} pixels",
        "brightness": "encoded brightness {:g}",
    },
    "storm": {
        "rate": "{:.0f} mm/h",
        "density": "{:g} times the drops that Marshall and Palmer counted",
        "drops": "{:,} of them in all",
        "wind_speed": "wind of {:.1f} m/s",
        "exposure": "shutter open {:.4f} s",
        "metres_per_unit": "a unit of the capture is {:.3g} m",
    },
}


def describe_rain(effect: str, parameters: Mapping[str, Any]) -> str:
    """The main parameters of a pattern as a phrase; all of them are in its `pattern.json`."""
    if effect == "captured":
        return "it rained when the photographs were taken"
    words = WORDS.get(effect, {})
    said = [form.format(parameters[name]) for name, form in words.items() if name in parameters]
    return ", ".join(said) or "see its `pattern.json`"


def how_to_open(scene: str, patterns: Sequence[str]) -> str:
    """The closing section: what the folders are for other software, and how to check them."""
    pattern = patterns[0] if patterns else "clean"
    opened = f'open_variant(Path("{scene}"), "{pattern}")' if patterns else f'open_clean(Path("{scene}"))'
    name = opened.partition("(")[0]
    added = " Clean views are in `clean`, what rain added in each variant's `layers`." if pattern != CAPTURED else ""
    return f"""## Open and check

Every variant, such as `{scene}/{pattern}`, is a COLMAP project (`images`, `sparse/0`, PINHOLE cameras) and a nerfstudio
one (`transforms.json`).{added} In Python:

```
from pathlib import Path
from hydroviews.dataset.variants import {name}
scene = {opened}
```

`python -m hydroviews verify DIR`, with the folder that holds `manifest.json`, recomputes every hash and derives rainy
views from clean views, layers and parameters again; `python -m hydroviews sheet DIR` draws contact sheets."""

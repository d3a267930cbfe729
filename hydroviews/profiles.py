"""Three sizes of the same benchmark: as data, so that a record can say which one it belongs to."""

from dataclasses import dataclass

from hydroviews.errors import InputError, unknown_name

LEAST_SIDE = 16  # pixels: smaller pictures have no room for SSIM's window of 11


@dataclass(frozen=True)
class Profile:
    """How large scenes are built and which patterns of each effect."""

    name: str
    long_side: int  # pixels; a capture is never enlarged
    patterns: tuple[int, ...]  # numbers of each effect's patterns: 0 is light, 1 medium, 2 heavy
    embedded_views: int  # of an embedded Blender scene, 4:3 at `long_side`


PROFILES = {
    profile.name: profile
    for profile in (
        Profile("demo", long_side=320, patterns=(1,), embedded_views=40),  # minutes on two cores
        Profile("standard", long_side=800, patterns=(0, 1, 2), embedded_views=60),  # what two cores train in 20 minutes
        Profile("paper", long_side=1600, patterns=(0, 1, 2), embedded_views=200),  # for a GPU
    )
}


def find_profile(name: str) -> Profile:
    """The profile of that name.

    Raises:
        InputError: there is none.
    """
    if name not in PROFILES:
        raise unknown_name(f"PROFILE={name}", name, "profile", PROFILES)
    return PROFILES[name]


def require_long_side(pixels: int | None) -> None:
    """Refuse a size of pictures that nothing can be learned from; None leaves it to the profile.

    Raises:
        InputError: it is too small.
    """
    if pixels is not None and pixels < LEAST_SIDE:
        raise InputError(f"--long-side {pixels}: too small", expected=f"at least {LEAST_SIDE} pixels")


def require_seed(seed: int | None) -> None:
    """Refuse a seed that is none; None leaves it to what is there.

    Raises:
        InputError: it is negative.
    """
    if seed is not None and seed < 0:
        raise InputError(f"--seed {seed}: not a valid seed", expected="a whole number, at least 0")

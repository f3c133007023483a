"""Sound-speed profiles for a range, in feet, from the files that people have."""

from __future__ import annotations

from dataclasses import replace

from trackerlib.acoustics.profile import FEET_PER_METRE, SoundSpeedProfile
from trackerlib.rangefiles.velocity_file import VelocityReading, parse_velocity
from trackerlib.surveyfiles.profile_csv import parse_profile_csv
from trackerlib.textfiles import InputError, decode_lines

LAYOUTS = {
    "VELOCITY.DAT: speeds of layers' middles, ft": "middle",
    "speeds at the depths, ft": "boundary",
    "speeds at the depths, m (depth_m, speed_mps)": "metres",
}


def parse_range_profile(content: bytes, name: str, layout: str = "middle") -> VelocityReading:
    """The profile of a file (or upload) called `name`, in feet.

    layout : one of the values of LAYOUTS
    Raises InputError where it is no profile, and asks for metres where the numbers look like metres.
    """
    if layout == "metres":
        return VelocityReading(in_feet(parse_profile_csv(decode_lines(content, name), name)))
    try:
        return parse_velocity(content, name, layout)
    except InputError as error:
        if "metres per second?" not in str(error):
            raise
        raise InputError(
            f"{error}. Is the file in metres? Then choose the layout in metres and open it again"
        ) from None


def in_feet(profile: SoundSpeedProfile) -> SoundSpeedProfile:
    """A profile in feet, whatever its unit was."""
    if profile.unit == "ft":
        return profile
    return replace(
        profile, depth=profile.depth * FEET_PER_METRE, speed=profile.speed * FEET_PER_METRE, unit="ft"
    )

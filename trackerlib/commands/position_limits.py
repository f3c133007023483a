"""Options that say which of the ship's positions are good enough for a reception."""

from __future__ import annotations

import argparse

from trackerlib.beacon.navigation import PositionLimits
from trackerlib.textfiles import InputError


def add_limits(parser) -> None:
    """The limits of `PositionLimits` as options of a parser or of a group of one."""
    add, defaults = parser.add_argument, PositionLimits()
    add(
        "--greatest-hdop",
        type=float,
        default=defaults.greatest_hdop,
        metavar="H",
        help=f"positions of this or more are refused (default {defaults.greatest_hdop:g})",
    )
    add(
        "--greatest-age-s",
        type=float,
        default=defaults.greatest_age_s,
        metavar="A",
        help=f"from a position to an arrival, either side (default {defaults.greatest_age_s:g})",
    )
    add(
        "--greatest-gap-s",
        type=float,
        metavar="G",
        help="between two positions that is interpolated across (default: twice the age)",
    )


def limits_of(args: argparse.Namespace) -> PositionLimits:
    """The limits told; raises InputError for one that makes no sense."""
    try:
        return PositionLimits(args.greatest_hdop, args.greatest_age_s, args.greatest_gap_s)
    except ValueError as error:
        raise InputError(error) from None

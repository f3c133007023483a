"""A run's merged track and its hand-overs as CSV, for spreadsheets and plots."""

from __future__ import annotations

from trackerlib.timing.run_track import RunTrack


def run_track_csv(run: RunTrack, what: str, simulated: bool) -> str:
    """The merged track: point_count, downrange_ft, crossrange_ft, z_ft, arrays; `what` was done stands above."""
    rows = (
        f"{count},{x:.2f},{y:.2f},{z:.2f},{arrays}\n"
        for count, (x, y, z), arrays in zip(run.point_count, run.track, run.arrays, strict=True)
    )
    return _head(what, simulated) + "point_count,downrange_ft,crossrange_ft,z_ft,arrays\n" + "".join(rows)


def hand_overs_csv(run: RunTrack, what: str, simulated: bool) -> str:
    """The jumps where arrays take over: arrays, pass, first, last, points, and the median gap before and after."""
    rows = (
        f"{one.pair[0]}-{one.pair[1]},{one.pass_number},{one.first},{one.last},{one.points},"
        + ",".join(f"{value:.2f}" for value in (*one.before, *one.after, one.jump_before, one.jump_after))
        + "\n"
        for one in run.hand_overs
    )
    axes = ("downrange", "crossrange", "z")
    columns = ",".join(f"{axis}_{when}_ft" for when in ("before", "after") for axis in axes)
    head = f"pair,pass,first,last,points,{columns},jump_before_ft,jump_after_ft\n"
    return _head(what, simulated) + head + "".join(rows)


def _head(what: str, simulated: bool) -> str:
    return ("# SIMULATED DATA\n" if simulated else "") + f"# {what}\n"

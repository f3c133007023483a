"""A whole run's merged track as CSV, with the table of its hand-overs above it as remarks."""

from __future__ import annotations

import csv
import io

from trackerlib.timing.run_track import RunTrack

COLUMNS = ("point_count", "downrange_ft", "crossrange_ft", "vertical_ft", "arrays")
HAND_OVER_COLUMNS = ("pair", "pass", "first", "last", "points", "jump_before_ft", "jump_after_ft")


def track_csv(run: RunTrack, remarks: tuple[str, ...] = ()) -> str:
    """The track, a point count a row; remarks (what it is made of) and hand-overs stand in lines that begin with #."""
    out = io.StringIO()
    out.writelines(f"# {remark}\n" for remark in remarks)
    out.write("# hand-overs: " + ",".join(HAND_OVER_COLUMNS) + "\n")
    for one in run.hand_overs:
        out.write(
            f"# {one.pair[0]}-{one.pair[1]},{one.pass_number},{one.first},{one.last},{one.points},"
            f"{one.jump_before:.2f},{one.jump_after:.2f}\n"
        )
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    for count, place, arrays in zip(run.point_count, run.track, run.arrays, strict=True):
        table.writerow([int(count), *(f"{value:.2f}" for value in place), int(arrays)])
    return out.getvalue()

"""Any survey file: which layout it is, and its pings."""

from __future__ import annotations

from pathlib import Path

from trackerlib.surveyfiles.pings_csv import read_pings_csv
from trackerlib.surveyfiles.reading import SurveyReading
from trackerlib.surveyfiles.sio_log import is_sio_log, read_sio_log
from trackerlib.surveyfiles.whoi_log import is_whoi_log, read_whoi_log
from trackerlib.textfiles import read_lines

LAYOUTS = ("auto", "csv", "sio", "whoi")


def read_survey(path: str | Path, **options) -> SurveyReading:
    """Pings of a survey file; options as for `parse_survey`. Raises InputError if there are none."""
    return parse_survey(read_lines(path), Path(path).name, **options)


def parse_survey(
    lines: list[str],
    name: str,
    *,
    layout: str = "auto",
    turnaround_s: float | None = None,
    transponder: str | None = None,
    hydrophone_depth_m: float = 0.0,
) -> SurveyReading:
    """Pings of a survey whose lines are already read.

    layout : "auto" looks at the lines
    turnaround_s : delay inside two-way times; None takes the file's own, else 13 ms
    transponder : which one, where a CSV holds several
    """
    if layout == "auto":
        layout = "sio" if is_sio_log(lines) else "whoi" if is_whoi_log(lines) else "csv"
    if layout == "csv":
        return read_pings_csv(lines, name, transponder=transponder, hydrophone_depth_m=hydrophone_depth_m)
    reader = read_sio_log if layout == "sio" else read_whoi_log
    return reader(lines, name, turnaround_s=turnaround_s, hydrophone_depth_m=hydrophone_depth_m)

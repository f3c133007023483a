"""A beacon fix to a file of the kind that its suffix says.

export_fix(fix, "beacon.gpx", pings=pings)
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

from trackerlib.beacon.intervals import Interval
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.settings import FixSettings
from trackerlib.exports.gpx import fix_gpx
from trackerlib.exports.html_report import fix_html
from trackerlib.exports.kml import fix_kml
from trackerlib.exports.netcdf import write_netcdf
from trackerlib.exports.record import FixRecord, Placing
from trackerlib.exports.tables import fix_geojson, pings_csv
from trackerlib.textfiles import InputError


def _write_text(text_of: Callable[[FixRecord], str], record: FixRecord, path: Path) -> None:
    path.write_text(text_of(record), encoding="utf-8", newline="\n")


# By layout: the suffix it goes with, and what writes it. The first layout of a suffix is its default.
LAYOUTS: dict[str, tuple[str, Callable[[FixRecord, Path], None]]] = {
    "gpx-1.1": (".gpx", partial(_write_text, fix_gpx)),
    "gpx-1.0": (".gpx", partial(_write_text, partial(fix_gpx, version="1.0"))),
    "kml": (".kml", partial(_write_text, fix_kml)),
    "geojson": (".geojson", partial(_write_text, fix_geojson)),
    "csv": (".csv", partial(_write_text, pings_csv)),
    "netcdf": (".nc", write_netcdf),
    "html": (".html", partial(_write_text, fix_html)),
}
SUFFIXES = tuple(dict.fromkeys(suffix for suffix, _ in LAYOUTS.values()))


def export_fix(
    fix: BeaconFix,
    path: str | Path,
    layout: str | None = None,
    *,
    pings: Pings | None = None,
    settings: FixSettings | None = None,
    reasons: dict[int, str] | None = None,
    intervals: dict[str, Interval] | None = None,
    placing: Placing | None = None,
) -> None:
    """Writes a fix, refused or not, in the layout that the suffix of `path` says; whole or not at all.

    layout : one of LAYOUTS, where a suffix has several (.gpx is GPX 1.1 unless it is "gpx-1.0")
    pings : what the fix was made from; without them a file has no times
    settings : what the fix was made with, for the HTML report
    reasons : why pings were left out by hand, by their number, for the CSV and the HTML report
    intervals : of `profile_intervals` or `bootstrap_intervals`, for the summary
    placing : where the pings were made of arrivals and positions, for the HTML report
    Raises InputError for a suffix or layout that is not known, or a file that cannot be written.
    """
    path = Path(path)
    write = _writer(path, layout)
    record = FixRecord(fix, pings, settings, reasons or {}, intervals or {}, placing)
    part = path.with_name(path.name + ".part")
    try:
        write(record, part)
        os.replace(part, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    finally:
        part.unlink(missing_ok=True)


def _writer(path: Path, layout: str | None) -> Callable[[FixRecord, Path], None]:
    fitting = {name: write for name, (suffix, write) in LAYOUTS.items() if suffix == path.suffix.lower()}
    if not fitting:
        raise InputError(f"{path.name}: found suffix {path.suffix!r}; wanted {', '.join(SUFFIXES)}")
    if layout is None:
        return next(iter(fitting.values()))
    if layout not in fitting:
        raise InputError(f"{path.name}: layout is {layout!r}; wanted {' or '.join(fitting)}")
    return fitting[layout]

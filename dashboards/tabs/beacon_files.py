"""A fix saved as a file of plotters, globes, spreadsheets and archives."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path

import panel_material_ui as pmui

from dashboards.session import Session
from dashboards.tabs.beacon_intervals import IntervalControls
from dashboards.tabs.tab import choice
from trackerlib.exports.export import LAYOUTS, export_fix
from trackerlib.exports.record import Placing

NAMES = {
    "GPX 1.1 (plotters)": "gpx-1.1",
    "GPX 1.0": "gpx-1.0",
    "KML (globes)": "kml",
    "GeoJSON": "geojson",
    "CSV of the pings": "csv",
    "NetCDF (CF-1.11)": "netcdf",
    "Report (HTML)": "html",
}


class FixFiles:
    """Which layout, and the button that saves it."""

    def __init__(self, session: Session, intervals: IntervalControls):
        self.session, self.intervals = session, intervals
        self.layout = choice("Export as", NAMES, "gpx-1.1")
        self.layout.param.watch(lambda event: self._name(), "value")
        self.button = pmui.FileDownload(
            label="Export the fix", callback=self.file, filename="beacon-fix.gpx", size="small", margin=(6, 8)
        )

    def _name(self) -> None:
        self.button.filename = f"beacon-fix{LAYOUTS[self.layout.value][0]}"

    def file(self) -> io.BytesIO:
        """The fix in the layout chosen, for the browser to save."""
        session = self.session
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / self.button.filename
            if session.fix is not None:
                heard = session.pings.only(slice(0, len(session.fix.number)))
                export_fix(
                    session.fix,
                    path,
                    self.layout.value,
                    pings=heard,
                    settings=session.fix_settings,
                    reasons=session.reasons,
                    intervals=self.intervals.found,
                    placing=self._placing(),
                )
            return io.BytesIO(path.read_bytes() if path.exists() else b"")

    def _placing(self) -> Placing | None:
        """How the arrivals came to have places; None for pings that came with theirs."""
        session = self.session
        if session.placed is None:
            return None
        return Placing(session.placed, session.position_limits, session.antenna_offset_m)

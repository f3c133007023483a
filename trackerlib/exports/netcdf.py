"""A fix and its pings as NetCDF that follows the CF-1.11 conventions (a trajectory of the ship)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

import trackerlib
from trackerlib.exports.record import FixRecord

NO_TIME = -(2**63)
BY_UTC = {
    "standard_name": "time",
    "long_name": "time of the ping, UTC",
    "units": "microseconds since 1970-01-01 00:00:00",
    "calendar": "standard",
    "units_metadata": "leap_seconds: utc",
    "axis": "T",
}
BY_CLOCK = {
    "standard_name": "time",
    "long_name": "time of the ping by the log's own clock",
    "units": "seconds since 1970-01-01 00:00:00",
    "calendar": "standard",
    "units_metadata": "leap_seconds: unknown",
    "comment": "The log names no date; the epoch in the units stands for the zero of its clock.",
    "axis": "T",
}
QUALITY = {"good": 1, "not_evaluated": 2, "questionable": 3, "bad": 4, "missing": 9}


@dataclass(frozen=True, eq=False)
class _Rows:
    """Which pings a file holds, and their times as it holds them."""

    keep: np.ndarray  # (N,)
    complete: bool  # whether each of those has a time and a place
    time: np.ndarray  # (N,)
    time_attributes: dict[str, str]  # empty if no time is known


def write_netcdf(record: FixRecord, path: Path) -> None:
    """Writes a CF-1.11 file: the pings along `obs`, the fix in global attributes `beacon_*`.

    CF wants a time and a place of every point of a trajectory: pings that lack one are left out, and named in the
    comment. Where no ping has both, all are written and the file is no trajectory.
    """
    import netCDF4

    rows = _rows(record)
    with netCDF4.Dataset(path, "w", format="NETCDF4") as dataset:
        dataset.setncatts(_global_attributes(record, rows))
        if rows.complete:
            dataset.featureType = "trajectory"
        dataset.createDimension("obs", int(rows.keep.sum()))
        _frame_of_reference(dataset, record, rows.complete)
        _coordinates(dataset, record, rows)
        _data(dataset, record, rows)


def _rows(record: FixRecord) -> _Rows:
    missing = np.isnat(record.utc)
    timed, time = ~missing, np.where(missing, NO_TIME, record.utc.astype("datetime64[us]").astype(np.int64))
    attributes = BY_UTC
    if missing.any() and np.isfinite(record.clock_s).any():
        timed, time, attributes = np.isfinite(record.clock_s), record.clock_s, BY_CLOCK
    complete = timed & record.placed
    keep = complete if complete.any() else np.ones(len(complete), bool)
    return _Rows(keep, bool(complete.any()), time, attributes if timed.any() else {})


def quality_flags(record: FixRecord) -> np.ndarray:
    """Quality (N,) of the pings by `QUALITY`: good if the fix rests on it, bad if it was left out."""
    used = QUALITY["good"] if record.fix.residual_s is not None else QUALITY["not_evaluated"]
    flags = np.where(record.fix.used, used, QUALITY["bad"])
    heard = np.isfinite(record.travel_time_s) if record.pings is not None else True
    return np.where(record.placed & heard, flags, QUALITY["missing"]).astype(np.int8)


def _global_attributes(record: FixRecord, rows: _Rows) -> dict:
    left_out = record.fix.number[~rows.keep]
    attributes: dict = {
        "Conventions": "CF-1.11, ACDD-1.3",
        "title": record.title,
        "summary": "\n".join(record.summary),
        "keywords": "underwater acoustic beacon, one-way travel time, position fix",
        "institution": "not stated",
        "source": "simulated acoustic survey" if record.fix.simulated else "acoustic survey from a ship",
        "history": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} written by trackerlib {trackerlib.__version__}",
        "references": "Wojcik (1993), chapter II",
        "comment": "\n".join(record.summary),
    }
    if len(left_out):
        attributes["comment"] += (
            f"\nNot in this file, without a time or a place: pings {', '.join(map(str, left_out))}"
        )
    if record.beacon is not None:
        attributes["beacon_lat_deg"] = record.beacon.lat_deg
        attributes["beacon_lon_deg"] = record.beacon.lon_deg
    for name, value in record.properties.items():
        if isinstance(value, dict | list):
            value = json.dumps(value)
        elif isinstance(value, bool):
            value = str(value).lower()
        if value is not None:
            attributes[f"beacon_{name}"] = value
    for name, time in zip(("start", "end"), record.survey_times, strict=False):
        attributes[f"time_coverage_{name}"] = time
    return attributes


def _frame_of_reference(dataset, record: FixRecord, complete: bool) -> None:
    crs = dataset.createVariable("crs", "i4")
    crs.setncatts(
        {
            "long_name": "WGS 84",
            "grid_mapping_name": "latitude_longitude",
            "longitude_of_prime_meridian": 0.0,
            "semi_major_axis": 6378137.0,
            "inverse_flattening": 298.257223563,
        }
    )
    if complete:
        name = record.named("ship")
        dataset.createDimension("name_length", len(name))
        trajectory = dataset.createVariable("trajectory", "S1", ("name_length",))
        trajectory.setncatts({"cf_role": "trajectory_id", "long_name": "name of the trajectory"})
        trajectory[:] = np.array(list(name), dtype="S1")


def _coordinates(dataset, record: FixRecord, rows: _Rows) -> None:
    lat, lon, depth = record.ship
    if rows.time_attributes:
        whole = rows.time.dtype == np.int64
        nothing = None if rows.complete else NO_TIME if whole else np.nan
        time = dataset.createVariable("time", "i8" if whole else "f8", ("obs",), fill_value=nothing)
        time.setncatts(rows.time_attributes)
        time[:] = rows.time[rows.keep]
    for name, axis, values, attributes in (
        ("lat", "Y", lat, {"standard_name": "latitude", "units": "degrees_north"}),
        ("lon", "X", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        ("z", "Z", depth, {"standard_name": "depth", "units": "m", "positive": "down"}),
    ):
        variable = dataset.createVariable(
            name, "f8", ("obs",), fill_value=None if record.placed[rows.keep].all() else np.nan
        )
        variable.setncatts(
            {**attributes, "axis": axis, "long_name": f"{attributes['standard_name']} of the hydrophone"}
        )
        variable[:] = values[rows.keep]


def _data(dataset, record: FixRecord, rows: _Rows) -> None:
    where = {"coordinates": "time lat lon z" if rows.time_attributes else "lat lon z", "grid_mapping": "crs"}
    columns = (
        ("ping_number", "i8", record.fix.number, "1", "number of the ping in the survey"),
        ("travel_time", "f8", record.travel_time_s, "s", "logged one-way time, with an unknown constant"),
        ("residual", "f8", record.residual_ms, "ms", "logged time minus that of the fit"),
    )
    for name, kind, values, units, long_name in columns:
        variable = dataset.createVariable(name, kind, ("obs",), fill_value=np.nan if kind == "f8" else None)
        variable.setncatts(
            {"long_name": long_name, "units": units, "ancillary_variables": "quality", **where}
        )
        variable[:] = values[rows.keep]
    quality = dataset.createVariable("quality", "i1", ("obs",))
    quality.setncatts(
        {
            "standard_name": "quality_flag",
            "long_name": "whether the fix rests on the ping",
            "flag_values": np.array(list(QUALITY.values()), dtype=np.int8),
            "flag_meanings": " ".join(QUALITY),
            **where,
        }
    )
    quality[:] = quality_flags(record)[rows.keep]

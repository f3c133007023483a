"""Pings as CSV with a header: `lat_deg, lon_deg, oneway_s` and optionally `ping, utc, time_s, up_m, transponder`.

Commas, or semicolons with a decimal comma. Lines that begin with # are comments; one that says
"simulated" labels the whole file so.
"""

from __future__ import annotations

import csv
import math

import numpy as np

from trackerlib.surveyfiles.reading import Reception, SurveyReading, build_reading
from trackerlib.textfiles import BadRecord, InputError

NEEDED = ("lat_deg", "lon_deg", "oneway_s")
TIMES = ("utc", "utc_transmit", "utc_receive")


class SeveralTransponders(InputError):
    """A file holds pings of several transponders, and none is chosen."""

    def __init__(self, name: str, names: tuple[str, ...]):
        super().__init__(
            f"{name}: found transponders {', '.join(names)}; choose one (--transponder {names[0]})"
        )
        self.names = names  # in order of appearance


def read_pings_csv(lines: list[str], name: str, *, transponder=None, hydrophone_depth_m=0.0) -> SurveyReading:
    """Pings of a CSV file; of one transponder where a column of that name holds several.

    Raises InputError for a missing column, SeveralTransponders where there are several and none is chosen.
    """
    numbered = [
        (k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")
    ]
    if not numbered:
        raise InputError(f"{name}: the file holds no header and no pings")
    header_line, header = numbered[0]
    delimiter = ";" if header.count(";") > header.count(",") else ","
    columns = [column.strip().lower() for column in next(csv.reader([header], delimiter=delimiter))]
    missing = [column for column in NEEDED if column not in columns]
    if missing:
        raise InputError(
            f"{name}, line {header_line}: found columns {', '.join(columns)[:120]!r}; wanted {', '.join(NEEDED)} "
            f"({', '.join(missing)} missing), or a survey log of the SIO or WHOI kind"
        )
    receptions, transponders, bad = [], [], []
    for number, line in numbered[1:]:
        try:
            cells = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, strict=True))]
            if len(cells) != len(columns):
                raise ValueError(f"found {len(cells)} columns; wanted {len(columns)}, as in the header")
            row = dict(zip(columns, cells, strict=True))
            receptions.append(_reception(row, delimiter == ";", hydrophone_depth_m))
            transponders.append(row.get("transponder", ""))
        except (ValueError, csv.Error) as error:
            bad.append(BadRecord(number, str(error)))
    receptions = _of_one_transponder(receptions, transponders, transponder, name)
    simulated = any("simulated" in line.lower() for line in lines[:20] if line.lstrip().startswith("#"))
    return build_reading(receptions, name, "csv", bad, [], simulated)


def _of_one_transponder(receptions, transponders, wanted, name):
    present = list(dict.fromkeys(filter(None, transponders)))
    if wanted is None:
        if len(present) > 1:
            raise SeveralTransponders(name, tuple(present))
        return receptions
    if wanted not in present:
        raise InputError(f"{name}: found transponders {', '.join(present) or 'none'}; wanted {wanted}")
    return [r for r, transponder in zip(receptions, transponders, strict=True) if transponder == wanted]


def _reception(row: dict[str, str], decimal_comma: bool, hydrophone_depth_m: float) -> Reception:
    def number(column: str, low: float, high: float, unit: str) -> float:
        text = row[column].replace(",", ".") if decimal_comma else row[column]
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise ValueError(f"{column} is {row[column]!r}; wanted {unit} from {low:g} to {high:g}")
        return value

    name = row.get("ping", "")
    if name and not name.lstrip("-").isdigit():
        raise ValueError(f"ping is {name!r}; wanted a whole number")
    return Reception(
        number=int(name) if name else None,
        lat_deg=number("lat_deg", -90, 90, "degrees"),
        lon_deg=(number("lon_deg", -180, 360, "degrees") + 180) % 360 - 180,
        up_m=number("up_m", -12_000, 100, "metres above the surface")
        if row.get("up_m")
        else -hydrophone_depth_m,
        travel_time_s=number("oneway_s", -1e10, 1e10, "seconds"),
        time_s=number("time_s", -1e12, 1e12, "seconds") if row.get("time_s") else math.nan,
        utc=utc_of(next((row[column] for column in TIMES if row.get(column)), "")),
    )


def utc_of(text: str) -> np.datetime64:
    """UTC of ISO 8601, NaT for an empty cell. Raises ValueError with what was found and wanted."""
    if not text:
        return np.datetime64("NaT", "ms")
    try:
        return np.datetime64(text.strip().removesuffix("Z").removesuffix("+00:00").replace(" ", "T"), "ms")
    except ValueError:
        raise ValueError(f"utc is {text!r}; wanted ISO 8601, such as 2018-04-26T05:10:33Z") from None

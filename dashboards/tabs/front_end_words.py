"""The front end's design in words: gains, impedance and noise at the carrier, and where the report slips."""

from __future__ import annotations

from trackerlib.receiver.front_end_design import (
    FrontEnd,
    attenuation_db,
    cable_loss_db,
    decibels,
    dynamic_range_db,
    least_gain_db,
    loading_loss_db,
    noise_by_meter,
    noise_by_oscilloscope,
    required_gain_db,
    resistance_of_noise,
    signal_v,
    source_impedance,
    source_noise_v,
    switched_shunts,
    thermal_noise_v,
)

METER_V, OSCILLOSCOPE_V = 6.8e-3, 35e-3  # of the report's noise measurements (5-30), (5-31)
METER_GAIN, METER_HZ = 19_275, 120.0
SEA_NOISE_V = 89e-9  # sea state 3, Table 5-1
INPUT_OHM = 120e3  # R01
BEACON_W, NEAR_M = 30.0, 100.0
ENVELOPE_HZ = 100.0


def design_words(design: FrontEnd) -> str:
    """All of it, as HTML."""
    return (
        f"<b>At {design.carrier_hz / 1e3:g} kHz</b>{_table(_at_carrier(design))}<b>Slips of the report</b>"
        + _table(_slips(design))
    )


def _at_carrier(design: FrontEnd) -> dict[str, str]:
    hz = design.carrier_hz
    stages = [float(decibels(stage)) for stage in design.stage_gains(hz)]
    source = complex(source_impedance(hz))
    return {
        "stage gains": " + ".join(f"{gain:.1f}" for gain in stages) + " dB",
        "with the couplings": f"{float(design.gain_db(hz)):.1f} dB",
        "source impedance": f"{abs(source):.0f} Ω",
        "its noise, with R01": f"{1e9 * source_noise_v(source, INPUT_OHM):.1f} nV/√Hz "
        f"({1e9 * thermal_noise_v(abs(source)):.1f} if it were a resistance)",
        "lost to a load 20 times as large": f"{loading_loss_db(source, 20 * abs(source)):.3f} dB "
        f"({loading_loss_db(abs(source), 20 * abs(source)):.2f} if it were a resistance)",
        "compressor's span": f"{dynamic_range_db():.0f} dB",
    }


def _slips(design: FrontEnd) -> dict[str, str]:
    """What is printed, and what it is."""
    series, near_v = design.third.series_ohm, signal_v(BEACON_W, NEAR_M)
    meter = noise_by_meter(METER_V, METER_GAIN, METER_HZ)
    oscilloscope = noise_by_oscilloscope(OSCILLOSCOPE_V, METER_GAIN, METER_HZ)
    twelve, thirty = (attenuation_db(series, switched_shunts(series, step)) for step in (12, 30))
    return {
        "cable": f"{cable_loss_db():.1f} dB (left out)".replace("-", "−"),
        "R04": f"{resistance_of_noise(SEA_NOISE_V) / 1e3:.0f} kΩ (printed 560)",
        "gain needed (5-11)": f"{required_gain_db(SEA_NOISE_V, ENVELOPE_HZ):.0f} dB in {ENVELOPE_HZ:.0f} Hz "
        f"(printed {required_gain_db(SEA_NOISE_V):.0f}, of 1 Hz)",
        "least gain (5-12)": f"{least_gain_db(near_v):.1f} dB for {1e3 * near_v:.1f} mV "
        f"(printed {least_gain_db():.0f}, for 10 mV)",
        "noise by meter": f"{1e9 * meter:.1f} nV/√Hz (printed 31)",
        "by oscilloscope": f"{1e9 * oscilloscope:.1f} nV/√Hz (printed 28)",
        "step of 12 dB": f"takes off {twelve:.1f} dB",
        "step of 30 dB": f"takes off {thirty:.1f} dB",
    }


def _table(rows: dict[str, str]) -> str:
    cells = "".join(
        f"<tr><td style='padding-right:8px'>{name}</td><td>{text}</td></tr>" for name, text in rows.items()
    )
    return f"<table>{cells}</table>"

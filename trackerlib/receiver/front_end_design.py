"""Design of the report's analogue front end: source impedance, stage gains, attenuator, noise and its measurement.

Wojcik (1993), (5-13) to (5-31). Frequencies in Hz (a number or an array), resistances in ohm, capacitances in farad,
voltages in volt. Slips of the report are mended here and named where mended.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackerlib.acoustics.ambient_noise import HYDROPHONE_DB
from trackerlib.receiver.front_end import LEAST_V, SATURATION_V

BOLTZMANN = 1.380649e-23  # J/K
ROOM_K = 300.0
AVERAGE_METER = 2 / math.sqrt(
    math.pi
)  # 1.13: an average-responding meter reads Gaussian noise this much too low
PEAK_TO_SIGMA = 6.0  # of an oscilloscope's picture of noise, from its lower edge to its upper one
HYDROPHONE_F = 2.4e-9  # Benthos AQ-4, within 25 %
RHO_C = 1.5e6  # kg/m2s, of sea water
# Shunts of Table 5-2 by step, each named by the decibels it takes off alone: R15, R16, R17, R18.
SWITCHED_DB = {3: (3,), 9: (9,), 12: (3, 9), 18: (18,), 24: (24,), 30: (3, 9, 18, 24)}
EQUAL_STAGES = math.sqrt(math.sqrt(2) - 1)  # 0.644: bandwidth of two equal tuned stages over that of one


def decibels(ratio):
    """Magnitude of a voltage ratio in dB."""
    return 20 * np.log10(np.abs(ratio))


def parallel(*impedances):
    """Impedance of several in parallel."""
    return 1 / sum(1 / impedance for impedance in impedances)


def source_impedance(frequency_hz, cable_ohm=3.331, cable_f=7e-9, hydrophone_f=HYDROPHONE_F):
    """What the preamplifier looks into [complex ohm]: the hydrophone through its cable, (5-13)."""
    w = 2j * np.pi * np.asarray(frequency_hz, float)
    return (1 + w * cable_ohm * hydrophone_f) / (
        w * (w * cable_ohm * hydrophone_f * cable_f + hydrophone_f + cable_f)
    )


def cable_loss_db(cable_f=7e-9, hydrophone_f=HYDROPHONE_F) -> float:
    """By how much the cable lowers signal and sea noise alike; the report leaves these 12 dB out."""
    return float(decibels(hydrophone_f / (hydrophone_f + cable_f)))


def loading_loss_db(source, input_ohm: float) -> float:
    """What a source loses in an input of that resistance [dB].

    The rule of 20 times the source loses 0.42 dB if the source is a resistance, which is the report's "below 0.5"; the
    hydrophone is a capacitance, and loses 0.011.
    """
    return float(-decibels(input_ohm / (input_ohm + source)))


def source_noise_v(source: complex, input_ohm: float, kelvin: float = ROOM_K) -> float:
    """Thermal noise [V per root hertz] of a source with the input resistor R01 across it.

    Only what is resistive makes noise: 0.6 nV, where 1700 ohm of resistance would make 5.2.
    """
    return thermal_noise_v(parallel(source, input_ohm).real, kelvin=kelvin)


def signal_v(source_w: float, range_m: float, hydrophone_db: float = HYDROPHONE_DB) -> float:
    """Open-circuit signal [V rms] of a source that sends that power in all directions, absorption left out.

    The report has about 10 mV for 30 W at 100 m; it is 1.7.
    """
    pascal = math.sqrt(source_w * RHO_C / (4 * math.pi * range_m**2))
    return pascal * 1e6 * 10 ** (hydrophone_db / 20)


def required_gain_db(noise_v: float = 89e-9, bandwidth_hz: float = 1.0, least_v: float = LEAST_V) -> float:
    """Gain that lifts noise [V per root hertz] in a band to the compressor's least voltage, (5-11).

    The report divides volts by volts per root hertz, as if the band were 1 Hz, and has 87 dB; in 100 Hz it is 67.
    """
    return float(decibels(least_v / (noise_v * math.sqrt(bandwidth_hz))))


def least_gain_db(largest_v: float = 10e-3, saturation_v: float = SATURATION_V) -> float:
    """Gain at which the largest signal saturates the compressor, (5-12): 58 dB.

    It rests on the 10 mV that are 1.7 (`signal_v`), for which it is 73.5 dB.
    """
    return float(decibels(saturation_v / largest_v))


def highpass_hz(ohm: float, farad: float) -> float:
    """Corner of a coupling, (5-14); with the two bias resistors in parallel also (5-19)."""
    return 1 / (2 * math.pi * ohm * farad)


def highpass_gain(frequency_hz, corner_hz: float):
    """Complex gain of a coupling with that corner."""
    ratio = 1j * np.asarray(frequency_hz, float) / corner_hz
    return ratio / (1 + ratio)


def thermal_noise_v(ohm: float, bandwidth_hz: float = 1.0, kelvin: float = ROOM_K) -> float:
    """Noise of a resistor [V rms], (5-15)."""
    return math.sqrt(4 * BOLTZMANN * kelvin * ohm * bandwidth_hz)


def resistance_of_noise(volt: float, kelvin: float = ROOM_K) -> float:
    """The resistor whose noise in 1 Hz is `volt`: (5-15) solved.

    For R04 the report finds 560 kohm from 89 nV, which by (5-15) is 478.
    """
    return volt**2 / (4 * BOLTZMANN * kelvin)


def tuned_load(frequency_hz, ohm: float, henry: float, farad: float):
    """Impedance of R, L and C in parallel, (5-17) and (5-21). (5-17) prints (j pi f)^2 where (j 2 pi f)^2 is meant."""
    w = 2j * np.pi * np.asarray(frequency_hz, float)
    return (w / farad) / (w**2 + w / (ohm * farad) + 1 / (henry * farad))


def resonance_hz(henry: float, farad: float) -> float:
    """Resonance of a tuned load, (5-18) and (5-22)."""
    return 1 / (2 * math.pi * math.sqrt(henry * farad))


def first_stage_gain(load, admittance_s=1.5e-3, drain_ohm=12_500.0):
    """Gain of the field-effect transistor into a load, (5-16)."""
    return -admittance_s * parallel(load, drain_ohm)


def second_stage_gain(load, emitter_ohm: float):
    """Gain of the bipolar transistor into a load, (5-20)."""
    return -load / emitter_ohm


@dataclass(frozen=True)
class ThirdStage:
    """Attenuator, coupling and operational amplifier. The report's values are lost; these give its 34 dB."""

    series_ohm: float = 10e3  # R14
    bias_ohm: tuple[float, float] = (2e6, 2e6)  # R19, R20
    coupling_f: float = 1e-7  # C09
    feedback_ohm: float = 500e3  # R21
    input_ohm: float = 10e3  # R22

    def gain(self, frequency_hz, shunt_ohm: float = math.inf):
        """Complex gain with the shunts that are switched in, (5-23). The report drops j in two places."""
        w = 2j * np.pi * np.asarray(frequency_hz, float) * self.coupling_f
        bias, series = parallel(*self.bias_ohm), self.series_ohm
        share = 1.0 if math.isinf(shunt_ohm) else shunt_ohm / (shunt_ohm + series)  # both sides over Rs + R14
        source = series * share
        return -self.feedback_ohm / self.input_ohm * share * w * bias / (1 + w * (source + bias))

    def open_gain(self) -> float:
        """Gain without shunts where the coupling is large, (5-24), and its divider, which the report leaves out."""
        bias = parallel(*self.bias_ohm)
        return -self.feedback_ohm / self.input_ohm * bias / (self.series_ohm + bias)


def attenuation_db(series_ohm: float, shunts_ohm: Sequence[float]) -> float:
    """What the switched shunts take off together. They add as conductances, not as decibels.

    Shunts for 3 and 9 dB give 10.2 dB together, not Table 5-2's 12; all four give 28.0 dB, not 30.
    """
    return 20 * math.log10(1 + series_ohm * sum(1 / shunt for shunt in shunts_ohm))


def shunt_for(series_ohm: float, attenuation: float) -> float:
    """The shunt that takes off that many dB by itself."""
    return series_ohm / (10 ** (attenuation / 20) - 1)


def switched_shunts(series_ohm: float, step_db: int) -> tuple[float, ...]:
    """The shunts R15 to R18 that Table 5-2 switches in for a step; each takes off its own 3, 9, 18 or 24 dB alone."""
    return tuple(shunt_for(series_ohm, alone) for alone in SWITCHED_DB[step_db])


def stage_bandwidth_hz(ohm: float, farad: float) -> float:
    """Bandwidth of one tuned stage whose whole load is `ohm`; two equal ones have EQUAL_STAGES of it."""
    return 1 / (2 * math.pi * ohm * farad)


def compressor_v(
    volt, one_plus_ratio: float = 23.3, kelvin: float = ROOM_K, saturation_v: float = SATURATION_V
):
    """Output of the logarithmic compressor, (5-25) to (5-27): 0 V at saturation, 5 V at 2 mV.

    one_plus_ratio : 1 + R41/R42; the report's text sets it by R42 and R43
    """
    return -one_plus_ratio * kelvin / 11_600 * np.log(np.asarray(volt) / saturation_v)


def dynamic_range_db(saturation_v: float = SATURATION_V, least_v: float = LEAST_V) -> float:
    """Span of the compressor, (5-9), (5-10), (5-28)."""
    return float(decibels(saturation_v / least_v))


def noise_by_meter(reading_v: float, gain: float, bandwidth_hz: float) -> float:
    """Noise at the input [V per root hertz] from an average-responding meter at the output, (5-29).

    (5-30) prints 31 nV for 6.8 mV, 19275 and 120 Hz; by (5-29) it is 36.4.
    """
    return AVERAGE_METER * reading_v / (gain * math.sqrt(bandwidth_hz))


def noise_by_oscilloscope(peak_v: float, gain: float, bandwidth_hz: float) -> float:
    """Noise at the input [V per root hertz] from an oscilloscope's picture, (5-31): six sigma from peak to peak."""
    return peak_v / PEAK_TO_SIGMA / (gain * math.sqrt(bandwidth_hz))


@dataclass(frozen=True)
class FrontEnd:
    """The whole preamplifier, tuned to a carrier. Resistors that the report lost follow from the gains it states."""

    carrier_hz: float = 10_000.0
    bandwidth_hz: float = 120.0  # of both tuned stages together, as measured
    drain_ohm: float = 68.3e3  # R02: 24 dB
    collector_ohm: float = 35.5e3  # R11 over R10 of 1 kohm: 31 dB
    emitter_ohm: float = 1e3
    admittance_s: float = 1.5e-3
    drain_resistance_ohm: float = 12_500.0
    corners_hz: tuple[float, ...] = (
        7368.0,
        3000.0,
        3000.0,
    )  # couplings before, within and after the second stage
    third: ThirdStage = ThirdStage()

    def _load(self, frequency_hz, ohm: float, whole_ohm: float):
        """A load of `ohm`, tuned, whose stage is as wide as it must be with `whole_ohm` in all."""
        farad = EQUAL_STAGES / (2 * math.pi * whole_ohm * self.bandwidth_hz)
        henry = 1 / ((2 * math.pi * self.carrier_hz) ** 2 * farad)
        return tuned_load(frequency_hz, ohm, henry, farad)

    def stage_gains(
        self, frequency_hz, shunt_ohm: float = math.inf
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Complex gain of the three stages, couplings left out."""
        drain = self._load(frequency_hz, self.drain_ohm, parallel(self.drain_ohm, self.drain_resistance_ohm))
        collector = self._load(frequency_hz, self.collector_ohm, self.collector_ohm)
        return (
            first_stage_gain(drain, self.admittance_s, self.drain_resistance_ohm),
            second_stage_gain(collector, self.emitter_ohm),
            self.third.gain(frequency_hz, shunt_ohm),
        )

    def gain_db(self, frequency_hz, shunt_ohm: float = math.inf):
        """Gain from hydrophone to detector. The couplings take 2.6 dB at 10 kHz: why 89 dB was measured as 86."""
        first, second, third = self.stage_gains(frequency_hz, shunt_ohm)
        gain = first * second * third
        for corner in self.corners_hz:
            gain = gain * highpass_gain(frequency_hz, corner)
        return decibels(gain)

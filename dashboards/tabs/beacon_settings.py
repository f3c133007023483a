"""The settings of a fix as widgets; what is turned is an edit that Undo takes back."""

from __future__ import annotations

from dataclasses import fields, replace

import panel_material_ui as pmui

from dashboards.session import Session
from dashboards.tabs.tab import choice, number
from trackerlib.beacon.motion import MOTIONS
from trackerlib.beacon.navigation import PositionLimits
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M, ASSUMED_SHIP_TIME_S, FixSettings
from trackerlib.textfiles import InputError

OPTIONAL = ("sample_interval_ms", "interval_s", "experiments", "spacing", "step")  # may be left empty
WHOLE = ("experiments", "spacing", "step")
MOTION_NAMES = dict(
    zip(("lies still", "sinks or rises", "drifts level", "moves freely"), MOTIONS, strict=True)
)
LIVE = "live"  # beside the methods of FixSettings
ESTIMATORS = {
    "every ping": "all-pings",
    "every ping, one at a time (live)": LIVE,
    "usual weighted least squares": "least-squares",
    "the thesis's experiments": "pairs",
}
SHIP_ERRORS = {
    "not known": "unknown",
    "independent from ping to ping": "white",
    "correlated in time": "correlated",
}
WATER = {"rays through the profile": True, "one mean speed": False}


class FixControls:
    """Widgets for FixSettings and for which estimator is used.

    session : whose settings they show and edit
    """

    def __init__(self, session: Session):
        self.session = session
        self._quiet = False
        self._profile = session.fix_settings.profile
        settings = session.fix_settings
        self.estimator = choice("Estimator", ESTIMATORS, "all-pings")
        self.motion = choice("The beacon", MOTION_NAMES, settings.motion)
        self.ship_errors = choice("Errors of the ship's position", SHIP_ERRORS, "unknown")
        self.gps = optional(
            "Their rms (m)", "", "Standard error of each of east and north; or two numbers: east, north"
        )
        self.correlation = number(
            "Correlation time (s)", ASSUMED_SHIP_TIME_S, "In which their correlation falls by e", start=0.001
        )
        self.water = choice("Sound travels along", WATER, settings.profile is not None)
        self.sound_speed = number(
            "Sound speed (m/s)", settings.sound_speed_mps, "Mean speed of sound, 1500 unless told"
        )
        self.speed_sigma = number(
            "Sigma of the sound speed (m/s)",
            settings.speed_sigma_mps,
            "Standard error of the mean speed: 2, or 0.5 with a profile",
            step=0.1,
            start=0.0,
        )
        self.reject = check("Leave out false returns", True)
        self.emission = check("Emission time known")
        self.fit_speed = check("Estimate the sound speed too")
        self.fit_interval = check("Estimate the interval too")
        self.fit_drift = check("and its drift")
        self.antenna = [
            number(f"Antenna offset's sigma, {way} (m)", 0.0, tip, step=0.1, start=0.0)
            for way, tip in (("level", "Each of forward and starboard"), ("vertical", "Of down"))
        ]
        self._make_rest(settings)
        self.named = {
            "motion": self.motion,
            "sound_speed_mps": self.sound_speed,
            "sound_speed_sigma_mps": self.speed_sigma,
            "max_range_m": self.max_range,
            "max_depth_m": self.max_depth,
            "max_speed_mps": self.max_speed,
            "hydrophone_depth_m": self.hydrophone,
            "emission_known": self.emission,
            "estimate_sound_speed": self.fit_speed,
            "estimate_interval": self.fit_interval,
            "estimate_interval_drift": self.fit_drift,
            "sample_interval_ms": self.sample,
            "interval_s": self.interval,
            "experiments": self.experiments,
            "spacing": self.spacing,
            "step": self.step,
        }
        self._watch()

    def _make_rest(self, settings: FixSettings) -> None:
        self.max_range = number(
            "Greatest range (m)", settings.max_range_m, "Search region, from the ship's mean position"
        )
        self.max_depth = number(
            "Greatest depth (m)", settings.max_depth_m, "Search region, below the sea surface"
        )
        self.max_speed = number(
            "Greatest speed (m/s)", settings.max_speed_mps, "Search region, of a beacon that moves"
        )
        self.hydrophone = number(
            "Hydrophone depth (m)",
            settings.hydrophone_depth_m,
            "For surveys that do not say, used when a file is opened; of arrivals beside positions at any time",
        )
        self.sample = optional(
            "Step of times (ms)",
            "found in the file",
            "Step in which one-way times were logged; empty: found in the file",
        )
        self.interval = optional(
            "Interval of the pinger (s)",
            "times are not folded",
            "Where times are known up to whole intervals only; empty: they are not folded",
        )
        self.experiments = optional("Experiments", "all there are", "Pairs of receptions of the thesis's way")
        self.spacing = optional(
            "Spacing (receptions)", "the thesis's least", "From the first of a pair to the second"
        )
        self.step = optional(
            "Step (receptions)", "as the spacing", "From one pair to the next; empty: chained"
        )

    def _watch(self) -> None:
        for name, widget in self.named.items():
            widget.param.watch(lambda event, name=name: self.set(**{name: event.new}), "value")
        self.estimator.param.watch(lambda event: self._choose_estimator(event.new), "value")
        for widget in (self.ship_errors, self.gps, self.correlation):
            widget.param.watch(lambda event: self._set_ship_errors(), "value")
        for widget in self.antenna:
            widget.param.watch(
                lambda event: self.set(antenna_sigma_m=tuple(one.value for one in self.antenna)), "value"
            )
        self.water.param.watch(lambda event: self.set(profile=self._profile if event.new else None), "value")
        self.reject.param.watch(lambda event: self.set(reject="auto" if event.new else "none"), "value")

    # -- both ways -----------------------------------------------------------------------------

    def show(self) -> None:
        """Makes the widgets say what the session's settings are."""
        settings = self.session.fix_settings
        self._profile = settings.profile or self._profile
        self._quiet = True
        try:
            for name, widget in self.named.items():
                value = getattr(settings, name)
                if name == "sound_speed_sigma_mps":
                    value = settings.speed_sigma_mps
                widget.value = ("" if value is None else f"{value:g}") if name in OPTIONAL else value
            self.estimator.value = LIVE if self.session.live else settings.method
            self._show_ship_errors(settings)
            for widget, sigma in zip(self.antenna, settings.antenna_sigma_m, strict=True):
                widget.value = sigma
            self.water.param.update(value=settings.profile is not None, visible=self._profile is not None)
            self.sound_speed.visible = settings.profile is None
            self.reject.value = settings.reject == "auto"
        finally:
            self._quiet = False

    def _show_ship_errors(self, settings: FixSettings) -> None:
        known, correlated = settings.gps_rms_m is not None, settings.gps_correlation_s is not None
        self.ship_errors.value = "correlated" if correlated else "white" if known else "unknown"
        self.gps.visible, self.correlation.disabled = known, not correlated
        if known:
            axes = settings.gps_axes_m
            self.gps.value = f"{axes[0]:g}" if axes[0] == axes[1] else f"{axes[0]:g}, {axes[1]:g}"
        if correlated:
            self.correlation.value = settings.gps_correlation_s

    def _set_ship_errors(self) -> None:
        if self._quiet:
            return
        model = self.ship_errors.value
        try:
            rms = None if model == "unknown" else one_or_two(self.gps.value)
        except InputError as error:
            self.session.report(error)
            self.show()
            return
        self.set(gps_rms_m=rms, gps_correlation_s=self.correlation.value if model == "correlated" else None)

    def forget_profile(self) -> None:
        """Another survey is open: a profile of the one before is none of its."""
        self._profile = self.session.fix_settings.profile

    def set(self, **changes) -> None:
        """Edits settings; what makes no sense is told in words and changes nothing."""
        if self._quiet:
            return
        try:
            changes = {name: typed(value) if name in OPTIONAL else value for name, value in changes.items()}
            for name in WHOLE:
                if changes.get(name) is not None:
                    changes[name] = int(changes[name])
            self.session.edit(fix_settings=replace(self.session.fix_settings, **changes))
        except (TypeError, ValueError) as error:
            self.session.report(InputError(str(error)))
            self.show()

    def _choose_estimator(self, chosen: str) -> None:
        if self._quiet:
            return
        live = chosen == LIVE
        try:
            settings = replace(self.session.fix_settings, method="all-pings" if live else chosen)
            self.session.edit(live=live, fix_settings=settings)
        except ValueError as error:
            self.session.report(InputError(str(error)))
            self.show()

    def restore_defaults(self) -> None:
        """Every setting as at the start; what was left out by hand stays so."""
        kept = {"profile": self._profile, "left_out": self.session.fix_settings.left_out}
        defaults = {field.name: field.default for field in fields(FixSettings)}
        self.session.edit(
            live=False,
            fix_settings=FixSettings(**(defaults | kept)),
            position_limits=PositionLimits(),
            antenna_offset_m=(0.0, 0.0, 0.0),
        )


def check(label: str, value: bool = False):
    """A small box to tick."""
    return pmui.Checkbox(label=label, value=value, margin=(0, 8))


def one_or_two(text: str) -> float | tuple[float, float]:
    """An error of both axes, or of east and of north; ASSUMED_SHIP_RMS_M where nothing was typed."""
    try:
        parts = [float(part) for part in text.replace(";", ",").split(",") if part.strip()]
    except ValueError:
        parts = [0.0] * 3
    if len(parts) > 2:
        raise InputError(f"found {text!r}; wanted one number, or two: east, north")
    return (parts[0], parts[1]) if len(parts) == 2 else (parts or [ASSUMED_SHIP_RMS_M])[0]


def optional(label: str, empty: str, tip: str):
    """A number that may be left empty."""
    return pmui.TextInput(
        label=label, value="", placeholder=empty, description=tip, size="small", sizing_mode="stretch_width",
        margin=(5, 8),
    )  # fmt: skip


def typed(value):
    """What was typed, as a number where it is text; None where nothing was. Raises ValueError for words."""
    if not isinstance(value, str):
        return value
    try:
        return float(value.replace(",", ".")) if value.strip() else None
    except ValueError:
        raise InputError(f"found {value!r}; wanted a number or nothing") from None

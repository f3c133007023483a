"""Speed of sound against depth with points to drag, and the rays that carry sound from an array to a track."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, PointDrawTool, Range1d
from bokeh.plotting import figure

from dashboards.palette import BEFORE, FIRST_ARRAY, SECOND_ARRAY, SHIP
from dashboards.pictures.legend import legend_entry, style_legend
from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.acoustics.ray_path import ray_path
from trackerlib.acoustics.rays import fit_rays

MOST_RAYS = 16
INKS = (FIRST_ARRAY, SECOND_ARRAY)


class ProfileViews:
    """The profile and the rays through it, over one axis of depth."""

    def __init__(self):
        self.depth = Range1d(1400.0, 0.0)
        self.points = ColumnDataSource({"speed": [], "depth": []}, name="profile")
        self.opened = ColumnDataSource({"speed": [], "depth": []})
        self.rays = ColumnDataSource({"xs": [], "ys": []}, name="rays")
        self.ends = ColumnDataSource({"x": [], "y": [], "mark": [], "ink": []}, name="ends of rays")
        self.profile = self._profile()
        self.paths = self._paths()

    def _figure(self, name: str, across: str, tools: str, **options):
        return figure(
            name=name,
            sizing_mode="stretch_both",
            tools=f"{tools},wheel_zoom,reset,save",
            active_scroll="wheel_zoom",
            x_axis_label=across,
            y_axis_label="depth (ft)",
            y_range=self.depth,
            **options,
        )

    def _profile(self):
        fig = self._figure("profile", "speed of sound (ft/s)", "pan")
        opened = fig.line("speed", "depth", source=self.opened, line_color=BEFORE, line_dash="dotted")
        line = fig.line("speed", "depth", source=self.points, line_color=SHIP, line_width=1.5)
        dots = fig.scatter("speed", "depth", source=self.points, size=7, color=SHIP)
        drag = PointDrawTool(renderers=[dots], add=False, description="drag a point of the profile")
        fig.add_tools(drag)
        fig.toolbar.active_tap = drag
        legend_entry(fig, "profile in use; drag a point", [line, dots], color=SHIP, size=6)
        legend_entry(fig, "as it was opened", [opened], line=True, line_color=BEFORE, line_dash="dotted")
        style_legend(fig)
        fig.legend.location = "bottom_left"
        return fig

    def _paths(self):
        fig = self._figure("ray_paths", "horizontal range from the array (ft)", "pan,box_zoom")
        self._lines = fig.multi_line("xs", "ys", source=self.rays, line_color=FIRST_ARRAY, line_alpha=0.7)
        fig.scatter("x", "y", source=self.ends, size=8, marker="mark", color="ink")
        return fig

    def show_profile(self, profile: SoundSpeedProfile, opened: SoundSpeedProfile | None) -> None:
        """The profile in use, and the one that was opened."""
        self.points.data = {"speed": profile.speed.copy(), "depth": profile.depth.copy()}
        shown = opened if opened is not None else profile
        self.opened.data = {"speed": shown.speed, "depth": shown.depth}

    def show_rays(
        self, profile: SoundSpeedProfile, array_position: np.ndarray, track: np.ndarray, which: int
    ) -> int:
        """Rays from an array to some points of a track (T, 3); how many points no direct ray reaches.

        which : 0 for the first array's colour, 1 for the second's
        """
        away = track - array_position
        level, depth, array_depth = np.hypot(away[:, 0], away[:, 1]), -track[:, 2], -float(array_position[2])
        rays = fit_rays(profile, level, depth, array_depth)
        some = np.unique(np.linspace(0, len(track) - 1, min(len(track), MOST_RAYS)).astype(int))
        drawn = [
            ray_path(profile, float(rays.ray_parameter[k]), array_depth, float(depth[k]))
            for k in some
            if rays.reached[k]
        ]
        self.rays.data = {
            "xs": [along.tolist() for along, _ in drawn], "ys": [down.tolist() for _, down in drawn]
        }  # fmt: skip
        self._lines.glyph.line_color = INKS[which]
        marks = ["triangle", *np.where(rays.reached[some], "circle", "x").tolist()]
        self.ends.data = {
            "x": [0.0, *level[some]],
            "y": [array_depth, *depth[some]],
            "mark": marks,
            "ink": [INKS[which]] + [INKS[which] if reached else BEFORE for reached in rays.reached[some]],
        }
        deepest = max(array_depth, float(profile.depth[-1]), float(depth.max()))
        self.depth.update(start=1.04 * deepest, end=-0.03 * deepest)
        self.depth.update(reset_start=self.depth.start, reset_end=self.depth.end)
        return int(np.sum(~rays.reached))

"""How a recording opens: which views, where, and from where one looks."""

import rerun as rr
import rerun.blueprint as rrb

from orchard.layout import ROW_WEST, TOP, Layout
from orchard.view import palette
from orchard.view.scenery import PLAN_CAMERA, plan_size

TIMELINE = "sim_time"
PIN_RADIUS, PIN_RADIUS_PLAN = 0.7, -5.0  # m in space; below 0: points of the screen

IN_SPACE = ["world/**", "canopy/**", "scans/**", "pins/**", "talk/**"]
UNDER_THE_ROOF = ["world/**", "scans/**", "pins/**", "talk/**", "canopy/wires"]
ON_THE_PLAN = ["world/**", "plan/**", "pins/**", "talk/**", "scans/**"]


def blueprint(layout: Layout) -> rrb.Blueprint:
    """3-D above the plan and the states; figures and events beside them. A high orchard's plan gets a column of its own."""
    high, wide = plan_size(layout)
    pictures = _stacked(layout, wide / high) if high < wide else _beside(layout)
    figures = rrb.Vertical(_bins(), _robots(), _events(), row_shares=[3, 3, 4])
    return rrb.Blueprint(
        rrb.Horizontal(pictures, figures, column_shares=[11, 4]),
        rrb.TimePanel(state=rrb.PanelState.Collapsed, timeline=TIMELINE, playback_speed=4.0),
        rrb.BlueprintPanel(state=rrb.PanelState.Collapsed),
        rrb.SelectionPanel(state=rrb.PanelState.Collapsed),
        auto_views=False,
        auto_layout=False,
    )


def _stacked(layout: Layout, aspect: float) -> rrb.Container:
    below = rrb.Horizontal(_plan(), _states(), column_shares=[1, 1])
    return rrb.Vertical(_spaces(layout), below, row_shares=[13, 10])


def _beside(layout: Layout) -> rrb.Container:
    left = rrb.Vertical(_spaces(layout), _states(), row_shares=[11, 9])
    return rrb.Horizontal(left, _plan(), column_shares=[13, 9])


def _spaces(layout: Layout) -> rrb.Tabs:
    """The orchard from outside; from below its roof; and the first picker's company."""
    south = layout.tree_lines[-1]
    middle = (TOP + south) / 2
    high = south < -60.0
    outside = (
        _eye((52.0, south - 22.0, 24.0), (12.0, south + 22.0, 0.0))
        if high
        else _eye((45.0, south - 12.0, 10.0 + 0.08 * (TOP - south)), (4.0, min(middle, south + 17.0), -3.0))
    )
    inside = _eye((ROW_WEST - 9.0, layout.lanes[-1].y - 1.0, 2.6), (0.0, layout.lanes[-1].y + 6.0, 0.6))
    first = next(start for start in layout.starts if start.kind == "picker").name
    company = _eye((ROW_WEST - 14.0, layout.lanes[0].y - 12.0, 9.0), (ROW_WEST, layout.lanes[0].y, 0.0), follow=f"world/pickers/{first}")
    return rrb.Tabs(
        _space("Orchard", IN_SPACE, outside),
        _space("Under the pergola", UNDER_THE_ROOF, inside),
        _space(f"With {first}", UNDER_THE_ROOF, company),
        active_tab="Orchard",
    )


def _eye(position: tuple[float, float, float], target: tuple[float, float, float], follow: str | None = None) -> rrb.EyeControls3D:
    return rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=position, look_target=target, eye_up=(0, 0, 1), tracking_entity=follow)


def _space(name: str, contents: list[str], eye: rrb.EyeControls3D) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        name=name,
        origin="/",
        contents=contents,
        background=rrb.Background(kind="SolidColor", color=palette.SKY),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=eye,
        defaults=[rr.Points3D.from_fields(radii=[PIN_RADIUS], show_labels=False)],
    )


def _plan() -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        name="Plan",
        origin=PLAN_CAMERA,
        contents=ON_THE_PLAN,
        background=palette.MEADOW,
        defaults=[rr.Points3D.from_fields(radii=[PIN_RADIUS_PLAN], show_labels=True)],
    )


def _states() -> rrb.StateTimelineView:
    return rrb.StateTimelineView(name="What the robots do", origin="world", contents=["world/pickers/**", "world/carriers/**", "world/tractors/**"])


def _bins() -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(name="Bins", origin="metrics/bins", plot_legend=rrb.Corner2D.LeftTop)


def _robots() -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(name="Robots", origin="metrics/robots", plot_legend=rrb.Corner2D.LeftTop)


def _events() -> rrb.TextLogView:
    levels = rrb.TextLogRows(filter_by_log_level=["INFO", "WARN", "ERROR"])
    return rrb.TextLogView(name="Events", origin="events", rows=levels, columns=rrb.TextLogColumns(text_log_columns=["Body"]))

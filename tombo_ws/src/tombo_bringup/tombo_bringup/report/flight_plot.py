"""The still figure of a flight, marked like the paper's figure of the recovery."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from tombo_bringup.report import style
from tombo_bringup.report.story import (
    FRONT_LEFT,
    ROTOR_NAMES,
    FlightStory,
    Verdict,
    roll_pitch_yaw_deg,
    tell,
)

if TYPE_CHECKING:
    from tombo_bringup.flight_record import FlightRecord

Array = NDArray[np.float64]

SIZE_IN: Final = (12.0, 8.0)
DPI: Final = 150
BEFORE_S: Final = 2.0
AFTER_S: Final = 6.0
UPRIGHT_DEG: Final = float(np.degrees(0.17))
"""Tilt that ends the unstable phase."""

RC: Final[dict[str, Any]] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "text.color": style.INK,
    "axes.edgecolor": style.MUTED,
    "axes.labelcolor": style.INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": style.FAINT,
    "grid.linewidth": 0.5,
    "xtick.color": style.MUTED,
    "ytick.color": style.MUTED,
    "xtick.labelcolor": style.INK,
    "ytick.labelcolor": style.INK,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "lines.linewidth": 1.3,
    "lines.solid_joinstyle": "round",
    "hatch.linewidth": 0.5,
    "mathtext.fontset": "dejavusans",
    "legend.frameon": False,
    "legend.fontsize": 7.8,
    "figure.facecolor": style.PAPER,
    "savefig.facecolor": style.PAPER,
}

_ROWS: Final = ("timeline", "horizontal", "height", "attitude", "thrust")
_HEIGHTS: Final = (0.95, 2.0, 2.0, 2.0, 2.0)
_VERDICT_COLOURS: Final = {
    Verdict.RECOVERED: style.GREEN,
    Verdict.CRASHED: style.VERMILLION,
    Verdict.NO_CONTACT: style.MUTED,
    Verdict.NOT_SETTLED: "#B07A00",
}


@dataclass(frozen=True)
class _Window:
    """A column of the figure: its stretch of time and how many points a line may have."""

    start_s: float
    end_s: float
    buckets: int
    zero_s: float
    zoomed: bool


def draw_flight(record: FlightRecord) -> Figure:
    """Draw position, attitude, rotor thrust and mode against time.

    The left column shows the whole flight, the right one the seconds around the contact
    (or the crash); with neither there is one wide column. 1800 x 1200 px.
    """
    story = tell(record)
    angles_deg = roll_pitch_yaw_deg(record.log["attitude"])
    with mpl.rc_context(RC):
        figure = Figure(figsize=SIZE_IN, dpi=DPI)
        FigureCanvasAgg(figure)
        _title(figure, story)
        end_s = max(story.duration_s, 1e-3)
        if story.mark_s is None:
            columns = [(_Window(0.0, end_s, 1500, 0.0, False), 0.055, 0.945)]
        else:
            start_s = max(0.0, story.mark_s - BEFORE_S)
            columns = [
                (_Window(0.0, end_s, 700, 0.0, False), 0.055, 0.445),
                (_Window(start_s, story.mark_s + AFTER_S, 900, story.mark_s, True), 0.505, 0.945),
            ]
        for window, left, right in columns:
            _column(figure, record, story, angles_deg, window, left, right)
    return figure


def png_bytes(figure: Figure) -> bytes:
    """The figure as a PNG file, at its own resolution."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def envelope(t: Array, y: Array, buckets: int) -> tuple[Array, Array]:
    """Thin a line to at most 2 * `buckets` points that keep the extremes of every bucket.

    `t` and `y` are (N,); the result has the same first and last sample and is in time order.
    """
    n = len(t)
    if n <= 2 * buckets:
        return t, y
    per = -(-n // buckets)
    padded = np.full(per * -(-n // per), y[-1])
    padded[:n] = y
    rows = padded.reshape(-1, per)
    offsets = np.arange(len(rows)) * per
    picks = np.stack((rows.argmin(axis=1) + offsets, rows.argmax(axis=1) + offsets))
    index = np.unique(np.clip(np.append(picks, (0, n - 1)), 0, n - 1))
    return t[index], y[index]


def _column(
    figure: Figure,
    record: FlightRecord,
    story: FlightStory,
    angles_deg: Array,
    window: _Window,
    left: float,
    right: float,
) -> None:
    top, bottom, gap = 0.905, 0.055, 0.042
    scale = (top - bottom - gap * (len(_ROWS) - 1)) / sum(_HEIGHTS)
    axes: dict[str, Axes] = {}
    ceiling = top
    for row, height in zip(_ROWS, _HEIGHTS, strict=True):
        floor = ceiling - height * scale
        axes[row] = figure.add_axes((left, floor, right - left, ceiling - floor))
        ceiling = floor - gap
    inside = (record.t >= window.start_s) & (record.t <= window.end_s)
    if not inside.any():
        inside[-1:] = True
    first, last = np.flatnonzero(inside)[[0, -1]]
    cut = slice(int(first), int(last) + 1)

    _timeline(axes["timeline"], story, window)
    _horizontal(axes["horizontal"], record, story, window, cut)
    _height(axes["height"], record, story, window, cut)
    _attitude(axes["attitude"], record, angles_deg, window, cut)
    _thrust(axes["thrust"], record, window, cut)
    for row in _ROWS[1:]:
        _shade(axes[row], story, window)
        axes[row].yaxis.set_label_coords(-0.43 / (SIZE_IN[0] * (right - left)), 0.5)
    for row in _ROWS:
        axes[row].set_xlim(window.start_s - window.zero_s, window.end_s - window.zero_s)
        if row != _ROWS[-1]:
            axes[row].tick_params(labelbottom=False)
    if window.zoomed:
        mark = "contact" if story.contact_s is not None else "the crash"
        axes["thrust"].set_xlabel(f"time from {mark} [s]", labelpad=2)
    else:
        axes["thrust"].set_xlabel("time [s]", labelpad=2)


def _title(figure: Figure, story: FlightStory) -> None:
    name = story.name if len(story.name) <= 60 else story.name[:59] + "…"
    figure.text(0.055, 0.965, name, size=14, weight="bold", va="center", parse_math=False)
    details = [f"seed {story.seed}" if story.seed is not None else ""]
    details += [f"Conf. {story.conf} propellers" if story.conf is not None else ""]
    details += [f"{story.duration_s:.1f} s"]
    figure.text(
        0.055, 0.936, "  ·  ".join(d for d in details if d), color=style.MUTED, va="center"
    )
    figures = [
        ("falls", story.fall_m, "m", 2),
        ("unstable", _between(story.contact_s, story.unstable_end_s), "s", 2),
        ("recovered after", _between(story.contact_s, story.recovery_end_s), "s", 2),
    ]
    words = [f"{name} {v:.{digits}f} {unit}" for name, v, unit, digits in figures if v is not None]
    figure.text(0.945, 0.936, "  ·  ".join(words), color=style.MUTED, va="center", ha="right")
    figure.text(
        0.945,
        0.965,
        story.verdict.value.upper(),
        color=_VERDICT_COLOURS[story.verdict],
        size=12,
        weight="bold",
        va="center",
        ha="right",
    )


def _timeline(axes: Axes, story: FlightStory, window: _Window) -> None:
    """The mode strip, and above it (zoomed) the phases and the instants by name."""
    axes.set_ylim(0.0, 3.6)
    axes.set_yticks([])
    axes.grid(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.tick_params(bottom=False)
    axes.set_ylabel("mode", rotation=0, ha="right", va="center", y=0.14)
    axes.yaxis.set_label_coords(-0.012, 0.14)
    length_s = window.end_s - window.start_s
    for span in story.modes:
        start, end = max(span.start_s, window.start_s), min(span.end_s, window.end_s)
        if end <= start:
            continue
        colour = style.MODE_COLOURS.get(span.mode, style.FAINT)
        axes.barh(0.5, end - start, left=start - window.zero_s, height=1.0, color=colour, lw=0)
        if (end - start) / length_s > 0.0135 * len(span.name):
            middle = (start + end) / 2 - window.zero_s
            axes.text(middle, 0.48, span.name, ha="center", va="center", size=7.6)
    if window.zoomed:
        _phases(axes, story, window)
        _instants(axes, story, window)
    elif story.mark_s is not None:
        zoom = max(0.0, story.mark_s - BEFORE_S), min(window.end_s, story.mark_s + AFTER_S)
        axes.plot(zoom, (1.45, 1.45), color=style.INK, lw=1.0, solid_capstyle="butt")
        for edge in zoom:
            axes.plot((edge, edge), (1.25, 1.65), color=style.INK, lw=1.0)
        name = "contact" if story.contact_s is not None else "crash"
        label = f"{name} at {story.mark_s:.2f} s, enlarged on the right"
        late = story.mark_s > 0.55 * window.end_s
        x, side = (zoom[1], "right") if late else (zoom[0], "left")
        axes.text(x, 1.95, label, ha=side, va="bottom", size=7.8)


def _phases(axes: Axes, story: FlightStory, window: _Window) -> None:
    """Brackets for the unstable and the recovery phase, just above the mode strip."""
    ends = (
        (story.contact_s, story.unstable_end_s, "unstable", style.VERMILLION),
        (story.unstable_end_s, story.recovery_end_s, "recovery", style.BLUE),
    )
    for start, end, name, colour in ends:
        if start is None or end is None or end <= start:
            continue
        shown_end = min(end, window.end_s)
        if shown_end <= start:
            continue
        a, b = start - window.zero_s, shown_end - window.zero_s
        axes.plot((a, b), (1.3, 1.3), color=colour, lw=2.2, solid_capstyle="butt")
        wide = (b - a) / (window.end_s - window.start_s) > 0.16
        text = f"{name} {end - start:.2f} s" if wide else f"{end - start:.2f} s"
        axes.text((a + b) / 2, 1.45, text, color=colour, ha="center", va="bottom", size=7.8)


def _instants(axes: Axes, story: FlightStory, window: _Window) -> None:
    """Names of the instants, each on a line of its own so that none can cover another."""
    zero = story.contact_s
    if zero is None:
        return
    axes.plot((0.0, 0.0), (1.1, 3.6), color=style.INK, lw=1.1)
    axes.text(
        -0.06,
        3.3,
        rf"contact, $t_c$ = {zero:.2f} s",
        ha="right",
        va="center",
        weight="bold",
        size=7.8,
    )
    rows = (
        (story.detection_s, "detection", 3.35, style.PURPLE),
        (story.switch_s, "set point to $x_r$", 2.6, style.GREEN),
    )
    for instant, name, level, colour in rows:
        if instant is None or not window.start_s <= instant <= window.end_s:
            continue
        x = instant - zero
        axes.plot((x, x, max(x, 0.0) + 0.16), (1.1, level, level), color=colour, lw=0.9)
        text = f"{name} {1e3 * x:+.0f} ms"
        axes.text(max(x, 0.0) + 0.2, level, text, color=colour, ha="left", va="center", size=7.8)


def _horizontal(
    axes: Axes, record: FlightRecord, story: FlightStory, window: _Window, cut: slice
) -> None:
    log = record.log
    for i, colour in ((1, style.GREEN), (0, style.BLUE)):
        _trace(axes, record.t, log["est_position"][:, i], window, cut, colour, lw=0.5, alpha=0.45)
        _trace(
            axes,
            record.t,
            log["position_setpoint"][:, i],
            window,
            cut,
            style.INK,
            lw=0.8,
            dashed=True,
        )
        _trace(axes, record.t, log["position"][:, i], window, cut, colour, lw=1.7)
    low, high = _limits(log[name][cut, :2] for name in ("position", "position_setpoint"))
    axes.set_ylim(low, high)
    axes.set_ylabel("x, y [m]")
    _place_names(axes, story, window)
    _legend(
        axes,
        window,
        [
            _line(style.BLUE, 1.7, "x east"),
            _line(style.GREEN, 1.7, "y north"),
            _line(style.INK, 0.8, "set point", dashed=True),
            _line(style.MUTED, 0.5, "estimate"),
        ],
    )


def _place_names(axes: Axes, story: FlightStory, window: _Window) -> None:
    """Lines at the x of x_c and of x_r; their names stand right of the zoomed panel."""
    places = [
        (point[0], name)
        for point, name in ((story.x_c_m, "$x_c$"), (story.x_r_m, "$x_r$"))
        if point is not None
    ]
    low, high = axes.get_ylim()
    apart = 0.12 * (high - low)
    labels = [x for x, _ in places]
    if len(places) == 2 and abs(labels[0] - labels[1]) < apart:
        middle, sign = (labels[0] + labels[1]) / 2, 1.0 if labels[0] >= labels[1] else -1.0
        labels = [middle + sign * apart / 2, middle - sign * apart / 2]
    for (x, name), level in zip(places, labels, strict=True):
        axes.axhline(x, color=style.BLUE, lw=0.7, ls=(0, (6, 2, 1, 2)), zorder=1.5)
        if window.zoomed:
            axes.annotate(
                f"{name} {x:.2f}",
                (1.0, level),
                xycoords=("axes fraction", "data"),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                size=7.8,
                color=style.BLUE,
            )


def _height(
    axes: Axes, record: FlightRecord, story: FlightStory, window: _Window, cut: slice
) -> None:
    log = record.log
    colour = style.PURPLE
    _trace(axes, record.t, log["est_position"][:, 2], window, cut, colour, lw=0.5, alpha=0.45)
    _trace(
        axes, record.t, log["position_setpoint"][:, 2], window, cut, style.INK, lw=0.8, dashed=True
    )
    _trace(axes, record.t, log["position"][:, 2], window, cut, colour, lw=1.7)
    low, high = _limits(log[name][cut, 2] for name in ("position", "position_setpoint"))
    axes.set_ylim(low, high + 0.22 * (high - low))
    axes.set_ylabel("height z [m]")
    _legend(
        axes,
        window,
        [
            _line(colour, 1.7, "z up"),
            _line(style.INK, 0.8, "set point", dashed=True),
            _line(style.MUTED, 0.5, "estimate"),
        ],
    )
    if window.zoomed:
        _fall_arrow(axes, story, window)


def _fall_arrow(axes: Axes, story: FlightStory, window: _Window) -> None:
    height, low, when = story.contact_height_m, story.lowest_m, story.lowest_s
    if height is None or low is None or when is None or story.contact_s is None:
        return
    if height - low < 0.02 or when > window.end_s:
        return
    x = when - window.zero_s
    axes.plot((0.0, x), (height, height), color=style.INK, lw=0.7, ls=":")
    axes.annotate(
        "",
        (x, low),
        (x, height),
        arrowprops={
            "arrowstyle": "<->",
            "color": style.INK,
            "lw": 1.0,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )
    axes.annotate(
        f"falling distance {height - low:.2f} m",
        (float(np.clip(x - 0.8, 0.2, AFTER_S - 2.0)), height),
        xytext=(0, 5),
        textcoords="offset points",
        ha="left",
        va="bottom",
        size=7.8,
        weight="bold",
    )


def _attitude(
    axes: Axes, record: FlightRecord, angles_deg: Array, window: _Window, cut: slice
) -> None:
    colours = (style.BLUE, style.ORANGE, style.GREEN)
    for i in (2, 1, 0):
        _trace(axes, record.t, angles_deg[:, i], window, cut, colours[i], lw=1.3)
    for limit in (-UPRIGHT_DEG, UPRIGHT_DEG):
        axes.axhline(limit, color=style.MUTED, lw=0.7, ls=(0, (2, 2)), zorder=1.5)
    low, high = _limits([angles_deg[cut], np.array((-12.0, 12.0))])
    axes.set_ylim(low, high)
    axes.set_ylabel("attitude [°]")
    names = ("roll", "pitch", "yaw")
    handles = [_line(c, 1.3, n) for c, n in zip(colours, names, strict=True)]
    _legend(axes, window, [*handles, _line(style.MUTED, 0.7, "0.17 rad", dashed=True)])


def _thrust(axes: Axes, record: FlightRecord, window: _Window, cut: slice) -> None:
    thrust, fold = record.log["rotor_thrust"], record.log["fold"]
    high = max(1.0, 1.1 * float(np.nanmax(thrust[cut])))
    handles: list[Line2D | Patch] = []
    for i in range(4):
        front_left = i == FRONT_LEFT
        width = 1.7 if front_left else 0.9
        colour = style.ROTOR_COLOURS[i]
        if float(fold[cut, i].max()) > 0.02:
            t, y = envelope(record.t[cut], fold[cut, i], window.buckets)
            axes.fill_between(
                t - window.zero_s, 0.0, y * high, fc=colour, ec="none", alpha=0.22, zorder=0.5
            )
            axes.fill_between(
                t - window.zero_s,
                0.0,
                y * high,
                fc="none",
                ec=colour,
                hatch="//////",
                lw=0.6,
                alpha=0.55,
                zorder=0.6,
            )
        _trace(
            axes,
            record.t,
            thrust[:, i],
            window,
            cut,
            colour,
            lw=width,
            zorder=3 if front_left else 2,
        )
        handles.append(_line(colour, width, ROTOR_NAMES[i]))
    folded = Patch(fc="none", ec=style.FRONT_LEFT, hatch="//////", lw=0.6, alpha=0.7)
    folded.set_label("fold (full height: 1)")
    handles.append(folded)
    axes.set_ylim(0.0, high)
    axes.set_ylabel("rotor thrust [N]")
    order = [FRONT_LEFT, 0, 1, 3, 4]
    _legend(axes, window, [handles[i] for i in order])


def _shade(axes: Axes, story: FlightStory, window: _Window) -> None:
    """Phases as shaded bands, instants as upright lines, over a whole panel."""
    bands = (
        (story.contact_s, story.unstable_end_s, style.UNSTABLE, 0.30),
        (story.unstable_end_s, story.recovery_end_s, style.RECOVERY, 0.25),
    )
    for start, end, colour, alpha in bands:
        if start is not None and end is not None and start < window.end_s:
            a, b = start - window.zero_s, min(end, window.end_s) - window.zero_s
            axes.axvspan(a, b, color=colour, alpha=alpha, lw=0, zorder=0)
    lines = ((story.contact_s, style.INK, 1.1),)
    if window.zoomed:
        lines += (
            (story.detection_s, style.PURPLE, 0.9),
            (story.switch_s, style.GREEN, 0.9),
        )
    for instant, colour, width in lines:
        if instant is not None and window.start_s <= instant <= window.end_s:
            axes.axvline(instant - window.zero_s, color=colour, lw=width, zorder=1.8)
    if story.crash_s is not None and window.start_s <= story.crash_s <= window.end_s:
        axes.axvline(story.crash_s - window.zero_s, color=style.VERMILLION, lw=1.1, ls="--")


def _trace(
    axes: Axes,
    t: Array,
    y: Array,
    window: _Window,
    cut: slice,
    colour: str,
    *,
    lw: float,
    alpha: float = 1.0,
    dashed: bool = False,
    zorder: float = 2.0,
) -> None:
    x, y = envelope(t[cut], y[cut], window.buckets)
    style_name: Any = (0, (4, 2)) if dashed else "-"
    axes.plot(x - window.zero_s, y, color=colour, lw=lw, alpha=alpha, ls=style_name, zorder=zorder)


def _limits(parts: Iterable[Array]) -> tuple[float, float]:
    """Range of all finite values with a margin; never empty."""
    values = np.concatenate([np.asarray(part).ravel() for part in parts])
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    margin = max(0.08 * (high - low), 0.05)
    return low - margin, high + margin


def _line(colour: str, width: float, name: str, *, dashed: bool = False) -> Line2D:
    return Line2D([], [], color=colour, lw=width, ls=(0, (4, 2)) if dashed else "-", label=name)


def _legend(axes: Axes, window: _Window, handles: Sequence[Line2D | Patch]) -> None:
    """One line above the whole-flight panel, outside its data."""
    if window.zoomed:
        return
    axes.legend(
        handles=list(handles),
        loc="lower left",
        bbox_to_anchor=(-0.012, 0.98),
        ncols=len(handles),
        borderpad=0.1,
        handlelength=1.3,
        handletextpad=0.5,
        columnspacing=1.1,
    )


def _between(start_s: float | None, end_s: float | None) -> float | None:
    return None if start_s is None or end_s is None else end_s - start_s

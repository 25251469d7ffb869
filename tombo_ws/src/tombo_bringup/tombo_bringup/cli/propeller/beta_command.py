"""`tombo propeller beta`: the flap angle of a spinning propeller from a film of it."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from tombo_bringup.cli.options import Force, json_option, number_option, option, output_option
from tombo_bringup.cli.result_files import compute_into, results_folder
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import ProgressCallback
    from tombo_flight.process.output_folder import OutputFolder
    from tombo_propeller.flap_video.camera_geometry import BladeSpan, CameraPose
    from tombo_propeller.flap_video.disc import Frames
    from tombo_propeller.flap_video.disc_rim import Rim
    from tombo_propeller.flap_video.measure import FlapMeasurement
    from tombo_propeller.flap_video.video import Video


_HIGHEST_MM = 1e6


def beta(
    film: Annotated[
        Path | None,
        typer.Argument(
            metavar="VIDEO|FOLDER",
            help="Film from above, along the axis: a video, or a folder of pictures.",
            show_default=False,
        ),
    ] = None,
    reference: Annotated[
        Path | None,
        option(
            "--reference VIDEO|FOLDER",
            "The same propeller before the same camera, slow or at rest: gives the scale.",
        ),
    ] = None,
    reference_frames: Annotated[
        str | None, option("--reference-frames A:B", "Such frames of the film itself, A to B - 1.")
    ] = None,
    reference_beta: Annotated[
        float, number_option("--reference-beta DEG", "The flap in the reference.", "-30 to 30 deg")
    ] = 0.0,
    scale: Annotated[
        float | None,
        number_option(
            "--scale PX/MM",
            "Pixels per mm in the plane of the straight blades.",
            "pixels per mm, 0.1 to 1000",
        ),
    ] = None,
    scale_error: Annotated[
        float, number_option("--scale-error %", "Standard deviation of --scale.", "0 to 20 %")
    ] = 0.2,
    marks: Annotated[
        str | None,
        option(
            "--marks X1,Y1,X2,Y2,MM",
            "Two marks in that plane [pixels] and the distance between them.",
        ),
    ] = None,
    camera_height: Annotated[
        float | None,
        number_option(
            "--camera-height MM",
            "Lens to the plane of the straight blades: flapped tips look larger for being "
            "nearer. Without it the camera is taken to be far away.",
            "a height in mm",
        ),
    ] = None,
    camera_height_error: Annotated[
        float, number_option("--camera-height-error %", "Its standard deviation.", "0 to 20 %")
    ] = 1.0,
    from_below: Annotated[
        bool, option("--from-below", "The blades flap away from the camera.")
    ] = False,
    fps: Annotated[
        float | None,
        number_option(
            "--fps X",
            "Frames per second. Default: the video's; pictures 960, the paper's.",
            "frames per second, above 0, below 1e+07",
        ),
    ] = None,
    window: Annotated[
        int,
        number_option(
            "--window N", "Frames combined; the paper takes ten.", "a whole number, 8 to 500", int
        ),
    ] = 10,
    windows: Annotated[
        int,
        number_option(
            "--windows N",
            "At most so many windows, even over the film.",
            "a whole number, 1 or more",
            int,
        ),
    ] = 60,
    tip: Annotated[
        float | None, number_option("--tip-radius MM", "Default: 111.1.", "a radius in mm")
    ] = None,
    nodus: Annotated[
        float | None,
        number_option(
            "--nodus-radius MM", "Outer end of the nodus. Default: 35.", "a radius in mm"
        ),
    ] = None,
    demo: Annotated[bool, option("--demo", "Measure a rendered film of 12 deg instead.")] = False,
    output: Annotated[
        str | None,
        output_option(
            "Folder of the results. Default: runs/beta-FILM, numbered; with --json nothing."
        ),
    ] = None,
    force: Force = False,
    as_json: Annotated[bool, json_option("Print beta.json, and nothing else.")] = False,
) -> None:
    """Measure the flap angle beta of a spinning propeller from above.

    Ten frames are combined, so that the blades fill a disc; its radius against that of the
    straight blades is the angle, with an interval. Small angles hardly change it: they come out
    as "at most". Writes beta.json, beta.csv, beta.png and overlay.png. See docs/beta.md.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from tombo_bringup.cli.tables import show_page
    from tombo_dynamics.propeller import configuration
    from tombo_propeller.flap_video.camera_geometry import BladeSpan, CameraPose
    from tombo_propeller.flap_video.page import BETA_FILES, beta_page, write_beta

    blade = configuration(13).blade
    straight = BladeSpan(
        blade.tip_radius_m if tip is None else tip * 1e-3,
        blade.joint.outer_radius_m if nodus is None else nodus * 1e-3,
    )
    if not -30.0 <= reference_beta <= 30.0:
        raise InputError(f"--reference-beta {reference_beta:g}; accepted: -30 to 30 deg")
    if scale is not None and not (math.isfinite(scale) and math.isfinite(scale_error)):
        raise InputError(f"--scale {scale:g} +- {scale_error:g} %; accepted: finite numbers")
    view = CameraPose(
        math.inf if camera_height is None else _height(camera_height, straight.tip),
        not from_below,
        _share("--camera-height-error", camera_height_error),
    )
    ways = [reference is not None, reference_frames is not None, scale is not None,
            marks is not None]  # fmt: skip
    if demo and (film is not None or any(ways)):
        raise InputError("--demo with a film or a scale; accepted: --demo alone")
    if not demo and film is None:
        raise InputError("no film; accepted: a video, a folder of pictures, or --demo")
    if not demo and sum(ways) != 1:
        raise InputError(
            f"{sum(ways)} sources of the scale; accepted: one of --reference, --reference-frames, "
            "--scale, --marks"
        )

    def run(on_progress: ProgressCallback) -> tuple[FlapMeasurement, list[str]]:
        if demo:
            return _demo(on_progress, window)
        assert film is not None
        return _measured(
            film, fps, window, windows, straight, view, on_progress,
            _ScaleSource(reference, reference_frames, math.radians(reference_beta), scale,
                    _share("--scale-error", scale_error), marks),
        )  # fmt: skip

    def write(
        folder: OutputFolder,
        measured: tuple[FlapMeasurement, list[str]],
        on_progress: ProgressCallback,
    ) -> None:
        on_progress("drawing", 0.99)
        write_beta(folder.staging, measured[0], beta_page(*measured))

    path = results_folder(output, "beta", film.stem if film else "demo", as_json, "film")
    measured, path, written = compute_into(
        path, force, BETA_FILES, run, write, numbered=output is None
    )
    show_page(beta_page(*measured), as_json, None if as_json else path, written)


class _ScaleSource(NamedTuple):
    """Where the scale comes from, as given."""

    reference: Path | None
    frames: str | None
    beta: float
    scale: float | None
    error: float
    marks: str | None


def _measured(
    path: Path,
    fps: float | None,
    window: int,
    windows: int,
    straight: BladeSpan,
    view: CameraPose,
    on_progress: ProgressCallback,
    source: _ScaleSource,
) -> tuple[FlapMeasurement, list[str]]:
    from tombo_propeller.flap_video import measure as m
    from tombo_propeller.flap_video.video import open_video

    film = open_video(path, fps)
    begin = 0
    still = None
    if source.frames is not None:
        first, behind = _range(source.frames)
        with _naming(path, "reference frames"):
            still = _frames(film, first, behind)
        begin = behind if first < window else 0
    elif source.reference is not None:
        if path.exists() and source.reference.exists() and path.samefile(source.reference):
            raise InputError(
                f"--reference '{source.reference}' is the film itself, whose angle is not known; "
                "accepted: another film, or --reference-frames A:B of this one"
            )
        with _naming(source.reference, "reference"):
            other = open_video(source.reference, fps)
            still = _frames(other, 0, min(other.count, 120))
    fixed = None
    if source.scale is not None:
        fixed = m.known_scale(source.scale * 1e3, source.error)
    elif source.marks is not None:
        fixed = m.marked_scale(*_marks(source.marks))

    def scale_of(rim: Rim) -> m.PixelScale:
        if fixed is not None:
            return fixed
        assert still is not None
        with _naming(source.reference or path, "reference"):
            return m.reference_scale(still, source.beta, straight, view, rim)

    with _naming(path):
        spans = m.spans_of(film.count, window, windows, begin)
        measurement = m.measure(film, spans, scale_of, straight, view, on_progress)
    return measurement, list(film.notes)


def _demo(on_progress: ProgressCallback, window: int) -> tuple[FlapMeasurement, list[str]]:
    import numpy as np

    from tombo_propeller.flap_video import measure as m
    from tombo_propeller.flap_video.camera_geometry import BladeSpan, CameraPose
    from tombo_propeller.flap_video.synthetic_video import Scene, SyntheticVideo, reference_scene

    scene = Scene(beta=math.radians(12.0), camera_height=3.0, off_centre=(14.0, -9.0), tilt=0.04)
    straight, view = BladeSpan(scene.tip, scene.nodus), CameraPose(scene.camera_height)
    frames = np.stack(list(SyntheticVideo(reference_scene(scene)).frames(32)))
    film = SyntheticVideo(scene)
    measurement = m.measure(
        film, m.spans_of(4 * window, window, 4),
        lambda rim: m.reference_scale(frames, 0.0, straight, view, rim), straight, view,
        on_progress,
    )  # fmt: skip
    return measurement, ["rendered with a flap of 12 deg, camera at 3 m"]


def _frames(film: Video, first: int, behind: int) -> Frames:
    for _, frames in film.parts([(first, behind)]):
        return frames
    raise InputError(f"no frames {first}:{behind} in '{film.path}', which has {film.count}")


def _range(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*", text)
    if not match or int(match[1]) >= int(match[2]) or int(match[2]) - int(match[1]) > 2000:
        raise InputError(
            f"--reference-frames {text}; accepted: A:B, A below B, 2000 frames at most"
        )
    return int(match[1]), int(match[2])


def _marks(text: str) -> tuple[tuple[float, float], tuple[float, float], float]:
    try:
        x1, y1, x2, y2, mm = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--marks {text}; accepted: X1,Y1,X2,Y2,MM") from None
    return (x1, y1), (x2, y2), mm * 1e-3


def _height(millimetres: float, tip_m: float) -> float:
    """Return a camera's height [m]: nearer than two tip radii, tips are hardly in the picture."""
    least = 2e3 * tip_m
    if not least <= millimetres <= _HIGHEST_MM:
        raise InputError(
            f"--camera-height {millimetres:g}; accepted: in mm, {least:.4g} to {_HIGHEST_MM:g} "
            "(two tip radii are the least)"
        )
    return millimetres * 1e-3


class _NamedError(InputError):
    """An error that says which film it is about."""


@contextmanager
def _naming(film: Path, role: str = "") -> Iterator[None]:
    """Say of an error which film it is about."""
    try:
        yield
    except _NamedError:
        raise
    except InputError as error:
        raise _NamedError(f"{role} '{film}': {error}".lstrip()) from None


def _share(name: str, percent: float) -> float:
    if not 0.0 <= percent < 20.0:
        raise InputError(f"{name} {percent:g} %; accepted: 0 to 20")
    return percent * 1e-2

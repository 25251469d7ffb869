"""Films of a spinning propeller whose flap angle is known: what the measurement is tried on.

Seen by a pinhole camera, every pixel looks at one point of the cone that the flapped wing sweeps.
Which share of the exposure a blade covers that point is an overlap of two arcs, so motion blur is
exact; light gradients, clutter, flicker, defocus, noise and rounding to grey levels follow.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.propeller import configuration
from tombo_dynamics.propeller.blade import shape
from tombo_propeller.flap_video.disc import Frames

Frame = NDArray[np.uint8]
Plane = NDArray[np.float32]

_HUB = 0.012
"""m, radius of the hub, which stands still for the camera."""
_SUPER = 2
"""Points per pixel and direction."""
_TURNED = 8
"""Steps in which a ray's meeting with the cone is found."""


@dataclass(frozen=True)
class Scene:
    """What is filmed, and with what camera. Lengths in m, angles in rad, brightness 0 to 1."""

    beta: float = math.radians(12.0)
    speed: float = 400.0
    """rad/s"""
    fps: float = 960.0
    exposure: float = 0.5
    """Share of the frame interval."""
    width: int = 640
    height: int = 640
    scale: float = 2500.0
    """Pixels per m in the disc of the straight blades."""
    camera_height: float = 8.0
    towards: bool = True
    tilt: float = 0.0
    tilt_direction: float = 0.0
    off_centre: tuple[float, float] = (0.0, 0.0)
    """Of the hub from the middle of the picture, pixels."""
    tip_rounding: float = 0.003
    """m of span within which the tip's chord closes."""
    twist: float = 0.0
    blade_light: float = 0.15
    ground_light: float = 0.65
    gradient: float = 0.2
    clutter: float = 0.1
    arm: bool = True
    flicker: float = 0.0
    """Amplitude of the lamps' brightness at 100 Hz."""
    defocus: float = 0.7
    """Standard deviation of the lens' blur, pixels."""
    noise: float = 0.012
    phase: float = 0.3
    tip: float = 0.1111
    nodus: float = 0.035


class SyntheticVideo:
    """Frames of a scene, one after the other."""

    def __init__(self, scene: Scene, seed: int = 0) -> None:
        self.scene = scene
        self._seed = seed

    def frames(self, count: int) -> Iterator[Frame]:
        """Yield `count` frames, 8 bit grey (height, width)."""
        yield from (self.frame(k) for k in range(count))

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.scene.fps

    @property
    def path(self) -> Path:
        """Name for messages."""
        return Path("rendered")

    def parts(self, spans: list[tuple[int, int]]) -> Iterator[tuple[int, Frames]]:
        """Yield (first frame, frames) of spans [first, behind)."""
        for first, behind in spans:
            yield first, np.stack([self.frame(k) for k in range(first, behind)])

    def frame(self, k: int) -> Frame:
        """Return frame `k`."""
        s = self.scene
        noise = np.random.default_rng([self._seed, 1, k])
        begin = s.phase + s.speed * k / s.fps
        blades = self._covered(begin, s.speed * s.exposure / s.fps)
        light = self._ground * (1.0 - blades) + self._blade * blades
        if s.flicker > 0.0:
            light *= 1.0 + s.flicker * math.sin(2.0 * math.pi * 100.0 * k / s.fps)
        light = cv2.resize(light, (s.width, s.height), interpolation=cv2.INTER_AREA)
        if s.defocus > 0.0:
            light = cv2.GaussianBlur(light, (0, 0), s.defocus)
        shot = np.sqrt(np.maximum(light, 0.0) / 0.65 * 0.7 + 0.3)
        light = light + s.noise * shot * noise.standard_normal(light.shape, dtype=np.float32)
        return np.asarray(np.clip(np.rint(light * 255.0), 0, 255), dtype=np.uint8)

    def _covered(self, begin: float, sweep: float) -> Plane:
        """Return the share of the exposure [0..1] that a blade covers each point."""
        where, half, azimuth = self._swept_points
        covered = np.zeros(self._half_chord.size, np.float32)
        reach = float(half.max()) + 0.5 * sweep
        for blade in (0.0, math.pi):
            middle = math.remainder(begin + 0.5 * sweep + blade, 2.0 * math.pi)
            for turn in (middle - 2.0 * math.pi, middle, middle + 2.0 * math.pi):
                first, last = np.searchsorted(
                    azimuth, np.array([turn - reach, turn + reach], np.float32)
                )
                near = slice(int(first), int(last))
                off = np.abs(azimuth[near] - np.float32(turn))
                if sweep < 1e-9:
                    share = (off < half[near]).astype(np.float32)
                else:
                    upper = np.minimum(off + half[near], np.float32(0.5 * sweep))
                    lower = np.maximum(off - half[near], np.float32(-0.5 * sweep))
                    share = np.maximum(upper - lower, np.float32(0.0)) / np.float32(sweep)
                covered[where[near]] += share
        return np.minimum(covered, 1.0).reshape(self._half_chord.shape)

    @cached_property
    def _swept_points(self) -> tuple[NDArray[np.intp], Plane, Plane]:
        """Indices, half chords and azimuths of the points a blade can cover, by azimuth."""
        where = np.flatnonzero(self._half_chord > 0.0)
        azimuth = self._points[1].ravel()[where]
        order = np.argsort(azimuth)
        return where[order], self._half_chord.ravel()[where[order]], azimuth[order]

    @cached_property
    def _points(self) -> tuple[Plane, Plane]:
        """Span coordinate [m] and azimuth [rad] on the cone of the point that a pixel sees."""
        s = self.scene
        u = (np.arange(s.width * _SUPER) + 0.5) / _SUPER - 0.5
        v = (np.arange(s.height * _SUPER) + 0.5) / _SUPER - 0.5
        x = (u - 0.5 * (s.width - 1)) / (s.scale * s.camera_height)
        y = (v - 0.5 * (s.height - 1)) / (s.scale * s.camera_height)
        ray = np.stack([*np.meshgrid(x, y), np.ones((len(v), len(u)))], axis=-1)
        # The camera looks along +z at the origin of its axis from a height; it is turned about it.
        axis = np.array([math.cos(s.tilt_direction), math.sin(s.tilt_direction), 0.0])
        turn, _ = cv2.Rodrigues(axis * s.tilt)
        ray = ray @ np.asarray(turn).T
        eye = turn @ np.array([0.0, 0.0, -s.camera_height])
        hub = np.array(s.off_centre) / s.scale
        depth = -eye[2]
        ground = eye[:2] + ray[..., :2] * (depth / ray[..., 2:]) - hub
        above = eye[:2] - hub
        sign = 1.0 if s.towards else -1.0
        seen = ground
        for _ in range(_TURNED):
            out = np.linalg.norm(seen, axis=-1, keepdims=True)
            rise = sign * np.maximum(out - s.nodus, 0.0) * math.tan(s.beta)
            seen = ground + (above - ground) * rise / depth
        out = np.linalg.norm(seen, axis=-1)
        span = np.where(out > s.nodus, s.nodus + (out - s.nodus) / math.cos(s.beta), out)
        return span.astype(np.float32), np.arctan2(seen[..., 1], seen[..., 0]).astype(np.float32)

    @cached_property
    def _half_chord(self) -> Plane:
        """Half of the angle that the blade takes up at the point's radius; negative outside."""
        s = self.scene
        span = self._points[0].astype(float)
        blade = configuration(13).blade
        stretch = blade.tip_radius_m / s.tip
        depth, pitch = shape(blade, np.clip(span * stretch, 0.015, 0.110))
        depth = depth / stretch * np.cos(pitch - s.twist) / np.cos(pitch)
        begin = s.tip - s.tip_rounding
        end = np.clip((span - begin) / s.tip_rounding, 0.0, 1.0)
        depth *= np.sqrt(1.0 - end**2)
        out = np.where(span > s.nodus, s.nodus + (span - s.nodus) * math.cos(s.beta), span)
        half = np.arcsin(np.clip(0.5 * depth / np.maximum(out, _HUB), 0.0, 1.0))
        return np.where((span > _HUB) & (span < s.tip), half, -10.0).astype(np.float32)

    @cached_property
    def _lamp(self) -> Plane:
        s = self.scene
        rng = np.random.default_rng([self._seed, 2])
        x = np.linspace(-1.0, 1.0, s.width * _SUPER, dtype=np.float32)[None, :]
        y = np.linspace(-1.0, 1.0, s.height * _SUPER, dtype=np.float32)[:, None]
        way = rng.uniform(0.0, 2.0 * math.pi)
        return np.asarray(1.0 + s.gradient * (math.cos(way) * x + math.sin(way) * y) * 0.7)

    @cached_property
    def _ground(self) -> Plane:
        """What is behind the blades: bench with stains, arm, motor and hub."""
        s = self.scene
        rng = np.random.default_rng([self._seed, 3])
        shape_ = (s.height * _SUPER, s.width * _SUPER)
        light = np.full(shape_, s.ground_light, np.float32)
        for size in (6, 25, 90):
            coarse = rng.standard_normal((size, size)).astype(np.float32)
            light += (
                s.clutter * 0.4 * cv2.resize(coarse, shape_[::-1], interpolation=cv2.INTER_CUBIC)
            )
        middle = [(0.5 * n - 0.5 + o) * _SUPER for n, o in
                  zip((s.width, s.height), s.off_centre, strict=True)]  # fmt: skip
        px = s.scale * _SUPER
        centre = (round(middle[0]), round(middle[1]))
        if s.arm:
            way = rng.uniform(0.0, 2.0 * math.pi)
            far = (round(middle[0] + 2 * max(shape_) * math.cos(way)),
                   round(middle[1] + 2 * max(shape_) * math.sin(way)))  # fmt: skip
            cv2.line(light, centre, far, 0.35, round(0.022 * px))
            cv2.circle(light, centre, round(0.014 * px), 0.25, -1)
        cv2.circle(light, centre, round(_HUB * px), 0.45, -1)
        cv2.circle(light, centre, round(0.004 * px), 0.8, -1)
        return np.asarray(np.clip(light, 0.03, 1.2) * self._lamp, dtype=np.float32)

    @cached_property
    def _blade(self) -> Plane:
        s = self.scene
        along = 1.0 + 0.2 * (self._points[0] / np.float32(s.tip) - 0.6)
        return np.asarray(s.blade_light * along * self._lamp, dtype=np.float32)


def reference_scene(scene: Scene, speed: float = 80.0) -> Scene:
    """Return the scene with straight blades at a low speed [rad/s], as a reference."""
    return replace(scene, beta=0.0, twist=0.0, speed=speed)

"""Where things are on a picture: the camera and the pixels around it, the same from first to last."""

from dataclasses import dataclass
from typing import Any

import numpy as np

SCENE = (1720, 1000)  # largest width and height of the metal [px]
MARGIN = 40
HEADER, FOOTER = 78, 150
NARROWEST = 1240  # so that the key fits
ELEVATION = np.radians(30.0)  # of the camera over a 3-D scene


@dataclass(frozen=True)
class Frame:
    """A parallel projection: ``right`` and ``up`` are unit vectors of the picture, ``scale`` is in px/m."""

    window: tuple[int, int]  # [px]
    scale: float
    centre: np.ndarray  # the point in the middle of the window [m], shape [3]
    right: np.ndarray
    up: np.ndarray

    @property
    def solid(self) -> bool:
        """Whether the scene is 3-D, with z as its height; in a 2-D one that is y."""
        return bool(self.up[2] > 0.0)

    @property
    def towards(self) -> np.ndarray:
        """Unit vector from the scene to the camera."""
        return np.cross(self.right, self.up)

    def aim(self, plotter: Any, distance: float) -> None:
        """Point the camera of ``plotter`` from ``distance`` [m] away."""
        camera = plotter.camera
        camera.parallel_projection = True
        camera.focal_point = tuple(self.centre)
        camera.position = tuple(self.centre + distance * self.towards)
        camera.up = tuple(self.up)
        camera.parallel_scale = 0.5 * self.window[1] / self.scale
        camera.clipping_range = (0.01 * distance, 10.0 * distance)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Where ``points`` [m], shape [n, 3], are in the window: [px] from its lower left, shape [n, 2]."""
        gap = points - self.centre
        flat = np.stack([gap @ self.right, gap @ self.up], axis=1)
        return flat * self.scale + 0.5 * np.array(self.window)


def frame(points: np.ndarray, margin: float, elevation: float = ELEVATION) -> Frame:
    """The frame that shows ``points`` [m], shape [n, dimension], and ``margin`` [m] round them, tightly.

    In 3-D the camera stands in front (at negative y), ``elevation`` above the horizon [rad].
    """
    right, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    else:
        up = np.array([0.0, np.sin(elevation), np.cos(elevation)])
    towards = np.cross(right, up)
    seen = points @ np.stack([right, up, towards], axis=1)
    low, high = seen.min(axis=0), seen.max(axis=0)
    wide, tall = high[:2] - low[:2] + 2 * margin
    scale = min(SCENE[0] / wide, SCENE[1] / tall)
    window = (_even(max(NARROWEST, wide * scale + 2 * MARGIN)), _even(tall * scale + HEADER + FOOTER))
    middle = 0.5 * (low + high) + [0.0, 0.5 * (HEADER - FOOTER) / scale, 0.0]
    return Frame(window, scale, middle @ np.stack([right, up, towards]), right, up)


def corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The corners of a box between two of them [m], shape [2^dimension, dimension]."""
    return np.stack([axis.ravel() for axis in np.meshgrid(*np.stack([low, high], axis=1))], axis=1)


def _even(pixels: float) -> int:
    """A whole even number: movie encoders want one."""
    return 2 * round(0.5 * pixels)

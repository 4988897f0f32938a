"""The C++ versions of some passes: compiled, given the arrays of a simulation, and compared with Taichi's results.

Both sides read the same lists and the same fields; the results of C++ go to arrays of its own.
"""

import ctypes
import functools
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_slm.backend import ti
from taichi_slm.physics.continuity import PACKING_BRACKET
from taichi_slm.physics.marangoni import SINGULAR
from taichi_slm.physics.shifting import AT_SURFACE, LARGEST
from taichi_slm.run.simulation import Simulation
from taichi_slm.sph.lattice import isotropic_softening, viscous_moment

FLAGS = ("-O3", "-march=native", "-ffast-math", "-std=c++17", "-shared", "-fPIC")
# operations for a neighbour in peer.cpp; a root, a division or a choice counts as one, what the loop repeats as none
OPERATIONS = {"momentum": 54, "continuity": 41, "colour": 18, "forces": 58, "conduction": 5}
ABOUT = (
    f"Plain scalar loops (taichi_slm/benchmark/peer.cpp), g++ {' '.join(FLAGS[:3])}; the kernels have fast math too. "
    "To launch is the time of the same kernel over no rows, which is part of the pass: 636 rows are soon done. The "
    "largest difference is that of any result of the pass, over the largest value of that result. The limit of "
    "this machine is the time of the operations alone ("
    + ", ".join(f"{name} {count}" for name, count in OPERATIONS.items())
    + " for a neighbour), were all of them multiply-adds in full vectors, whose rate was measured between the passes: "
    "no reading of neighbours, no roots, no divisions. Conduction reads V F of every neighbour in both languages, as "
    "it was found before the first stage of a heat step. Unfused is the same step as it is written before anybody "
    "fuses its sums: Shepard, divergence, diffusion, background, forces and order (shift, surface force) in a loop of "
    "its own each, colour and surface forces as above, conduction with its own V F; the difference of that row is that "
    "from fused C++."
)
SOURCE = Path(__file__).with_name("peer.cpp")
_CONSTANTS = (
    "h", "alpha", "h_surface", "alpha_surface", "moment", "softening", "viscous_scale", "gravity", "sound_speed",
    "delta", "packing", "shifting", "dt", "normal_cut", "singular", "table_scale",
)  # fmt: skip
_SIZES = (
    "mobile",
    "hot",
    "near_surface_count",
    "surface_mobile",
    "near_width",
    "slopes_width",
    "far_width",
    "intervals",
)
_LISTS = ("rows", "hot_rows", "near_surface", "near_count", "near", "far_count", "far", "mobility")
_FIELDS = (
    "position", "velocity", "density", "reference_density", "volume", "pressure", "viscosity", "background",
    "tangential_force", "normal", "colour_strength", "kirchhoff", "conduction_factor", "temperature",
    "liquid_fraction", "surface_tension", "surface_tension_slope",
)  # fmt: skip
_TABLES = ("flat_shepard", "flat_depth")
_SLOPES = "slopes"
_RESULTS = {  # name in C++ -> field of Taichi
    "acceleration": "acceleration", "surface_force": "surface_force", "shift": "shift", "density_after": "density",
    "density_rate": "density_rate", "shepard": "shepard", "background_mean": "background_mean",
    "colour_strength_found": "colour_strength", "normal_found": "normal",
    "curvature": "curvature", "tangential_found": "tangential_force", "capillary": "capillary",
    "at_surface": "at_surface", "heating": "heating",
}  # fmt: skip
_PASSES = {
    "momentum": ("acceleration", "surface_force", "shift", "density_after"),
    "continuity": ("density_rate", "shepard", "background_mean"),
    "colour": ("colour_strength_found", "normal_found"),
    "forces": ("curvature", "tangential_found", "capillary", "at_surface"),
    "conduction": ("heating",),
}
_OVER_BOTH = ("colour", "forces")  # lists


def missing() -> str:
    """What is not there to compile C++ with, as a sentence; empty if all is."""
    return "" if shutil.which("g++") else "no C++ compiler (g++) on this machine"


@functools.lru_cache(maxsize=2)
def _library(precision: str) -> ctypes.CDLL:
    real = {"f64": "double", "f32": "float"}[precision]
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "peer.so"
        subprocess.run(["g++", *FLAGS, f"-DREAL={real}", str(SOURCE), "-o", str(target)], check=True)
        return ctypes.CDLL(str(target))  # stays loaded when the file is gone


@functools.lru_cache(maxsize=2)
def _structure(precision: str) -> Any:
    real = ctypes.c_double if precision == "f64" else ctypes.c_float
    pointers = (*_LISTS, *_FIELDS, *_TABLES, _SLOPES, *_RESULTS)

    class Scene(ctypes.Structure):
        """Mirror of `struct Scene` in peer.cpp."""

        _fields_ = [*((name, real) for name in _CONSTANTS), *((name, ctypes.c_int) for name in _SIZES),
                    *((name, ctypes.c_void_p) for name in pointers)]  # fmt: skip

    return Scene


def multiply_adds(precision: str) -> Callable[[], float]:
    """A function that makes 1e7 of this core's widest operations and returns how many single ones those are."""
    function = _library(precision).multiply_adds
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_long, ctypes.c_void_p]
    result = ctypes.c_double()
    return lambda: float(function(500_000, ctypes.byref(result)))


@dataclass(frozen=True)
class Twin:
    """One pass in both languages, over the same ``rows`` with ``neighbours`` each on average."""

    name: str
    rows: int
    neighbours: float
    kernel: Callable[[], None]
    empty: Callable[[], None]  # the kernel over no rows: what a launch takes
    cpp: Callable[[], None]
    difference: Callable[[], float]


def twins(sim: Simulation, precision: str, dt: float = 1e-9) -> list[Twin]:
    """The passes of a 2-D drop without walls, radiation and viscous heating; ``dt`` [s] of the momentum pass."""
    flow, surface, heat, rows = sim.flow_step.flow, sim.surface, sim.heat, sim.rows  # type: ignore[union-attr]
    flow.advance(0.0, 0.0)  # everybody shows the velocity that momentum reads
    heat.surroundings.look()  # type: ignore[union-attr]  # and has the slopes that conduction reads
    exported = _Exported(sim, precision)
    exported.check_forms()
    launches: dict[str, Callable[[int, float], None]] = {
        "momentum": lambda count, step: flow._momentum(count, step, True),
        "continuity": lambda count, _: flow._continuity(count, True),
        "colour": lambda count, _: surface._colour(count, True),  # type: ignore[union-attr]
        "forces": lambda count, _: surface._forces(count, True),  # type: ignore[union-attr]
        "conduction": lambda count, _: heat._rates(count, 0, 0.0, True),  # type: ignore[union-attr]
    }
    counts = {"momentum": rows.mobile, "continuity": rows.mobile, "conduction": rows.hot,
              "colour": surface.flow, "forces": surface.mobile}  # type: ignore[union-attr]  # fmt: skip
    return [exported.twin(name, counts[name], launch, dt) for name, launch in launches.items()]


def unfused(sim: Simulation, precision: str, dt: float = 1e-9) -> tuple[Callable[[], None], float]:
    """All passes of :func:`twins` in C++, with a loop over the neighbours for every term.

    Returns a function that runs it, and the largest difference of a result from that of the fused loops, over the
    largest value of that result; of the density, over its largest change. ``dt`` [s] of the momentum pass.
    """
    exported = _Exported(sim, precision)
    (fused, ours), (apart, theirs) = exported.scene(dt), exported.scene(dt)
    for name in _PASSES:
        exported.function(name)(ctypes.addressof(fused))
    function = exported.function("unfused")
    function(ctypes.addressof(apart))
    for arrays in (ours, theirs):
        arrays["density_after"] -= np.where(arrays["density_after"] > 0.0, arrays["density"], 0.0)
    worst = max(
        float(np.abs(ours[name] - theirs[name]).max() / np.abs(ours[name]).max())
        for results in _PASSES.values()
        for name in results
    )
    return lambda _keep=theirs: function(ctypes.addressof(apart)), worst


class _Exported:
    """The arrays of a simulation for C++."""

    def __init__(self, sim: Simulation, precision: str):
        self._sim, self._precision = sim, precision
        self._real = np.float64 if precision == "f64" else np.float32
        self._library = _library(precision)

    def check_forms(self) -> None:
        """The C++ has the default forms only."""
        sim, numerics = self._sim, self._sim.config.numerics
        assert sim.scene.dimension == 2 and sim.state.needs.balanced and sim.state.needs.shifting
        assert (
            not (sim.state.needs.losses or sim.state.needs.viscous_heating) and len(sim.scene.materials) == 1
        )
        assert numerics.pressure_form == "sum" and numerics.viscosity_form == "isotropic"
        assert (PACKING_BRACKET, LARGEST, AT_SURFACE) == (0.1, 0.1, 0.5), "peer.cpp has these numbers"
        assert numerics.curvature == "restricted" and numerics.curvature_clip == "two_sided"
        assert numerics.depth_correction and numerics.temperature_gradient == "renormalised"
        assert numerics.surface_times_liquid

    def _constants(self, dt: float) -> dict[str, float]:
        disc, numerics = self._sim.disc, self._sim.config.numerics
        softening = isotropic_softening(disc.flow_kernel, disc.dx)
        intervals = len(disc.flat.shepard) - 1
        return {
            "h": disc.h, "alpha": disc.flow_kernel.alpha, "h_surface": disc.h_surface,
            "alpha_surface": disc.surface_kernel.alpha, "moment": disc.gradient_moment, "softening": softening,
            "viscous_scale": 2.0 / viscous_moment(disc.flow_kernel, softening, disc.dx), "gravity": disc.gravity,
            "sound_speed": numerics.sound_speed, "delta": 2.0 * numerics.delta * disc.h * numerics.sound_speed,
            "packing": numerics.packing_correction * numerics.sound_speed / disc.h, "shifting": disc.shifting,
            "dt": dt, "normal_cut": numerics.normal_cut / disc.h_surface, "singular": SINGULAR,
            "table_scale": disc.h_surface / disc.flat.largest * intervals,
        }  # fmt: skip

    def scene(self, dt: float) -> tuple[Any, dict[str, np.ndarray]]:
        """The structure and the arrays that it points into."""
        sim, rows, surface = self._sim, self._sim.rows, self._sim.surface
        assert surface is not None and sim.heat is not None
        arrays = {name: getattr(rows, name).to_numpy() for name in _LISTS if hasattr(rows, name)}
        arrays["near_surface"] = surface._near_surface.to_numpy()
        arrays["mobility"] = sim.state.array("mobility")
        arrays = {name: np.ascontiguousarray(values, np.int32) for name, values in arrays.items()}
        for name in _FIELDS:
            arrays[name] = np.ascontiguousarray(sim.state.array(name), self._real)
        for name in _TABLES:
            table = getattr(sim.disc.flat, name.removeprefix("flat_"))
            arrays[name] = np.ascontiguousarray(table, self._real)
        arrays[_SLOPES] = np.ascontiguousarray(sim.heat.surroundings.slopes.to_numpy(), self._real)
        for name, field in _RESULTS.items():
            like = sim.state.array(field)
            arrays[name] = np.zeros(like.shape, np.float64 if name == "heating" else self._real)
        sizes = {"mobile": rows.mobile, "hot": rows.hot, "near_surface_count": surface.flow,
                 "surface_mobile": surface.mobile, "near_width": rows.near.shape[1],
                 "slopes_width": arrays[_SLOPES].shape[1], "far_width": rows.far.shape[1],
                 "intervals": len(sim.disc.flat.shepard) - 1}  # fmt: skip
        pointers = {name: values.ctypes.data for name, values in arrays.items()}
        return _structure(self._precision)(**self._constants(dt), **sizes, **pointers), arrays

    def function(self, name: str) -> Any:
        """The C++ function ``name``, which takes the address of a scene."""
        function = getattr(self._library, name)
        function.restype, function.argtypes = None, [ctypes.c_void_p]
        return function

    def twin(self, name: str, count: int, launch: Callable[[int, float], None], dt: float) -> Twin:
        """The pass ``name``; timed with a step of zero, which leaves the simulation as it is."""
        function = self.function(name)
        scene, arrays = self.scene(0.0)
        place = ctypes.addressof(scene)

        def kernel(rows: int = count) -> None:
            launch(rows, 0.0)
            ti.sync()

        def cpp(_keep: object = (scene, arrays)) -> None:
            function(place)

        def difference() -> float:
            now, results = self.scene(dt)
            function(ctypes.addressof(now))
            before = self._sim.state.array("density")
            launch(count, dt)
            return self._largest_difference(name, results, before)

        return Twin(name, count, self._neighbours(name), kernel, lambda: kernel(0), cpp, difference)

    def _rows(self, name: str) -> np.ndarray:
        rows, surface = self._sim.rows, self._sim.surface
        assert surface is not None
        chosen: np.ndarray = rows.rows.to_numpy()
        if name in _OVER_BOTH:
            count = surface.flow if name == "colour" else surface.mobile
            return np.asarray(chosen[surface._near_surface.to_numpy()[:count]])
        if name == "conduction":
            return np.asarray(rows.hot_rows.to_numpy()[: rows.hot])
        return chosen[: rows.mobile]

    def _neighbours(self, name: str) -> float:
        rows, own = self._sim.rows, self._rows(name)
        count = rows.near_count.to_numpy()[own] + (
            rows.far_count.to_numpy()[own] if name in _OVER_BOTH else 0
        )
        return float(count.mean())

    def _largest_difference(self, name: str, results: dict[str, np.ndarray], density: np.ndarray) -> float:
        """Of any result of the pass, over that result's largest value; of the density, over its largest change."""
        worst, own = 0.0, self._rows(name)
        for result in _PASSES[name]:
            ours, cpp = self._sim.state.array(_RESULTS[result])[own], results[result][own]
            worst = max(worst, float(np.abs(ours - cpp).max() / np.abs(ours).max()))
        if name == "momentum":
            self._sim.state.load(density=density)
        return worst

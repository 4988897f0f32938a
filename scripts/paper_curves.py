"""The curves of the paper's figures 3, 5 and 6 from finished runs, and what they say in numbers."""

import io
from typing import Any

import numpy as np
from make_results import Run
from matplotlib.figure import Figure as Plot
from paper_sheet import Figure
from PIL import Image

from taichi_slm.config.load import load_config
from taichi_slm.materials.laws import phase_value
from taichi_slm.output.snapshots import Snapshot, read_series, read_snapshot
from taichi_slm.scene.build import build_scene
from taichi_slm.verification.cases.thermal_cycle import volume_errors
from taichi_slm.verification.cases.two_fluid_column import areas

FLUIDS = ("fluid 1, expands", "fluid 2")
COLOURS = ("#D55E00", "#0072B2")


def drop(run: Run) -> list[Figure]:
    """Figure 3: error of the volume of a drop under thermal cycling."""
    snapshots, mass, reference = _load(run)
    rows = [volume_errors(s.arrays["position"], mass / reference(s)) for s in snapshots[1:]]
    error = 100 * np.abs(np.array(rows))
    time = np.array([s.time for s in snapshots[1:]])
    names = ("inside, r < 0.5 R", "near the surface, 0.8 R < r < 0.9 R")
    plot, axes = _plot("time [cycles]", "error of the volume [%]")
    for k, name in enumerate(names):
        axes.plot(time, error[:, k], label=name, color=COLOURS[1 - k])
    axes.set_ylim(0.0, 1.2 * float(error.max()))
    axes.legend(loc="upper center", ncols=2)
    inside, surface = error.max(axis=0)
    early, late = error[time <= 3.0].max(), error[time > time[-1] - 3.0].max()
    return [
        Figure(
            3,
            "Error of the volume inside and near the surface of a drop whose density follows an imposed cycle of "
            "temperature",
            _image(plot),
            [run],
            "The error follows the cycle and stays of one size, with a slow drift near the surface: at most "
            f"{early:.2f} % in the first three cycles, {late:.2f} % in the last three. It is at most {inside:.2f} % "
            f"inside (paper: less than 0.4 %) and {surface:.2f} % near the surface (paper: less than 0.8 %).",
            "The paper gives neither its sound speed nor its viscosity, and its h/dx of 1.2 is 1.5 here: "
            "the errors can be compared in size only.",
        )
    ]


def column(run: Run) -> list[Figure]:
    """Figures 5 and 6: densities and volumes of two stacked fluids, the lower of which expands."""
    snapshots, mass, reference = _load(run)
    begin = snapshots[0].arrays
    fluid, dx = begin["tracer"], snapshots[0].spacing
    inside = [fluid == 1, (fluid == 2) & (begin["position"][:, 1] < 2.0 - 2 * dx)]
    alone = fluid > 0
    density, wanted, volume = [], [], []
    for s in snapshots:
        exact = reference(s)
        density.append([s.arrays["density"][fluid == k].mean() for k in (1, 2)])
        wanted.append([exact[fluid == k].mean() for k in (1, 2)])
        area = np.full(len(fluid), np.nan)
        area[alone] = areas(s.arrays["position"][alone])
        volume.append([np.nansum(area[part]) / (mass / exact)[part].sum() - 1.0 for part in inside])
    time = np.array([s.time for s in snapshots])
    found, target = np.array(density) / 1000.0, np.array(wanted) / 1000.0
    error = 100 * np.abs(np.array(volume))
    gap = max(float(s.arrays["position"][fluid == 1, 1].min()) for s in snapshots) - 0.5 * dx
    return [
        _densities(run, time, found, target),
        _volumes(run, time, error, gap),
    ]


def _densities(run: Run, time: np.ndarray, found: np.ndarray, target: np.ndarray) -> Figure:
    plot, axes = _plot("t/t₀", "mean density / 1000 kg/m³")
    for k, name in enumerate(FLUIDS):
        axes.plot(time, found[:, k], label=name, color=COLOURS[k])
        axes.plot(time, target[:, k], ":", color="black", label="reference" if k else None)
    axes.legend()
    calm = time > time[-1] - 0.5
    off = 100 * (found / target - 1.0)
    return Figure(
        5,
        "Mean densities of two stacked fluids; the reference of the lower one falls by a fifth until t/t₀ = 0.5",
        _image(plot),
        [run],
        f"Both follow their references: over the last half t₀ fluid 1 is at {found[calm, 0].mean():.4f} and fluid 2 at "
        f"{found[calm, 1].mean():.4f} of 1000 kg/m³, {off[calm, 0].mean():.2f} % and {off[calm, 1].mean():.2f} % "
        "above the reference, as the weight above them asks for. The density swings when the expansion starts and "
        f"ends, as the paper says: by up to {np.abs(off).max():.1f} %.",
        "The paper does not say how much viscosity damps the swings: their size is not to be compared.",
    )


def _volumes(run: Run, time: np.ndarray, error: np.ndarray, gap: float) -> Figure:
    plot, axes = _plot("t/t₀", "error of the volume [%]")
    for k, name in enumerate(FLUIDS):
        axes.plot(time, error[:, k], label=name, color=COLOURS[k])
    axes.axhline(1.0, color="black", linestyle=":", label="the paper's bound")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    late = error[time > time[-1] - 0.5].mean(axis=0)
    over = (error > 1.0).any(axis=1)
    return Figure(
        6,
        "Error of the volume of either fluid",
        _image(plot),
        [run],
        f"Over the last half t₀ the errors are {late[0]:.2f} % and {late[1]:.2f} % on average (paper: less than 1 %), "
        "and they rise when the expansion starts and ends, as the paper says.",
        f"They rise far higher: fluid 1 is off by up to {error[:, 0].max():.1f} %, fluid 2 by "
        f"{error[:, 1].max():.1f} %, and both are below the paper's 1 % for good only from t/t₀ = "
        f"{time[over].max():.2f} on. The sudden start throws the column up, and a wall does not pull here: for a while "
        f"a gap at the floor (up to {gap:.2f} m) and voids within the fluid, which the density does not "
        "know of, are measured as volume. [verification.md](verification.md) has the wave, and what a finer "
        "spacing does.",
    )


def _load(run: Run) -> tuple[list[Snapshot], np.ndarray, Any]:
    """Snapshots of ``run``, masses of the particles [kg/m], and a function: reference densities of a snapshot."""
    config = load_config(run.folder.resolved).config
    scene = build_scene(config)

    def at(temperature: np.ndarray) -> np.ndarray:
        density = np.empty(scene.count)
        for number, material in enumerate(scene.materials):
            its = scene.material == number
            density[its] = phase_value(material, "density", temperature[its])
        return density

    snapshots = [read_snapshot(path) for _, path in read_series(run.folder.series)]
    mass = at(scene.temperature) * scene.volume
    return snapshots, mass, lambda snapshot: at(snapshot.arrays["temperature"])


def _plot(across: str, up: str) -> tuple[Plot, Any]:
    plot = Plot(figsize=(7.2, 3.6), layout="constrained")
    axes = plot.add_subplot()
    axes.set(xlabel=across, ylabel=up)
    axes.grid(alpha=0.3)
    axes.margins(x=0.0)
    return plot, axes


def _image(plot: Plot) -> Image.Image:
    buffer = io.BytesIO()
    plot.savefig(buffer, format="png", dpi=120)
    return Image.open(buffer).convert("RGB")

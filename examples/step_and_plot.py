"""A scene made in Python, stepped, measured and drawn: half a minute; open it as a notebook, or run it.

    python examples/step_and_plot.py                          # writes step_and_plot.png
    python examples/step_and_plot.py spacing=8e-6 laser.power=80

The cells (# %%) are those of Jupyter, VS Code, Spyder and PyCharm.
"""

# %% The scene: the keys of a YAML file, in SI units or as strings with a unit; wrong keys are named as there
import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection
from matplotlib.tri import Triangulation

from taichi_slm import Simulation, load_config
from taichi_slm.analysis import melt_pool
from taichi_slm.materials.library import load_alloy

scene = {
    "dimension": 2,
    "spacing": "5 um",
    "bodies": [
        {"shape": "plate", "material": "steel_304", "length": "0.6 mm", "depth": "0.15 mm"},
        {
            "shape": "powder_row",
            "material": "steel_304",
            "start": "0.1 mm",
            "length": "0.4 mm",
            "radius": "25 um",
        },
    ],
    "laser": {
        "power": 150,
        "beam_radius": "54 um",
        "absorptivity": 0.75,
        "path": [{"kind": "line", "start": [0.15e-3], "end": [0.45e-3], "speed": 2.0}],
    },
    "numerics": {"sound_speed": 20},
    "time": {"end": "0.4 ms"},
}
in_notebook = "ipykernel" in sys.modules
config = load_config(scene, [] if in_notebook else sys.argv[1:]).config
steel = load_alloy("steel_304")
melting_point = 0.5 * (steel.solidus + steel.liquidus)  # [K]

# %% Step it: sim.step() is one step as long as stability allows, sim.advance(t) stops at t exactly
sim = Simulation(config)
rows, moments = [], []
picture_times = [share * config.time.end for share in (0.1, 0.35, 1.0)]
for frame in range(1, 41):
    sim.advance(frame / 40 * config.time.end)
    now = sim.arrays()  # numpy: every particle that is still there
    pool = melt_pool.measure(
        now["position"], now["temperature"], now["liquid_fraction"], melting_point, config.spacing
    )
    rows.append({"pool_depth_m": pool.depth, "pool_length_m": pool.length, **sim.diagnostics()})
    if len(moments) < len(picture_times) and sim.time >= picture_times[len(moments)] * (1 - 1e-9):
        moments.append((sim.time, now))

# %% Look at the accounts: what a run writes into history.csv
last = rows[-1]
deepest = max(row["pool_depth_m"] for row in rows)
hottest = max(row["max_temperature_K"] for row in rows)
print(f"{sim.steps} steps, {len(sim.position)} particles, to {sim.time * 1e6:.0f} us")
print(f"the pool was {deepest * 1e6:.0f} um deep and {hottest:.0f} K hot")
print(
    f"absorbed {last['absorbed_J']:.4g} J/m; errors: energy {last['energy_error']:.1e}, mass {last['mass_error']:.1e}"
)


# %% Draw it: particles as discs of their own size, and the melting point as a line
def draw(axes, position, temperature):
    """Particles at ``position`` [m], shape [n, 2], coloured by ``temperature`` [K], on axes in micrometres."""
    places, size = position * 1e6, config.spacing * 1e6
    sizes = np.full(len(places), size)
    discs = EllipseCollection(
        sizes, sizes, np.zeros(len(places)), units="xy", offsets=places, offset_transform=axes.transData
    )
    discs.set(array=temperature, cmap="inferno", clim=(config.ambient_temperature, 3000))
    axes.add_collection(discs)
    net = Triangulation(*places.T)
    sides = places[net.triangles] - places[np.roll(net.triangles, 1, axis=1)]
    net.set_mask((np.linalg.norm(sides, axis=2) > 2.5 * size).any(axis=1))  # no line across empty space
    axes.tricontour(net, temperature, [melting_point], colors="deepskyblue", linewidths=1.5)
    axes.set(xlim=(0, 600), ylim=(-155, 90), aspect="equal", ylabel="height [µm]")
    return discs


figure, axes = plt.subplots(len(moments) + 1, figsize=(7.5, 10.5), layout="constrained")
for panel, (time, now) in zip(axes, moments, strict=False):
    drawn = draw(panel, now["position"], now["temperature"])
    panel.set_title(f"t = {time * 1e6:.0f} µs; blue line: melting point", loc="left", fontsize=10)
axes[-2].set_xlabel("along the track [µm]")
figure.colorbar(drawn, ax=axes[:-1], label="temperature [K]", extend="max", shrink=0.6)

time_us = [row["time_s"] * 1e6 for row in rows]
axes[-1].plot(time_us, [row["pool_depth_m"] * 1e6 for row in rows], label="depth")
axes[-1].plot(time_us, [row["pool_length_m"] * 1e6 for row in rows], label="length")
axes[-1].set(xlabel="time [µs]", ylabel="melt pool [µm]")
axes[-1].grid(alpha=0.3)
axes[-1].legend()
if not in_notebook:
    figure.savefig("step_and_plot.png", dpi=110)

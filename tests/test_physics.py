"""The terms of flow and surface on the device against what is known of them, and drops and columns that move."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import Voronoi

from taichi_slm import backend
from taichi_slm.backend import ti
from taichi_slm.config.load import load_config
from taichi_slm.materials.laws import liquid_fraction, phase_value, surface_tension, surface_tension_slope
from taichi_slm.materials.library import resolve
from taichi_slm.materials.tables import enthalpy_at, tabulate, temperature_at
from taichi_slm.physics import conduction, equation_of_state, viscosity
from taichi_slm.physics import surface_tension as tension
from taichi_slm.physics.material import MaterialTables
from taichi_slm.run.simulation import Simulation
from taichi_slm.solver.timestep import StepLimits
from taichi_slm.sph.kernel import Wendland
from taichi_slm.sph.lattice import conduction_moment, shepard_sum
from taichi_slm.state import MOBILE, STILL

UM = 1e-6
FLOW_ONLY = {
    "heat": False, "surface_tension": False, "marangoni": False, "radiation": False, "viscous_heating": False,
}  # fmt: skip

# --------------------------------------------------------------------------- properties on the device


def test_tables_on_the_device_are_the_laws():
    """Every property of two alloys at temperatures between the knots; kinks at solidus and liquidus stay sharp."""
    materials = [resolve("steel_304", {}), resolve("316L", {})]
    host = tabulate(materials)
    names = (
        "density",
        "conductivity",
        "viscosity",
        "surface_tension",
        "surface_tension_slope",
        "heat_capacity",
    )
    backend.start(threads=1)
    tables = MaterialTables(host, ti.f64, names)
    readers = [tables.reader(name) for name in names]
    T = np.concatenate(
        [np.linspace(300.0, 5500.0, 397), [1673.0, 1675.0, 1708.0, 1773.0, 1672.999, 1708.001]]
    )
    given = ti.field(ti.f64, shape=len(T))
    given.from_numpy(T)
    out = ti.field(ti.f64, shape=(2, len(T), len(names) + 2))
    heat = ti.field(ti.f64, shape=(2, len(T)))
    heat.from_numpy(np.stack([enthalpy_at(host, m, T) for m in range(2)]))

    last = len(names)

    @ti.kernel
    def evaluate():
        for m, i in ti.ndrange(2, given.shape[0]):
            knot, fraction = tables.locate(m, given[i])
            for j in ti.static(range(last)):
                out[m, i, j] = readers[j](m, knot, fraction)
            out[m, i, last] = tables.liquid_fraction(m, given[i])
            out[m, i, last + 1] = tables.temperature_of(m, heat[m, i])

    evaluate()
    found = out.to_numpy()
    for m, material in enumerate(materials):
        laws = {
            "density": np.where(
                material.solidus >= T,
                phase_value(material, "density", material.solidus),
                phase_value(material, "density", T),
            ),
            "conductivity": phase_value(material, "conductivity", T),
            "viscosity": phase_value(material, "viscosity", T),
            "surface_tension": surface_tension(material, T),
        }
        for name, values in laws.items():
            # knots every 8 to 16 K: the curvature of the sulphur law gives 3e-5, that of log10(mu) = a/T 1e-4
            tolerance = 2e-4 if name == "viscosity" else 5e-5
            assert found[m, :, names.index(name)] == pytest.approx(values, rel=tolerance), name
        slope = surface_tension_slope(material, T)
        assert found[m, :, 4] == pytest.approx(slope, abs=1e-3 * np.abs(slope).max())  # its steepest bend
        assert found[m, :, 6] == pytest.approx(liquid_fraction(material, T), abs=1e-12)
        # T(H) is the exact inverse of H(T) on the host, and the same on the device
        assert found[m, :, 7] == pytest.approx(T, rel=1e-12)
        assert temperature_at(host, m, enthalpy_at(host, m, T)) == pytest.approx(T, rel=1e-12)


def test_stable_steps_of_the_terms():
    h = 4.8e-6
    assert equation_of_state.stable_dt(h, 20.0, 0.4) == pytest.approx(0.4 * h / 20.0)
    assert viscosity.stable_dt(h, 0.01, 6840.0, 0.08) == pytest.approx(0.08 * h**2 * 6840 / 0.01)
    assert conduction.stable_dt(h, 7200 * 711.2, 20.9, 0.2) == pytest.approx(0.2 * 7200 * 711.2 * h**2 / 20.9)
    # (43) with the root: 0.1 us at 4 um, where the print's square would allow 1e-14 s
    assert tension.stable_dt(7.2e-6, 6840, 1.8, 0.25) == pytest.approx(1.18779e-7, rel=1e-5)
    assert tension.stable_dt(h, 6840, 0.0, 0.25) == math.inf
    assert viscosity.artificial_viscosity(0.13, 0.06, 40.0, 2) == pytest.approx(0.13 * 0.06 * 40 / 8)


def test_limits_are_of_the_worst_state_so_far(track):
    """Before anything melts the limits are those of the coldest liquid; hotter metal never allows a longer step."""
    config = track()
    limits = StepLimits(config, tabulate([resolve("steel_304", {})]))
    cold, at_solidus = limits.flow(300.0), limits.flow(1673.0)
    assert cold == at_solidus
    assert set(cold) == {"sound", "viscosity", "capillary"}
    h, mush = 1.2 * config.spacing, 0.1 / 7443.0  # ten times the melt's viscosity at the solidus
    assert cold["viscosity"] == pytest.approx(0.08 * h**2 / mush, rel=1e-3)
    assert cold["sound"] == pytest.approx(0.4 * h / 20.0)
    assert limits.flow(300.0, 5.0)["sound"] == pytest.approx(0.4 * h / 25.0)  # sound and flow add up
    hotter = [limits.flow(T) for T in (1700.0, 2000.0, 3000.0, 6000.0)]
    for name in cold:
        steps = [cold[name], *(each[name] for each in hotter)]
        assert steps == sorted(steps, reverse=True), name
    heat = [limits.euler(T) for T in (300.0, 1700.0, 1800.0, 4000.0)]
    assert heat == sorted(heat, reverse=True)
    assert limits.heat(300.0) >= heat[0]


# --------------------------------------------------------------------------- operators on a lattice


def _kernel(dx):
    return Wendland(2, 1.2 * dx)


@pytest.fixture(scope="module")
def operators(configure, liquid, impose):
    """Each pass of a step on a square lattice of 30 x 30, with fields whose derivatives are known; numpy results."""
    dx, n, mu, rho = 1e-5, 30, 0.02, 7000.0
    metal = liquid(density=rho, viscosity=mu, conductivity=20, heat_capacity=700, surface_tension=1.5)
    config = configure(
        spacing=dx, materials={"metal": metal}, ambient_temperature=1000,
        bodies=[{"shape": "box", "corner": [0, 0], "size": [n * dx, n * dx], "material": "metal",
                 "temperature": 1000}],
        physics={"radiation": False, "marangoni": False},
        numerics={"heat_scheme": "euler", "packing_correction": 0},
    )  # fmt: skip
    sim = Simulation(config)
    sim.compile()
    x, y = (sim.position / dx - n / 2).T
    inside = np.maximum(np.abs(x), np.abs(y)) < n / 2 - 3  # all of the support is there
    flow, found = sim.flow_step.flow, {"inside": inside, "x": x, "y": y, "dx": dx, "mu": mu, "rho": rho}

    sim.state.load(velocity=np.stack([y**2, np.zeros_like(y)], axis=1))
    flow.momentum(0.0)
    found["shear"] = sim.state.array("acceleration")

    # a random flow of which every fifth particle is held fast: the power of all forces, and the heat of a step
    velocity = np.random.default_rng(8).normal(size=(n * n, 2))
    still = np.arange(n * n) % 5 == 0
    velocity[still] = 0.0
    sim.state.load(velocity=velocity, mobility=np.where(still, STILL, MOBILE), viscous_work=np.zeros(n * n))
    flow.momentum(1e-6)
    found["work"] = sim.state.array("viscous_work").sum() / 1e-6
    acceleration = sim.state.array("acceleration")
    found["power"] = np.sum(sim.state.array("mass")[~still, None] * (velocity * acceleration)[~still])
    sim.state.load(mobility=np.full(n * n, MOBILE), viscous_work=np.zeros(n * n))
    sim.state.load(velocity=np.stack([3.0 * x, -1.0 * y], axis=1))
    flow.continuity()
    found["rate"], found["shepard"] = sim.state.array("density_rate"), sim.state.array("shepard")
    sim.state.load(velocity=np.zeros((n * n, 2)), density=rho * (1 + 1e-4 * (2 * x + y)))
    flow.advance(0.0, 0.0)
    flow.momentum(0.0)
    found["pressure"], found["push"] = sim.state.array("pressure"), sim.state.array("acceleration")
    found["colour"], found["volume"] = sim.state.array("colour_gradient"), np.full(n * n, dx**2)
    found["sound"] = config.numerics.sound_speed

    T = 1000 + 0.1 * x**2
    sim.state.load(density=np.full(n * n, rho), volume=np.full(n * n, dx**2))
    impose(sim, T)
    step = 1e-9
    sim.heat.step(step, False, 1.0)
    found["warming"] = (sim.temperature - T) / step
    return found


def test_viscosity_of_a_shear_flow(operators):
    """u = (y^2, 0): mu lap u / rho = 2 mu/rho, to round-off thanks to the lattice moment."""
    exact = 2 * operators["mu"] / operators["rho"] / operators["dx"] ** 2
    assert operators["shear"][operators["inside"], 0] == pytest.approx(exact, rel=1e-10)
    assert operators["shear"][operators["inside"], 1] == pytest.approx(0.0, abs=1e-10 * exact)


def test_viscous_heat_is_the_work_of_viscosity(operators):
    """What the forces take from the motion becomes heat, half in either partner, all of it beside a wall."""
    assert operators["power"] < 0
    assert operators["work"] == pytest.approx(-operators["power"], rel=1e-12)


def test_divergence_and_shepard_sum(operators):
    """u = (3 x, -y): drho/dt = -rho div u times the lattice moment, which (11) does not divide by."""
    moment = conduction_moment(_kernel(operators["dx"]), operators["dx"])
    exact = -operators["rho"] * 2.0 / operators["dx"] * moment
    assert operators["rate"][operators["inside"]] == pytest.approx(exact, rel=1e-10)
    ideal = shepard_sum(_kernel(operators["dx"]), operators["dx"])
    assert operators["shepard"][operators["inside"]] == pytest.approx(ideal, rel=1e-12)


def test_pressure_and_its_gradient(operators):
    """p = c0^2 (rho - rho0), and -grad p/rho of a linear pressure, times the same moment."""
    inside, x, y = operators["inside"], operators["x"], operators["y"]
    p = operators["sound"] ** 2 * operators["rho"] * 1e-4 * (2 * x + y)
    assert operators["pressure"] == pytest.approx(
        p, abs=1e-9 * np.abs(p).max()
    )  # rho - rho0 cancels four digits
    slope = operators["sound"] ** 2 * 1e-4 / operators["dx"]
    moment = conduction_moment(_kernel(operators["dx"]), operators["dx"])
    # volumes are m/rho here, so the lattice's own sums are off by the 0.6 % that the density varies by
    assert operators["push"][inside] == pytest.approx(
        -moment * slope * np.array([[2.0, 1.0]]).repeat(inside.sum(), 0), rel=0.02
    )


def test_conduction_of_a_parabola(operators):
    """T = x^2/10: rho c dT/dt = k/5 per dx^2, to what is left of 1e-6 K in 1000 K after a subtraction."""
    exact = 20.0 / (operators["rho"] * 700) * 0.2 / operators["dx"] ** 2
    assert operators["warming"][operators["inside"]] == pytest.approx(exact, rel=1e-5)


def test_colour_gradient_across_a_flat_surface(operators):
    """Inward, and its integral through the surface is one: the area that radiates and feels surface tension."""
    colour, dx = operators["colour"] * operators["dx"], operators["dx"]
    x, y = operators["x"], operators["y"]
    middle = np.abs(y) < 10
    left, right = middle & (x < -10), middle & (x > 10)
    assert (colour[left, 0] >= -1e-12).all()
    assert (colour[right, 0] <= 1e-12).all()
    assert np.abs(colour[left | right, 1]).max() < 1e-12
    for side in (left, right):
        through = np.linalg.norm(colour[side], axis=1).sum() / np.unique(y[side]).size
        assert through == pytest.approx(0.995, abs=0.001)  # METHOD; a sum over three layers for an integral
    assert dx > 0


# --------------------------------------------------------------------------- surface forces


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_surface_forces_of_a_drop(configure, liquid, impose, dimension):
    """Tension inward by sigma kappa, Marangoni along the surface from hot to cold where d sigma/dT < 0."""
    radius, slope, gradient = 60 * UM, -3e-4, np.array([2e6, 1e6, 0.5e6])[:dimension]
    dx = {2: 3 * UM, 3: 6 * UM}[dimension]
    law = {"line": {"value": 1.6, "slope": slope, "at": 2000}}
    config = configure(
        dimension=dimension, spacing=dx, materials={"metal": liquid(density=7000, surface_tension=law)},
        ambient_temperature=2000,
        bodies=[{"shape": "droplet", "centre": [0.0] * dimension, "radius": radius, "material": "metal",
                 "arrangement": "rings" if dimension == 2 else "lattice", "temperature": 2000}],
        physics={**FLOW_ONLY, "surface_tension": True, "marangoni": True},
    )  # fmt: skip
    sim = Simulation(config)
    sim.compile()
    x = sim.position
    T = 2000 + x @ gradient
    impose(sim, T)
    sim.surface.step()
    normal, strength, kappa, force = (
        sim.state.array(name) for name in ("normal", "colour_strength", "curvature", "surface_force")
    )
    has = np.linalg.norm(normal, axis=1) > 0.5
    outward = x / np.linalg.norm(x, axis=1, keepdims=True).clip(1e-12)
    assert (force[~has] == 0.0).all()
    assert has.sum() > 100
    # normals point inward, within what a lattice's steps at the rim allow in 3-D (R/dx 10); rings are round
    aligned = -np.einsum("ij,ij->i", normal, outward)[has]
    assert aligned.min() > (0.999 if dimension == 2 else 0.9)
    # the surface's curvature at every depth: (d-1)/R; the mean over particles comes out at 1.00 (2-D), 1.03 (3-D)
    weights = strength[has]
    scaled = -kappa[has] * radius / (dimension - 1)
    mean = np.average(scaled, weights=weights)
    assert mean == pytest.approx(1.0, abs=0.01 if dimension == 2 else 0.06)
    if dimension == 2:  # at every depth: without the correction the second layer of rings would have 1.08
        assert scaled == pytest.approx(1.0, abs=0.05)
    # the force is sigma kappa n along the normal ...
    along = np.einsum("ij,ij->i", force, normal)
    sigma = 1.6 + slope * (T - 2000)
    # (sigma and its slope are linear in T, so the tables hold them to round-off)
    assert along[has] == pytest.approx(
        (-sigma * kappa * strength)[has], rel=1e-9, abs=1e-9 * np.abs(along).max()
    )
    # ... and (d sigma/dT)(grad T - (grad T . n) n)|n| across it: the renormalised gradient of a linear field is exact
    across = force - along[:, None] * normal
    tangential = gradient - (normal @ gradient)[:, None] * normal
    expected = slope * tangential * strength[:, None]
    assert across[has] == pytest.approx(expected[has], abs=1e-9 * np.abs(expected).max())
    assert (np.einsum("ij,j->i", across[has], gradient) <= 0).all()  # from hot to cold
    area = float(np.sum(sim.state.array("volume") * strength))
    exact = {2: 2 * np.pi * radius, 3: 4 * np.pi * radius**2}[dimension]
    # |grad c| lives inside, up to h_s below the surface, where a drop is smaller; R/dx is 20 in 2-D, 10 in 3-D
    assert area / exact == pytest.approx(0.99 if dimension == 2 else 0.92, abs=0.02)


# --------------------------------------------------------------------------- motion


def test_free_fall_keeps_momentum(configure, liquid):
    """A stretched, turning drop without surface tension: M g t to round-off, its centre on the parabola."""
    config = configure(
        spacing=0.1, gravity=9.81, materials={"fluid": liquid(viscosity=1.0)},
        bodies=[{"shape": "droplet", "centre": [0, 0], "radius": 0.8, "material": "fluid", "stretch": 0.1,
                 "velocity": [0.3, 2.0]}],
        domain={"lower": [-3, -3], "upper": [3, 3]},
        physics=FLOW_ONLY, numerics={"sound_speed": 30}, time={"end": 0.4},
    )  # fmt: skip
    sim = Simulation(config)
    rng = np.random.default_rng(4)
    swirl = rng.normal(0.0, 0.3, sim.position.shape)
    mass = sim.state.array("mass")
    sim.state.load(velocity=np.array([0.3, 2.0]) + swirl - np.average(swirl, weights=mass, axis=0))
    centre = np.average(sim.position, weights=mass, axis=0)
    sim.run()
    t = sim.time
    # the sums of pair forces cancel to round-off: a thousand steps of 1e-16, relative to a momentum of order one
    mean = np.average(sim.velocity, weights=mass, axis=0)
    assert mean == pytest.approx([0.3, 2.0 - 9.81 * t], abs=1e-10)
    way = [0.3 * t, 2.0 * t - 0.5 * 9.81 * t**2]
    assert np.average(sim.position, weights=mass, axis=0) - centre == pytest.approx(way, abs=1e-10)
    row = sim.diagnostics()
    assert row["mass_error"] == 0.0
    assert row["removed"] == 0


def check_walls(sim, liquid_ones):
    """A wall's pressure is the weighted mean of what the liquid extrapolates to it, and never a pull."""
    rng = np.random.default_rng(2)
    density = sim.state.array("density")
    density[liquid_ones] = 1000.0 + rng.normal(0.0, 3.0, liquid_ones.sum())
    sim.state.load(density=density)
    sim.activity.build()
    sim.flow_step.flow.advance(0.0, 0.0)
    sim.flow_step.flow.walls()
    x, p = sim.position, sim.state.array("pressure")
    kernel, found = _kernel(0.05), []
    for w in np.flatnonzero(~liquid_ones):
        r = x[w] - x[liquid_ones]
        weight = kernel.value(np.linalg.norm(r, axis=1))
        if weight.sum() > 0:
            extrapolated = p[liquid_ones] - density[liquid_ones] * 1.0 * r[:, 1]
            found.append((p[w], max(0.0, weight @ extrapolated / weight.sum())))
    device, host = np.array(found).T
    assert device == pytest.approx(host, rel=1e-10, abs=1e-9)
    assert (host == 0.0).any()
    assert (host > 0.0).any()


def test_a_column_at_rest_carries_its_weight(configure, liquid):
    """p = rho g depth in a small container, and the floor carries the weight."""
    config = configure(
        spacing=0.05, gravity=1.0, materials={"fluid": liquid(viscosity=0.0)},
        bodies=[{"shape": "container", "material": "fluid", "corner": [0, 0], "size": [0.6, 0.8]},
                {"shape": "box", "material": "fluid", "corner": [0, 0], "size": [0.6, 0.6]}],
        physics=FLOW_ONLY, numerics={"sound_speed": 15, "artificial_viscosity": 0.3, "packing_correction": 0},
        time={"end": 1.5},
    )  # fmt: skip
    sim = Simulation(config)
    liquid_ones = ~sim.scene.wall
    sim.compile()
    start = sim.checkpoint()
    check_walls(sim, liquid_ones)
    sim.restore(start)
    sim.advance(1.0)
    start = {name: np.array(values) for name, values in sim.accounts.momentum().items()}
    pressure = []
    for t in np.linspace(1.0, 1.5, 11)[1:]:
        sim.advance(t)
        pressure.append(sim.state.array("pressure")[liquid_ones])
    y = sim.position[liquid_ones, 1]
    exact = 1000.0 * (0.6 - y)
    error = np.mean(pressure, axis=0) - exact
    # the gradient of (11) is short by the lattice moment 0.964 (as conduction and viscosity would be without theirs),
    # so the pressure rises 3.7 % too steeply, at any spacing: 2 % of the floor's pressure in the mean
    inner = (y > 0.1) & (y < 0.5)
    steepness = -np.polyfit(y[inner], np.mean(pressure, axis=0)[inner], 1)[0] / 1000.0
    moment = conduction_moment(_kernel(0.05), 0.05)
    assert steepness * moment == pytest.approx(1.0, abs=0.01)
    assert math.sqrt(np.mean(error**2)) < 0.025 * 600
    assert np.abs(sim.velocity[liquid_ones]).max() < 0.02 * math.sqrt(0.6)  # at rest, of the speed of a fall
    momentum = {name: np.array(values) for name, values in sim.accounts.momentum().items()}
    weight = sim.state.array("mass")[liquid_ones].sum() * 0.5  # times g, in the half second
    assert (momentum["walls"] - start["walls"])[1] == pytest.approx(weight, rel=0.02)
    assert (momentum["gravity"] - start["gravity"])[1] == pytest.approx(-weight, rel=1e-12)
    assert sim.diagnostics()["momentum_error"] < 1e-12


STEEL = {"density": 7000, "viscosity": 0.006, "surface_tension": 1.8}
STEEL_DROP = {
    "shape": "droplet",
    "centre": [0, 0],
    "radius": 50 * UM,
    "material": "steel",
    "temperature": 2000,
}


def test_laplace_jump_of_a_drop_at_rest(configure, liquid):
    """p = sigma/R in 2-D. METHOD: 1.05 to 1.07 of it with these forms at R/dx 20; a later issue tightens this limit."""
    config = configure(
        spacing=2.5 * UM, materials={"steel": liquid(**{**STEEL, "viscosity": 0.05})}, bodies=[STEEL_DROP],
        physics={**FLOW_ONLY, "surface_tension": True}, numerics={"sound_speed": 50}, time={"end": 40e-6},
    )  # fmt: skip
    sim = Simulation(config)
    inside = np.linalg.norm(sim.position, axis=1) < 25 * UM
    pressures = []
    for t in np.linspace(20e-6, 40e-6, 41):
        sim.advance(t)
        pressures.append(sim.state.array("pressure")[inside].mean())
    ratio = np.mean(pressures) * 50 * UM / 1.8
    assert ratio == pytest.approx(1.0, abs=0.10)
    row = sim.diagnostics()
    assert row["momentum_error"] < 1e-10
    assert row["removed"] == 0


def test_period_of_an_oscillating_drop(configure, liquid):
    """omega^2 = 6 sigma/(rho R^3) in 2-D; METHOD: +1.3 % at R/dx 10 with the depth correction."""
    radius = 50 * UM
    omega = math.sqrt(6 * 1.8 / (7000 * radius**3))
    config = configure(
        spacing=5 * UM, materials={"steel": liquid(**STEEL)}, bodies=[{**STEEL_DROP, "stretch": 0.08}],
        physics={**FLOW_ONLY, "surface_tension": True}, numerics={"sound_speed": 50},
        time={"end": 1.6 * 2 * np.pi / omega},
    )  # fmt: skip
    sim = Simulation(config)
    times = np.linspace(0.0, config.time.end, 161)
    shape = []
    for t in times[1:]:
        sim.advance(t)
        x = sim.position - sim.position.mean(axis=0)
        shape.append(np.mean(x[:, 0] ** 2 - x[:, 1] ** 2) / radius**2)
    crossings = []
    for k in range(1, len(shape)):
        if shape[k - 1] * shape[k] < 0:
            part = shape[k - 1] / (shape[k - 1] - shape[k])
            crossings.append(times[k] + part * (times[k + 1] - times[k]))
    # the crossings are half a period apart; the first swing is that of a lattice that relaxes
    period = 2 * (crossings[-1] - crossings[0]) / (len(crossings) - 1)
    assert len(crossings) == 3
    assert period * omega / (2 * np.pi) == pytest.approx(1.0, abs=0.04)


def test_a_droplet_follows_its_reference_density():
    """Test 1 of the paper, one cycle: cells of the inside are m/rho0(T) within 0.4 %, near the surface 0.8 %."""
    path = Path(__file__).parents[1] / "configs" / "droplet_thermal_cycle.yaml"
    config = load_config(path, ["time.end=1.0", "spacing=0.0667"]).config
    sim = Simulation(config)
    worst = 0.0
    for t in np.linspace(0.125, 1.0, 8):
        sim.advance(t)
        cells = Voronoi(sim.position)
        area = np.full(sim.scene.count, np.nan)
        for a, region in enumerate(cells.point_region):
            corners = cells.regions[region]
            if -1 not in corners:
                v = cells.vertices[corners]
                area[a] = 0.5 * abs(
                    np.dot(v[:, 0], np.roll(v[:, 1], 1)) - np.dot(v[:, 1], np.roll(v[:, 0], 1))
                )
        inside = np.linalg.norm(sim.position, axis=1) < 0.7
        expected = (sim.state.array("mass") / sim.state.array("reference_density"))[inside].sum()
        worst = max(worst, abs(area[inside].sum() / expected - 1))
    assert worst < 0.004
    assert sim.diagnostics()["removed"] == 0

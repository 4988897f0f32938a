"""Kernel, lattice numbers, cells and neighbour lists against quadrature, finite differences and brute force."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial import cKDTree

from taichi_slm import backend
from taichi_slm.backend import ti
from taichi_slm.errors import BlowUpError
from taichi_slm.run.simulation import Simulation
from taichi_slm.solver.activity import AHEAD
from taichi_slm.sph.kernel import Wendland
from taichi_slm.sph.lattice import (
    conduction_moment,
    flat_surface,
    isotropic_softening,
    shepard_sum,
    viscous_moment,
    viscous_moments,
)
from taichi_slm.sph.symmetric import symmetric
from taichi_slm.state import MOBILE, REMOVED, STILL

UM = 1e-6
STEEL_BOX = {"shape": "box", "corner": [0, 0], "size": [60 * UM, 60 * UM]}

# --------------------------------------------------------------------------- kernel


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_upper_triangle_makes_the_whole_matrix(dimension):
    backend.start()
    products, matrix = symmetric(dimension)
    row = ti.Vector([3.0, -5.0, 7.0][:dimension])
    found = ti.Matrix.field(dimension, dimension, ti.f64, shape=())

    @ti.kernel
    def form():
        found[None] = matrix(products(row))

    form()
    assert (found[None].to_numpy() == np.outer(row, row)).all()


@pytest.mark.parametrize(
    ("dimension", "shell"), [(2, lambda r: 2 * np.pi * r), (3, lambda r: 4 * np.pi * r**2)]
)
def test_kernel_integrates_to_one(dimension, shell):
    kernel = Wendland(dimension, 3.7e-6)  # any h: the result has no unit
    total, _ = quad(lambda q: kernel.value(q * kernel.h) * shell(q * kernel.h) * kernel.h, 0.0, 2.0)
    assert total == pytest.approx(1.0, rel=1e-12)  # a polynomial: quad is exact to round-off
    assert kernel.value(2.0 * kernel.h) == 0.0
    assert kernel.value(5.0 * kernel.h) == 0.0
    assert kernel.slope(5.0 * kernel.h) == 0.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_slope_is_the_derivative(dimension):
    kernel = Wendland(dimension, 1.3)
    r = np.linspace(0.01, 2.59, 200)
    step = 1e-5
    by_differences = (kernel.value(r + step) - kernel.value(r - step)) / (2 * step)
    # central differences: error step^2/6 W''' plus round-off eps W/step, both below 1e-9 of the largest slope
    largest = np.abs(kernel.slope(r) * r).max()
    assert kernel.slope(r) * r == pytest.approx(by_differences, abs=1e-9 * largest)
    assert (kernel.slope(r) <= 0).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_taichi_kernel_equals_the_host_one(dimension):
    backend.start(threads=1)
    kernel = Wendland(dimension, 4.8e-6)
    W, F = kernel.functions()
    r = np.linspace(0.0, 3.0, 301) * kernel.h
    out = ti.Vector.field(2, ti.f64, shape=len(r))
    given = ti.field(ti.f64, shape=len(r))
    given.from_numpy(r)

    @ti.kernel
    def evaluate():
        for i in given:
            out[i] = ti.Vector([W(given[i] ** 2), F(given[i] ** 2)])

    evaluate()
    values = out.to_numpy()
    # fast_math reorders a handful of multiplications: some ten roundings, and cancellation in 1 - q/2 near q = 2
    assert values[:, 0] == pytest.approx(kernel.value(r), rel=1e-12, abs=1e-15 * kernel.alpha)
    assert values[:, 1] == pytest.approx(kernel.slope(r), rel=1e-12, abs=1e-15 * kernel.alpha / kernel.h**2)
    assert (values[r > 2.0001 * kernel.h] == 0.0).all()


# --------------------------------------------------------------------------- lattice


def test_lattice_moments_of_the_method_page():
    # half a unit of the last digit that METHOD.md and the docstrings of the terms print
    plane, space = Wendland(2, 1.2), Wendland(3, 1.2)
    assert conduction_moment(plane, 1.0) == pytest.approx(0.9638, abs=5e-5)
    assert conduction_moment(space, 1.0) == pytest.approx(0.98523, abs=5e-6)
    for kernel, along, across in (
        (plane, 0.750, 1.157),
        (space, 0.826, 1.202),
    ):  # METHOD knows the first alone
        found = viscous_moments(kernel, 0.01 * kernel.h**2, 1.0)
        assert found == pytest.approx(
            (along / (kernel.dimension + 2), across / (kernel.dimension + 2)), rel=2e-3
        )
    assert conduction_moment(plane, 1.0) == pytest.approx(
        conduction_moment(Wendland(2, 1.2e-6), 1e-6), rel=1e-12
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_moments_tend_to_one(dimension):
    # the sums are quadratures of exact moments, good to 1e-3 at h/dx 3; the viscosity's softening r^2 + 0.01 h^2
    # takes 2 % of its moment whatever the resolution
    kernel = Wendland(dimension, 3.0)
    assert conduction_moment(kernel, 1.0) == pytest.approx(1.0, abs=1e-3)
    assert shepard_sum(kernel, 1.0) == pytest.approx(1.0, abs=1e-3)
    printed = (dimension + 2) * viscous_moment(kernel, 0.01 * kernel.h**2, 1.0)
    assert printed == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(("dimension", "softening"), [(2, 6.45), (3, 4.0)])
def test_the_isotropic_softening_is_isotropic(dimension, softening):
    """Shear along the rows of a lattice and at 45 degrees see the same viscosity, in any unit of length."""
    for dx in (1.0, 1e-6):
        kernel = Wendland(dimension, 1.2 * dx)
        found = isotropic_softening(kernel, dx)
        assert found / kernel.h**2 == pytest.approx(softening, abs=5e-3)  # half a digit of the docstring's
        along, across = viscous_moments(kernel, found, dx)
        assert along == pytest.approx(across, rel=1e-12)
        assert viscous_moment(kernel, found, dx) == pytest.approx(along, rel=1e-12)


def test_depths_below_a_flat_surface_of_the_method_page():
    surface = Wendland(2, 1.8)
    flat = flat_surface(surface, Wendland(2, 1.2), 1.0)
    assert flat.largest == pytest.approx(1.4854, abs=5e-5)
    printed = [2.000, 1.100, 0.907, 0.764, 0.641, 0.524, 0.407, 0.274, 0.0]
    # half a unit of the printed digit, and the table's own interpolation
    assert flat.depth[::32] / surface.h == pytest.approx(printed, abs=1e-3)
    assert (np.diff(flat.depth) <= 0).all()
    # far inside all neighbours are there; the sum of a lattice's outermost layer, which sees 0.896 of the largest
    # |grad c|, is 0.823 (the integral over a half space would say 0.768, and a lattice would count as too dense)
    assert np.interp(0.8963, np.linspace(0, 1, 257), flat.shepard) == pytest.approx(0.823, abs=2e-3)
    assert (np.diff(flat.shepard) <= 0).all()
    assert flat.shepard[0] == pytest.approx(shepard_sum(Wendland(2, 1.2), 1.0))


@pytest.mark.parametrize("dimension", [2, 3])
def test_colour_gradient_of_a_lattice_follows_the_table(dimension):
    """2 Sum V grad W over a half space of particles, at several depths: the table is its continuum."""
    surface = Wendland(dimension, 1.8)
    flat = flat_surface(surface, Wendland(dimension, 1.2), 1.0)
    axes = [np.arange(-4.0, 5.0)] * (dimension - 1) + [np.arange(8) + 0.5]
    points = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    shares = []
    for layer in range(4):
        r = (layer + 0.5) * np.eye(dimension)[-1] - points
        gradient = 2.0 * np.sum(surface.slope(np.linalg.norm(r, axis=1))[:, None] * r, axis=0)
        assert gradient[-1] >= -1e-12  # inward: the metal is on the side of the larger heights
        shares.append(surface.h * np.linalg.norm(gradient) / flat.largest)
    depth = np.interp(shares, np.linspace(0.0, 1.0, len(flat.depth)), flat.depth)
    # a lattice of h/dx 1.8 samples the kernel coarsely: the two layers that have a normal come out within a tenth
    # of a spacing (found: 0.06), the third within a fifth, where |grad c| is 2 % of a surface's
    assert depth[:2] == pytest.approx([0.5, 1.5], abs=0.1)
    assert depth[2] == pytest.approx(2.5, abs=0.2)
    assert depth[3] == pytest.approx(surface.support)  # beyond reach


# --------------------------------------------------------------------------- lists against brute force


def listed(rows, particles, name="near"):
    """The list of each particle as a set; no neighbour stands in it twice."""
    count, lists = getattr(rows, f"{name}_count").to_numpy(), getattr(rows, name).to_numpy()
    found = {int(a): set(lists[a, : count[a]].tolist()) for a in particles}
    assert all(len(found[int(a)]) == count[a] for a in particles)
    return found


def active(rows):
    """Every particle that has a list: the flow rows, then the hot ones that are not among them."""
    flow, hot = rows.rows.to_numpy()[: rows.flow], rows.hot_rows.to_numpy()[: rows.hot]
    assert len(set(hot.tolist())) == rows.hot
    return np.concatenate([flow, hot[~np.isin(hot, flow)]])


def check_lists(sim, near, far):
    """Rows are groups of distinct particles; their lists are those of a brute-force search at this instant.

    Lists among still particles end with the kernel: there is no skin for what does not move.
    """
    rows, x = sim.rows, sim.position
    mobility = sim.state.array("mobility")
    order = active(rows)
    assert len(set(order.tolist())) == len(order)
    assert set(order[: rows.mobile].tolist()) == set(np.flatnonzero(mobility == MOBILE).tolist())
    assert (mobility[order[rows.mobile :]] == STILL).all()
    tree = cKDTree(x)
    mine = listed(rows, order)
    radius = np.where(np.arange(len(order)) < rows.flow, near, sim.disc.flow_kernel.support)
    for a, found in zip(order, tree.query_ball_point(x[order], radius), strict=True):
        assert mine[int(a)] == set(found) - {int(a)}
    shell = order[: rows.flow]
    outer = listed(rows, shell, "far")
    for a, found in zip(shell, tree.query_ball_point(x[shell], far), strict=True):
        assert outer[int(a)] == set(found) - mine[int(a)] - {int(a)}
    return order


def radii(sim):
    skin = sim.config.performance.skin * sim.config.spacing
    return sim.disc.flow_kernel.support + skin, sim.disc.surface_kernel.support + skin


@pytest.mark.parametrize("dimension", [3, pytest.param(2, marks=pytest.mark.slow)])
def test_lists_of_a_random_droplet(configure, dimension):
    config = configure(
        dimension=dimension,
        spacing=5 * UM,
        bodies=[{"shape": "droplet", "centre": [0.0] * dimension, "radius": [0, 0, 60, 25][dimension] * UM,
                 "temperature": 2200}],
        numerics={"minimum_neighbours": 0},
    )  # fmt: skip
    sim = Simulation(config)
    rng = np.random.default_rng(3)
    scattered = sim.position + rng.uniform(-1.5, 1.5, sim.position.shape) * UM
    sim.state.load(position=scattered)
    sim.activity.forget()
    sim.activity.build()
    order = check_lists(sim, *radii(sim))
    assert len(order) == sim.scene.count == sim.rows.mobile
    again = [sim.rows.rows.to_numpy(), sim.rows.near.to_numpy()]
    sim.activity.forget()
    sim.activity.build()  # the same positions give the same lists in the same order
    assert np.array_equal(again[0], sim.rows.rows.to_numpy())
    assert np.array_equal(again[1], sim.rows.near.to_numpy())
    # after motion by less than half a skin everybody within the support is still in the lists
    step = rng.normal(size=scattered.shape)
    step *= 0.499 * config.performance.skin * config.spacing / np.linalg.norm(step, axis=1, keepdims=True)
    moved = cKDTree(scattered + step)
    near, wide = listed(sim.rows, order), listed(sim.rows, order, "far")
    for a, found in enumerate(moved.query_ball_point(scattered + step, sim.disc.flow_kernel.support)):
        assert set(found) - {a} <= near[a]
    for a, found in enumerate(moved.query_ball_point(scattered + step, sim.disc.surface_kernel.support)):
        assert set(found) - {a} <= near[a] | wide[a]


@pytest.fixture(scope="module")
def half_molten(configure):
    """A block of steel, its left third molten, the rest cold."""
    return configure(
        spacing=5 * UM,
        bodies=[
            {**STEEL_BOX, "temperature": 2200},
            {**STEEL_BOX, "corner": [60 * UM, 0], "size": [240 * UM, 60 * UM]},
        ],
        physics={"marangoni": False, "viscous_heating": False, "radiation": False},
        numerics={"minimum_neighbours": 0},
    )


def test_rows_of_a_half_molten_block(half_molten):
    sim = Simulation(half_molten)
    sim.activity.build()
    near, far = radii(sim)
    order = check_lists(sim, near, far)
    rows, x = sim.rows, sim.position
    molten = np.flatnonzero(sim.state.array("mobility") == MOBILE)
    still = np.flatnonzero(sim.state.array("mobility") == STILL)
    beside = still[cKDTree(x[molten]).query(x[still])[0] < far]
    assert set(order[rows.mobile : rows.flow].tolist()) == set(beside.tolist())
    # whoever is within the support of a warm particle exchanges heat, and so is in a row
    warm = np.abs(sim.temperature - 293.0) > 1e-3
    touched = cKDTree(x[warm]).query(x)[0] < sim.disc.flow_kernel.support
    assert set(np.flatnonzero(touched).tolist()) <= set(order.tolist())
    assert len(order) < sim.scene.count  # and the far end is left out

    # after steps of flow and heat: nobody within the support is missing from a list, no warm one from the rows
    before = sim.activity.builds
    for _ in range(40):
        sim.step()
    assert sim.activity.builds > before
    x = sim.position
    order = active(rows)
    warm = np.abs(sim.temperature - 293.0) > 1e-3
    assert warm.sum() > len(molten)
    assert set(np.flatnonzero(warm).tolist()) <= set(order.tolist())
    tree, mine = cKDTree(x), listed(rows, order)
    for a, found in zip(order, tree.query_ball_point(x[order], sim.disc.flow_kernel.support), strict=True):
        assert set(found) - {int(a)} <= mine[int(a)]
    displaced = np.linalg.norm(x - sim.state.array("reference_position"), axis=1)
    mobile = sim.state.array("mobility") == MOBILE
    assert displaced[mobile].max() > 0
    # a row may leave the skin during the one step after which its list is made anew
    assert displaced[mobile].max() < 0.6 * half_molten.performance.skin * half_molten.spacing


def test_lists_among_still_particles_have_no_skin(configure):
    """A third of a cubic lattice's: 56 neighbours within the support 2.4 dx, 80 within the skin."""
    box = {"shape": "box", "corner": [0, 0, 0], "size": [60 * UM, 60 * UM, 60 * UM], "temperature": 900}
    sim = Simulation(configure(dimension=3, spacing=5 * UM, bodies=[{**STEEL_BOX, **box}]))
    sim.compile()
    check_lists(sim, *radii(sim))
    assert np.bincount(sim.rows.near_count.to_numpy()).argmax() == 56


def test_lists_that_follow_are_those_chosen_anew(half_molten):
    """A jet that crosses cells, particles that melt, freeze and are removed: no list knows how it was made.

    Some lie where they were, some move a little, and keep their lists; all lists are those of the references.
    """
    sim = Simulation(half_molten)
    sim.compile()
    rng = np.random.default_rng(1)
    half_skin = 0.5 * half_molten.performance.skin * half_molten.spacing
    anew, searched = 0, []
    for _ in range(12):
        position, temperature = sim.position, sim.temperature
        mobile = sim.state.array("mobility") == MOBILE
        spread = np.where(position[mobile, 0] < 15 * UM, 2 * UM, 0.05 * UM)
        position[mobile] += spread[:, None] * rng.normal(size=(mobile.sum(), 2))
        gone = int(rng.choice(np.flatnonzero(mobile)))
        mobility = sim.state.array("mobility")
        mobility[gone] = REMOVED
        frozen = rng.choice(np.flatnonzero(mobile), 3)
        mobility[frozen[frozen != gone]] = STILL
        sim.state.load(position=position, temperature=temperature, mobility=mobility)
        before = sim.rows.choices
        sim.activity.build()
        anew += sim.rows.choices - before
        followed = [sim.rows.rows.to_numpy()[: sim.rows.flow], sim.rows.near_count.to_numpy(),
                    sim.rows.near.to_numpy(), sim.rows.far_count.to_numpy(), sim.rows.far.to_numpy()]  # fmt: skip
        searched.append(sim.rows.searched)
        reference, there = sim.state.array("reference_position"), sim.state.array("mobility") != REMOVED
        off = np.linalg.norm(reference - position, axis=1)
        assert off[there].max() <= AHEAD * half_skin * (1 + 1e-12)  # at most the lead, or what is left to go
        assert (off[sim.state.array("mobility") == STILL] == 0.0).all()
        sim.state.load(position=np.where(there[:, None], reference, position))
        sim.activity.forget()
        sim.activity.build()
        sim.state.load(position=position)
        mine, theirs = followed[0], sim.rows.rows.to_numpy()[: sim.rows.flow]
        assert set(mine.tolist()) == set(theirs.tolist())
        names = ("near_count", "near", "far_count", "far")
        lists = dict(zip(names, followed[1:], strict=True))
        for name in ("near", "far"):
            count, now = getattr(sim.rows, f"{name}_count").to_numpy(), getattr(sim.rows, name).to_numpy()
            assert np.array_equal(count[mine], lists[f"{name}_count"][mine])
            assert all(np.array_equal(now[a, : count[a]], lists[name][a, : count[a]]) for a in mine)
    assert anew < 12  # and most of them did follow
    assert min(searched) < 0.7 * sim.rows.flow  # those far from the jet kept theirs


def test_lists_of_what_flies_last_for_almost_the_whole_skin(configure):
    """A drop that flies past a plate: its lists are good over 1.6 half skins of way, as they lie ahead of it.

    Made where the particles are they were good over one.
    """
    drop = {
        "shape": "droplet",
        "centre": [0, 100 * UM],
        "radius": 40 * UM,
        "temperature": 2500,
        "velocity": [2, 0],
    }
    plate = {"shape": "plate", "length": 0.4e-3, "depth": 20 * UM}
    sim = Simulation(configure(spacing=5 * UM, bodies=[drop, plate], physics={"heat": False}))
    sim.advance(5e-6)
    builds, begun = sim.activity.builds, sim.time
    sim.advance(60e-6)
    half_skin = 0.5 * sim.config.performance.skin * sim.config.spacing
    way = 2.0 * (sim.time - begun) / (sim.activity.builds - builds)
    assert 1.4 * half_skin < way < 2.0 * half_skin  # the drop is not quite rigid; the skin has two halves


# --------------------------------------------------------------------------- what must be an error


def choose(sim):
    """Lists for particles that were put elsewhere by hand, the still ones too."""
    sim.activity.forget()
    sim.activity.build()


def crowd(sim, count, place, spread):
    """Put the first ``count`` particles around ``place`` [m], within ``spread`` [m] on every axis, all sides alike."""
    x = sim.position
    side = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]])[np.arange(count) % 4]
    x[:count] = place + side * np.random.default_rng(0).uniform(0.0, spread, (count, 2))
    sim.state.load(position=x)


def test_crowds_and_lost_particles_are_errors_and_nothing_is_cut_off(half_molten):
    sim = Simulation(half_molten)
    sim.activity.build()
    cells, rows, start = sim.activity.cells, sim.rows, sim.position
    origin = sim.scene.lower - 2.0 * sim.config.spacing
    corner = origin + 6 * cells.size  # of four cells, within the molten part

    crowd(sim, cells.capacity + 1, corner + 0.5 * cells.size, 0.1 * UM)
    with pytest.raises(BlowUpError, match=r"cell is full.*\(particle \d+ at .* um, .* um\)"):
        choose(sim)

    # a crowd around a corner fills four cells by a part each, and the lists of all of its members
    sim.state.load(position=start)
    crowd(sim, rows.near_capacity + 2, corner, 0.3 * UM)
    with pytest.raises(BlowUpError, match=r"neighbour list is full.*\(particle \d+ at"):
        choose(sim)

    # one less than an overflow, with nobody around: no error, and nobody is missing
    sim.state.load(position=start)
    count = rows.near_capacity + 1  # each of them has `near_capacity` neighbours in the crowd
    steps = np.floor((sim.scene.upper - 3 * sim.config.spacing - origin) / cells.size)
    crowd(sim, count, origin + steps * cells.size, 0.3 * UM)
    choose(sim)
    assert rows.near_count.to_numpy()[:count].tolist() == [rows.near_capacity] * count
    check_lists(sim, *radii(sim))

    # the room in the lists: the whole melt squeezed to 1.45 times its density (near ones hold 43, of 24 on a lattice)
    x = start.copy()
    molten = sim.state.array("mobility") == MOBILE
    x[molten] = x[molten].mean(axis=0) + (x[molten] - x[molten].mean(axis=0)) / math.sqrt(1.45)
    sim.state.load(position=x)
    choose(sim)
    check_lists(sim, *radii(sim))

    for lost, place in (([np.nan, np.nan], "nan um, nan um"), ([np.inf, 0.0], "inf um, 0.00 um")):
        x = start.copy()
        x[17] = lost
        sim.state.load(position=x)
        with pytest.raises(BlowUpError, match=rf"no finite place \(particle 17 at {place}\)"):
            choose(sim)
    sim.state.load(position=start)
    choose(sim)  # and it was only that
    check_lists(sim, *radii(sim))

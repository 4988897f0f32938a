"""The surface passes: colour gradient, normals, curvature, forces.

Both walk the wide lists (support 2 h_s). Between two builds of the lists only the rows near the surface are
visited: a particle farther inside than the reach of its kernel has no colour gradient.
"""

from typing import Any

from taichi_slm.backend import direct, handed_out, ti
from taichi_slm.physics.continuity import flat_table
from taichi_slm.physics.evaporation import vapour
from taichi_slm.physics.marangoni import missing_stress, renormalised_gradient, tangential_force
from taichi_slm.physics.surface_tension import surface_curvature, surface_weight
from taichi_slm.physics.viscosity import viscous_weight
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.solver.ledger import CURVATURE_CLIPS, SINGULAR_GRADIENTS, Ledger
from taichi_slm.sph.cells import Cells
from taichi_slm.sph.neighbours import Neighbours
from taichi_slm.sph.symmetric import symmetric
from taichi_slm.state import MOBILE, State

INSIDE = 0.02  # below this share of a flat surface's h_s |grad c| a row is inside: no normal for many steps


class SurfacePasses:
    """Colour gradient of the active rows, surface forces of the mobile ones."""

    def __init__(self, state: State, cells: Cells, rows: Neighbours, disc: Discretisation, ledger: Ledger,
                 evaporations: tuple[Any, ...], skip_interior: bool):  # fmt: skip
        self._rows = rows
        self._near_surface = ti.field(ti.i32, shape=state.count)  # row numbers
        self._ends = ti.field(ti.i32, shape=2)  # mobile rows near the surface, all rows near the surface
        self.mobile = self.flow = 0
        self.evaluations = 0  # of curvature and surface force so far: what the clips are a share of
        self._skip_interior = skip_interior
        self._schedule = disc.schedule
        pair, store = _colour_gradient(state, disc)
        self._colour_all = self._compile_colour_everywhere(state, cells, disc, pair, store)
        self._colour = self._compile_colour(state, rows, pair, store)
        self._select = self._compile_select(state, rows, disc)
        if state.needs.tension:
            self._forces = self._compile_forces(state, rows, disc, ledger, evaporations)
        self._tension = state.needs.tension

    def colour_everywhere(self) -> None:
        """Colour gradient of every particle from the cells, once at the start."""
        self._colour_all()

    def refresh(self) -> None:
        """After the lists were built: colour gradient of all flow rows, and which of them are near the surface."""
        self._select(self._rows.mobile, self._rows.flow, 0)
        self._colour(self._rows.flow, self._schedule.alone(self._rows.flow))
        self._select(self._rows.mobile, self._rows.flow, int(self._skip_interior))
        self.mobile, self.flow = int(self._ends[0]), int(self._ends[1])

    def step(self) -> None:
        """Colour gradient near the surface, then the forces of the mobile rows there."""
        self._colour(self.flow, self._schedule.alone(self.flow))
        if self._tension:
            self._forces(self.mobile, self._schedule.alone(self.mobile))
            self.evaluations += self.mobile

    def _compile_colour_everywhere(
        self, state: State, cells: Cells, disc: Discretisation, pair: Any, store: Any
    ) -> Any:
        support2 = disc.surface_kernel.support**2
        window = cells.window(cells.reach(disc.surface_kernel.support))

        @direct
        @ti.kernel
        def colour_all():
            for a in range(state.count):
                c = cells.cell_of(state.position[a])
                total = state.position[a] * 0.0
                for w in range(window.shape[0]):
                    e = c + window[w]
                    for slot in range(cells.count[e]):
                        b = cells.items[e, slot]
                        if b != a and (state.position[a] - state.position[b]).norm_sqr() < support2:
                            total += pair(a, b)
                store(a, total, state.mobility[a] == MOBILE)

        return colour_all

    def _compile_colour(self, state: State, rows: Neighbours, pair: Any, store: Any) -> Any:
        near_surface, lists = self._near_surface, _both_lists(rows)

        @handed_out
        @ti.kernel
        def colour(count: ti.i32, alone: ti.template()):
            ti.loop_config(serialize=alone)
            for i in range(count):
                a = rows.rows[near_surface[i]]
                total = state.position[a] * 0.0
                for length, items, _ in ti.static(lists):
                    for j in range(length[a]):
                        total += pair(a, items[a, j])
                store(a, total, True)

        return colour

    def _compile_select(self, state: State, rows: Neighbours, disc: Discretisation) -> Any:
        inside = INSIDE * disc.flat.largest / disc.h_surface
        needs, near_surface, ends = state.needs, self._near_surface, self._ends
        ordered = disc.schedule.ordered

        @direct
        @ti.kernel
        def select(mobile: ti.i32, flow: ti.i32, skip: ti.i32):
            ends[0] = 0
            ti.loop_config(serialize=ordered)
            for k in range(mobile):
                a = rows.rows[k]
                if skip == 0 or state.colour_strength[a] > inside:
                    near_surface[ti.atomic_add(ends[0], 1)] = k
                elif ti.static(needs.tension):
                    nothing = state.position[a] * 0.0
                    state.surface_force[a] = nothing
                    if ti.static(needs.balanced):
                        state.tangential_force[a] = nothing
                        state.at_surface[a] = 0.0
            ends[1] = ends[0]
            ti.loop_config(serialize=ordered)
            for k in range(mobile, flow):
                if skip == 0 or state.colour_strength[rows.rows[k]] > inside:
                    near_surface[ti.atomic_add(ends[1], 1)] = k

        return select

    def _compile_forces(self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger,
                        evaporations: tuple[Any, ...]) -> Any:  # fmt: skip
        numerics, physics, balanced = disc.numerics, disc.physics, state.needs.balanced
        curvature = surface_curvature(
            disc.dimension, disc.h_surface, numerics.depth_correction, numerics.curvature_clip == "two_sided",
            flat_table(disc.flat.depth, disc.flat, disc.h_surface, disc.real),
        )  # fmt: skip
        sums = _neighbourhood(state, rows, disc)
        along = _marangoni(state, disc, ledger) if physics.marangoni else None
        recoil = vapour(evaporations, disc.real)[1] if physics.recoil else None
        weight_of = surface_weight(disc.h_surface, numerics.normal_cut)
        clamps, near_surface = ledger.clamps, self._near_surface

        @handed_out
        @ti.kernel
        def forces(count: ti.i32, alone: ti.template()):
            ti.loop_config(serialize=alone)
            for i in range(count):
                a = rows.rows[near_surface[i]]
                force = state.position[a] * 0.0
                kappa = state.position[a][0] * 0.0
                capillary, at_surface = kappa, kappa
                if state.mobility[a] == MOBILE and state.normal[a].norm_sqr() > 0.5:
                    strength = state.colour_strength[a]
                    divergence, weight, gamma, differences, moment, missing = sums(a)
                    clipped = 0
                    kappa, clipped = curvature(divergence, weight, strength)
                    if clipped:
                        ti.atomic_add(clamps[CURVATURE_CLIPS], 1)
                    if ti.static(physics.surface_tension and not balanced):
                        force = -state.surface_tension[a] * kappa * state.colour_gradient[a]
                    if ti.static(physics.marangoni):
                        force += along(a, gamma, differences, moment, missing)
                    if ti.static(balanced):
                        capillary = -state.surface_tension[a] * kappa
                        at_surface = weight_of(strength)
                    if ti.static(numerics.surface_times_liquid):
                        force *= state.liquid_fraction[a]
                        capillary *= state.liquid_fraction[a]
                    if ti.static(physics.recoil):
                        pushed = recoil(state.material[a], state.temperature[a])
                        if ti.static(balanced):
                            capillary += pushed
                        else:
                            force += pushed * state.colour_gradient[a]
                state.curvature[a] = kappa
                if ti.static(balanced):
                    state.tangential_force[a] = force
                    state.capillary[a] = capillary
                    state.at_surface[a] = at_surface
                else:
                    state.surface_force[a] = force

        return forces


def _both_lists(rows: Neighbours) -> tuple[tuple[Any, Any, bool], ...]:
    """(lengths, members, whether near) of the near and of the far lists: a loop over these is compiled twice."""
    near = (rows.near_count, rows.near, True)
    return (
        (near, (rows.far_count, rows.far, False)) if rows.far_capacity else (near,)
    )  # no far ones without flow


def _colour_gradient(state: State, disc: Discretisation) -> tuple[Any, Any]:
    """The Taichi functions (a, b) -> what b adds to the colour gradient of a, and (a, gradient, whether
    the flow is near), which stores it."""
    _, F = disc.surface_kernel.functions()
    gamma_form = disc.uses_shepard and disc.numerics.colour_gradient == "gamma"
    cut = disc.numerics.normal_cut / disc.h_surface

    @ti.func
    def pair(a, b):
        r = state.position[a] - state.position[b]
        factor = 2.0 * state.volume[b]
        if ti.static(gamma_form):  # (20) as printed
            factor = state.volume[b] * (1.0 / state.shepard[a] + 1.0 / state.shepard[b])
        return factor * F(r.norm_sqr()) * r

    @ti.func
    def store(a, gradient, near):
        strength = gradient.norm()
        normal = gradient * 0.0
        if strength > cut:
            normal = gradient / strength
        if ti.static(state.needs.body_force):
            if near:  # cold metal needs no more than the two below
                state.colour_gradient[a] = gradient
        # inside cold metal, where round-off is left of the sum, both stay zero and take no memory
        if strength > 1e-6 * cut or state.colour_strength[a] > 0.0:
            state.colour_strength[a] = strength
            state.normal[a] = normal

    return pair, store


def _neighbourhood(state: State, rows: Neighbours, disc: Discretisation) -> Any:
    """The Taichi function a -> its six sums over both lists.

    Divergence of the normals, weight of those that have one, Shepard sum, differences of temperature times grad W,
    moment matrix; and the missing stress, which has the near list's support.
    """
    W, F = disc.surface_kernel.functions()
    at_zero = float(disc.surface_kernel.value(0.0))
    printed, lists = disc.numerics.curvature == "printed", _both_lists(rows)
    form, corrected = disc.numerics.viscosity_form, disc.numerics.viscosity_correction
    missing_of = missing_stress(
        disc.flow_kernel.functions()[1], viscous_weight(disc.flow_kernel, form, corrected, disc.dx)
    )
    by_missing_stress = state.needs.balanced and disc.physics.marangoni
    products, matrix = symmetric(disc.dimension)

    @ti.func
    def sums(a):
        x, T, normal = state.position[a], state.temperature[a], state.normal[a]
        divergence = x[0] * 0.0
        weight = state.volume[a] * at_zero
        gamma = weight
        differences = x * 0.0
        moment = products(differences)
        missing = moment
        for length, items, near in ti.static(lists):
            for j in range(length[a]):
                b = items[a, j]
                r = x - state.position[b]
                r2 = r.norm_sqr()
                slope = state.volume[b] * F(r2)
                has = ti.cast(state.normal[b].norm_sqr() > 0.5, disc.real)
                counts = has
                if ti.static(printed):
                    counts = 1.0
                divergence += counts * slope * (state.normal[b] - normal).dot(r)
                weight += has * state.volume[b] * W(r2)
                gamma += state.volume[b] * W(r2)
                differences += slope * (state.temperature[b] - T) * r
                moment -= slope * products(r)
                if ti.static(near and by_missing_stress):
                    missing += missing_of(state.volume[b], normal, r) * products(r)
        return divergence, weight, gamma, differences, matrix(moment), matrix(missing)

    return sums


def _marangoni(state: State, disc: Discretisation, ledger: Ledger) -> Any:
    """The Taichi function (a, four of its sums) -> the Marangoni force [N/m^d]."""
    renormalise, balanced = disc.numerics.temperature_gradient == "renormalised", state.needs.balanced
    gradient_of, tangential = renormalised_gradient(disc.dimension), tangential_force()
    clamps = ledger.clamps

    @ti.func
    def force(a, gamma, differences, moment, missing):
        slope, normal = state.surface_tension_slope[a], state.normal[a]
        gradient = differences / gamma
        if ti.static(renormalise):
            singular = 0
            gradient, singular = gradient_of(differences, moment)
            if singular:
                ti.atomic_add(clamps[SINGULAR_GRADIENTS], 1)
        result = normal * 0.0
        if ti.static(balanced):
            result = missing @ tangential(slope, gradient, normal, 1.0)
        else:
            result = tangential(slope, gradient, normal, state.colour_strength[a])
        return result

    return force

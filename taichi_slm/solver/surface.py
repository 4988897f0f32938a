"""The surface passes: colour gradient, normals, curvature, forces.

Both walk the wide lists (support 2 h_s). Between two builds of the lists only the rows near the surface are
visited: a particle farther inside than the reach of its kernel has no colour gradient.
"""

from typing import Any

from taichi_slm.backend import ti
from taichi_slm.physics.continuity import flat_table
from taichi_slm.physics.evaporation import vapour
from taichi_slm.physics.marangoni import missing_stress, renormalised_gradient, tangential_force
from taichi_slm.physics.surface_tension import surface_curvature, surface_weight
from taichi_slm.physics.viscosity import viscous_weight
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.solver.ledger import CURVATURE_CLIPS, SINGULAR_GRADIENTS, Ledger
from taichi_slm.sph.cells import Cells
from taichi_slm.sph.neighbours import Neighbours
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
        self._ordered = disc.ordered
        self._colour_all, self._colour, self._select = self._compile_colour(state, cells, rows, disc)
        if state.needs.tension:
            self._forces = self._compile_forces(state, rows, disc, ledger, evaporations)
        self._tension = state.needs.tension

    def colour_everywhere(self) -> None:
        """Colour gradient of every particle from the cells, once at the start."""
        self._colour_all()

    def refresh(self) -> None:
        """After the lists were built: colour gradient of all flow rows, and which of them are near the surface."""
        self._select(self._rows.mobile, self._rows.flow, 0)
        self._colour(self._rows.flow)
        self._select(self._rows.mobile, self._rows.flow, int(self._skip_interior))
        self.mobile, self.flow = (int(n) for n in self._ends.to_numpy())

    def step(self) -> None:
        """Colour gradient near the surface, then the forces of the mobile rows there."""
        self._colour(self.flow)
        if self._tension:
            self._forces(self.mobile)
            self.evaluations += self.mobile

    def _compile_colour(self, state: State, cells: Cells, rows: Neighbours, disc: Discretisation) -> Any:
        numerics = disc.numerics
        _, F = disc.surface_kernel.functions()
        gamma_form = disc.uses_shepard and numerics.colour_gradient == "gamma"
        cut = numerics.normal_cut / disc.h_surface
        support2 = disc.surface_kernel.support**2
        window = cells.window(cells.reach(disc.surface_kernel.support))
        inside = INSIDE * disc.flat.largest / disc.h_surface
        serial, ordered = disc.serial, disc.ordered
        near_surface, ends = self._near_surface, self._ends
        balanced = state.needs.balanced

        @ti.func
        def store(a, gradient):
            strength = gradient.norm()
            normal = gradient * 0.0
            if strength > cut:
                normal = gradient / strength
            state.colour_gradient[a] = gradient
            state.colour_strength[a] = strength
            state.normal[a] = normal

        @ti.func
        def pair(a, b):
            """Contribution of b to the colour gradient of a; c = 1 in the metal."""
            r = state.position[a] - state.position[b]
            factor = 2.0 * state.volume[b]
            if ti.static(gamma_form):  # (20) as printed
                factor = state.volume[b] * (1.0 / state.shepard[a] + 1.0 / state.shepard[b])
            return factor * F(r.norm_sqr()) * r

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
                store(a, total)

        @ti.kernel
        def colour(count: ti.i32):
            ti.loop_config(serialize=serial)
            for i in range(count):
                k = near_surface[i]
                a = rows.rows[k]
                total = state.position[a] * 0.0
                for j in range(rows.near_count[a]):
                    total += pair(a, rows.near[a, j])
                for j in range(rows.far_count[a]):
                    total += pair(a, rows.far[a, j])
                store(a, total)

        @ti.kernel
        def select(mobile: ti.i32, flow: ti.i32, skip: ti.i32):
            ends[0] = 0
            ti.loop_config(serialize=ordered)
            for k in range(mobile):
                if skip == 0 or state.colour_strength[rows.rows[k]] > inside:
                    near_surface[ti.atomic_add(ends[0], 1)] = k
                elif ti.static(state.needs.tension):
                    still = state.position[rows.rows[k]] * 0.0
                    state.surface_force[rows.rows[k]] = still
                    if ti.static(balanced):
                        state.tangential_force[rows.rows[k]] = still
                        state.at_surface[rows.rows[k]] = 0.0
            ends[1] = ends[0]
            ti.loop_config(serialize=ordered)
            for k in range(mobile, flow):
                if skip == 0 or state.colour_strength[rows.rows[k]] > inside:
                    near_surface[ti.atomic_add(ends[1], 1)] = k

        return colour_all, colour, select

    def _compile_forces(self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger,
                        evaporations: tuple[Any, ...]) -> Any:  # fmt: skip
        numerics, physics, d = disc.numerics, disc.physics, disc.dimension
        W, F = disc.surface_kernel.functions()
        curvature = surface_curvature(
            d, disc.h_surface, numerics.depth_correction, numerics.curvature_clip == "two_sided",
            flat_table(disc.flat.depth, disc.flat, disc.h_surface, disc.real),
        )  # fmt: skip
        marangoni = physics.marangoni
        renormalise = numerics.temperature_gradient == "renormalised"
        gradient_of, tangential = renormalised_gradient(d), tangential_force()
        recoil = vapour(evaporations, disc.real)[1] if physics.recoil else None
        printed = numerics.curvature == "printed"
        times_liquid = numerics.surface_times_liquid
        at_zero = float(disc.surface_kernel.value(0.0))
        serial, clamps, near_surface = disc.serial, ledger.clamps, self._near_surface
        balanced = state.needs.balanced

        _, F_flow = disc.flow_kernel.functions()
        form, corrected = numerics.viscosity_form, numerics.viscosity_correction
        missing_of = missing_stress(F_flow, viscous_weight(disc.flow_kernel, form, corrected, disc.dx))
        weight_of = surface_weight(disc.h_surface, numerics.normal_cut)

        @ti.func
        def pair(a, b, normal, T):
            """Contributions of b: normals' divergence, weight with a normal, temperature gradient, moment, Shepard."""
            r = state.position[a] - state.position[b]
            r2 = r.norm_sqr()
            slope = state.volume[b] * F(r2)
            weight = state.volume[b] * W(r2)
            has = ti.cast(state.normal[b].norm_sqr() > 0.5, disc.real)
            counts = has
            if ti.static(printed):
                counts = 1.0
            divergence = counts * slope * (state.normal[b] - normal).dot(r)
            plain = slope * (state.temperature[b] - T) * r
            moment = -slope * r.outer_product(r)
            return divergence, has * weight, plain, moment, weight

        @ti.kernel
        def forces(count: ti.i32):
            ti.loop_config(serialize=serial)
            for i in range(count):
                k = near_surface[i]
                a = rows.rows[k]
                force = state.position[a] * 0.0
                kappa = state.position[a][0] * 0.0
                capillary = kappa
                at_surface = kappa
                normal = state.normal[a]
                if state.mobility[a] == MOBILE and normal.norm_sqr() > 0.5:
                    T = state.temperature[a]
                    strength = state.colour_strength[a]
                    divergence = kappa
                    weight = state.volume[a] * at_zero
                    gamma = weight
                    plain = force
                    moment = force.outer_product(force)
                    missing = moment
                    for j in range(rows.near_count[a]):
                        b = rows.near[a, j]
                        v, w, p, m, g = pair(a, b, normal, T)
                        if ti.static(balanced and marangoni):
                            missing += missing_of(
                                state.volume[b], normal, state.position[a] - state.position[b]
                            )
                        divergence += v
                        weight += w
                        plain += p
                        moment += m
                        gamma += g
                    for j in range(rows.far_count[a]):
                        v, w, p, m, g = pair(a, rows.far[a, j], normal, T)
                        divergence += v
                        weight += w
                        plain += p
                        moment += m
                        gamma += g
                    clipped = 0
                    kappa, clipped = curvature(divergence, weight, strength)
                    if clipped:
                        ti.atomic_add(clamps[CURVATURE_CLIPS], 1)
                    if ti.static(physics.surface_tension and not balanced):
                        force = -state.surface_tension[a] * kappa * state.colour_gradient[a]
                    if ti.static(marangoni):
                        gradient = plain / gamma
                        if ti.static(renormalise):
                            singular = 0
                            gradient, singular = gradient_of(plain, moment)
                            if singular:
                                ti.atomic_add(clamps[SINGULAR_GRADIENTS], 1)
                        if ti.static(balanced):
                            stress = tangential(state.surface_tension_slope[a], gradient, normal, 1.0)
                            force += missing @ stress
                        else:
                            force += tangential(state.surface_tension_slope[a], gradient, normal, strength)
                    if ti.static(balanced):
                        capillary = -state.surface_tension[a] * kappa
                        at_surface = weight_of(strength)
                    if ti.static(times_liquid):
                        force *= state.liquid_fraction[a]
                        capillary *= state.liquid_fraction[a]
                    if ti.static(physics.recoil):
                        if ti.static(balanced):
                            capillary += recoil(state.material[a], T)
                        else:
                            force += recoil(state.material[a], T) * state.colour_gradient[a]
                state.curvature[a] = kappa
                if ti.static(balanced):
                    state.tangential_force[a] = force
                    state.capillary[a] = capillary
                    state.at_surface[a] = at_surface
                else:
                    state.surface_force[a] = force

        return forces

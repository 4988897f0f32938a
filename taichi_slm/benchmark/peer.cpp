// Passes of a 2-D step as plain loops over the same lists: what careful scalar C++ costs, without any trick.
// REAL is float or double. Compiled at run time by peer.py, which fills `Scene` with the simulation's own arrays.
// A pass that sums several things from one state is a template of them: our passes have all at once, `unfused` has a
// loop over the neighbours for each.

#include <algorithm>
#include <cmath>

using real = REAL;
using std::max;
using std::min;
using std::sqrt;

struct Scene {  // the order is that of peer.py
    // constants
    real h, alpha;                    // smoothing length [m] and kernel constant of flow and heat [1/m^2]
    real h_surface, alpha_surface;    // of the surface terms
    real moment;                      // lattice moment of the gradient [-]
    real softening, viscous_scale;    // of the viscous weight [m^2], [-]
    real gravity, sound_speed;        // [m/s^2], [m/s]
    real delta, packing;              // strengths of diffusion [m^2/s] and packing correction [1/s]
    real shifting, dt;                // [-], [s]
    real normal_cut;                  // [1/m]
    real singular;                    // determinant of a lone particle's moment matrix [-]
    real table_scale;                 // |grad c| [1/m] -> place in the table of a flat surface
    // sizes
    int mobile, hot, near_surface_count, surface_mobile, near_width, slopes_width, far_width, intervals;
    // lists
    const int *rows, *hot_rows, *near_surface, *near_count, *near, *far_count, *far, *mobility;
    // fields, SI; vectors are x, y, x, y ...
    const real *position, *velocity, *density, *reference_density, *volume, *pressure, *viscosity;
    const real *background, *tangential_force, *normal, *colour_strength, *kirchhoff, *conduction_factor;
    const real *temperature, *liquid_fraction, *surface_tension, *surface_tension_slope;
    const real *flat_shepard, *flat_depth;  // a flat surface's tables
    const real *slopes;                     // V F of every entry of `near`
    // results
    real *acceleration, *surface_force, *shift, *density_after;
    real *density_rate, *shepard, *background_mean;
    real *colour_strength_found, *normal_found;
    real *curvature, *tangential_found, *capillary, *at_surface;
    double *heating;
};

static inline real W(real r2, real alpha, real inverse_h) {
    real q = sqrt(r2) * inverse_h;
    real t = max(real(0), real(1) - real(0.5) * q);
    return alpha * t * t * t * t * (real(2) * q + real(1));
}

static inline real F(real r2, real slope, real inverse_h) {
    real t = max(real(0), real(1) - real(0.5) * inverse_h * sqrt(r2));
    return slope * t * t * t;
}

static inline real of_a_flat_surface(const Scene &s, const real *table, real strength) {
    real place = min(strength * s.table_scale, s.intervals * (1 - real(1e-6)));
    int knot = (int)place;
    return table[knot] + (place - knot) * (table[knot + 1] - table[knot]);
}

constexpr int FORCES = 1, ORDER = 2;  // pressure and viscosity; crowding and shear, for shift and surface force

template <int SUMS> static void momentum_of(const Scene &s) {
    const real inverse_h = 1 / s.h, slope_factor = -5 * s.alpha / (s.h * s.h), inverse_moment = 1 / s.moment;
    for (int k = 0; k < s.mobile; k++) {
        const int a = s.rows[k];
        const real x = s.position[2 * a], y = s.position[2 * a + 1];
        const real u = s.velocity[2 * a], v = s.velocity[2 * a + 1];
        const real p_a = s.pressure[a], mu_a = s.viscosity[a];
        real fx = 0, fy = 0, cx = 0, cy = 0, px = 0, py = 0, gxx = 0, gxy = 0, gyx = 0, gyy = 0;
        const int *list = s.near + (long)a * s.near_width;
        for (int j = 0; j < s.near_count[a]; j++) {
            const int b = list[j];
            const real rx = x - s.position[2 * b], ry = y - s.position[2 * b + 1];
            const real ux = u - s.velocity[2 * b], uy = v - s.velocity[2 * b + 1];
            const real r2 = rx * rx + ry * ry;
            const real slope = s.volume[b] * F(r2, slope_factor, inverse_h);
            const real p = (p_a + s.pressure[b]) * inverse_moment;
            if constexpr (SUMS & FORCES) {
                const real mu_b = s.viscosity[b];
                const real stress = 2 * mu_a * mu_b / (mu_a + mu_b + real(1e-30)) * (ux * rx + uy * ry)
                                    * s.viscous_scale / (r2 + s.softening);
                fx += slope * (stress - p) * rx;
                fy += slope * (stress - p) * ry;
            }
            if constexpr (SUMS & ORDER) {
                cx += slope * rx;
                cy += slope * ry;
                px += slope * p * rx;
                py += slope * p * ry;
                const real moving = s.mobility[b] == 1 ? slope : real(0);
                gxx -= moving * ux * rx;
                gxy -= moving * ux * ry;
                gyx -= moving * uy * rx;
                gyy -= moving * uy * ry;
            }
        }
        if constexpr (SUMS & ORDER) {
            const real behind = 2 * inverse_moment * s.background[a];
            s.surface_force[2 * a] = s.tangential_force[2 * a] + behind * cx;
            s.surface_force[2 * a + 1] = s.tangential_force[2 * a + 1] + behind * cy;
            const real off = real(0.5) * (gxy + gyx), mean = real(0.5) * (gxx + gyy);
            const real rate = sqrt(2 * max(real(0), gxx * gxx + gyy * gyy + 2 * off * off - 2 * mean * mean));
            real ax = cx, ay = cy;
            const real nx = s.normal[2 * a], ny = s.normal[2 * a + 1];
            if (nx * nx + ny * ny > real(0.5)) {
                const real along = cx * nx + cy * ny;
                ax = real(0.5) * (cx - along * nx);
                ay = real(0.5) * (cy - along * ny);
            }
            const real by = -min(s.shifting * s.h * s.h * rate * s.dt, real(0.1) * s.h * s.h);
            s.shift[2 * a] = by * ax;
            s.shift[2 * a + 1] = by * ay;
            s.density_after[a] = s.density[a] + by * (ax * (px - 2 * inverse_moment * p_a * cx)
                                                      + ay * (py - 2 * inverse_moment * p_a * cy))
                                                    / (s.sound_speed * s.sound_speed);
        }
        if constexpr (SUMS & FORCES) {
            s.acceleration[2 * a] = (fx + s.surface_force[2 * a]) / s.density[a];
            s.acceleration[2 * a + 1] = (fy + s.surface_force[2 * a + 1]) / s.density[a] - s.gravity;
        }
    }
}

extern "C" void momentum(const Scene *scene) { momentum_of<FORCES | ORDER>(*scene); }

constexpr int SHEPARD = 1, DIVERGENCE = 2, DIFFUSION = 4, BACKGROUND = 8;

template <int SUMS> static void continuity_of(const Scene &s) {
    const real inverse_h = 1 / s.h, slope_factor = -5 * s.alpha / (s.h * s.h);
    for (int k = 0; k < s.mobile; k++) {
        const int a = s.rows[k];
        const real x = s.position[2 * a], y = s.position[2 * a + 1];
        const real u = s.velocity[2 * a], v = s.velocity[2 * a + 1];
        const real excess = s.density[a] - s.reference_density[a];
        real divergence = 0, diffused = 0, gamma = s.volume[a] * s.alpha;
        real weight = gamma, background = gamma * s.background[a];
        const int *list = s.near + (long)a * s.near_width;
        for (int j = 0; j < s.near_count[a]; j++) {
            const int b = list[j];
            const real rx = x - s.position[2 * b], ry = y - s.position[2 * b + 1];
            const real r2 = rx * rx + ry * ry;
            const real slope = s.volume[b] * F(r2, slope_factor, inverse_h);
            const real share = s.volume[b] * W(r2, s.alpha, inverse_h);
            const real moves = s.mobility[b] == 1 ? real(1) : real(0);
            if constexpr (SUMS & DIVERGENCE)
                divergence += slope * ((u - s.velocity[2 * b]) * rx + (v - s.velocity[2 * b + 1]) * ry);
            if constexpr (SUMS & DIFFUSION)
                diffused -= moves * slope * s.delta * (s.density[b] - s.reference_density[b] - excess);
            if constexpr (SUMS & SHEPARD) gamma += share;
            if constexpr (SUMS & BACKGROUND) {
                weight += moves * share;
                background += moves * share * s.background[b];
            }
        }
        if constexpr (SUMS & SHEPARD) s.shepard[a] = gamma;
        if constexpr (SUMS & DIVERGENCE) {
            const real ideal = of_a_flat_surface(s, s.flat_shepard, s.colour_strength[a]);
            const real packed = max(real(-0.1), min(real(0.1), s.shepard[a] / ideal - 1));
            s.density_rate[a] = s.density[a] * (divergence / s.moment + s.packing * packed);
        }
        if constexpr (SUMS & DIFFUSION) s.density_rate[a] += diffused;
        if constexpr (SUMS & BACKGROUND) s.background_mean[a] = background / weight;
    }
}

extern "C" void continuity(const Scene *scene) {
    continuity_of<SHEPARD | DIVERGENCE | DIFFUSION | BACKGROUND>(*scene);
}

extern "C" void colour(const Scene *scene) {
    const Scene &s = *scene;
    const real inverse_h = 1 / s.h_surface, slope_factor = -5 * s.alpha_surface / (s.h_surface * s.h_surface);
    for (int i = 0; i < s.near_surface_count; i++) {
        const int a = s.rows[s.near_surface[i]];
        const real x = s.position[2 * a], y = s.position[2 * a + 1];
        real gx = 0, gy = 0;
        const int *lists[2] = {s.near + (long)a * s.near_width, s.far + (long)a * s.far_width};
        const int counts[2] = {s.near_count[a], s.far_count[a]};
        for (int part = 0; part < 2; part++)
            for (int j = 0; j < counts[part]; j++) {
                const int b = lists[part][j];
                const real rx = x - s.position[2 * b], ry = y - s.position[2 * b + 1];
                const real slope = 2 * s.volume[b] * F(rx * rx + ry * ry, slope_factor, inverse_h);
                gx += slope * rx;
                gy += slope * ry;
            }
        const real strength = sqrt(gx * gx + gy * gy);
        const bool cut = !(strength > s.normal_cut);
        s.colour_strength_found[a] = strength;
        s.normal_found[2 * a] = cut ? real(0) : gx / strength;
        s.normal_found[2 * a + 1] = cut ? real(0) : gy / strength;
    }
}

extern "C" void forces(const Scene *scene) {
    const Scene &s = *scene;
    const real inverse_h = 1 / s.h, slope_of_flow = -5 * s.alpha / (s.h * s.h);
    const real inverse_h_surface = 1 / s.h_surface;
    const real slope_factor = -5 * s.alpha_surface / (s.h_surface * s.h_surface);
    for (int i = 0; i < s.surface_mobile; i++) {
        const int a = s.rows[s.near_surface[i]];
        const real nx = s.normal[2 * a], ny = s.normal[2 * a + 1];
        s.curvature[a] = s.capillary[a] = s.at_surface[a] = 0;
        s.tangential_found[2 * a] = s.tangential_found[2 * a + 1] = 0;
        if (s.mobility[a] != 1 || !(nx * nx + ny * ny > real(0.5))) continue;
        const real x = s.position[2 * a], y = s.position[2 * a + 1], T = s.temperature[a];
        real divergence = 0, weight = s.volume[a] * s.alpha_surface, tx = 0, ty = 0;
        real mxx = 0, mxy = 0, myy = 0, sxx = 0, sxy = 0, syy = 0;  // moment matrix, missing stress
        const auto add = [&](int b, bool near) {
            const real rx = x - s.position[2 * b], ry = y - s.position[2 * b + 1];
            const real r2 = rx * rx + ry * ry;
            const real slope = s.volume[b] * F(r2, slope_factor, inverse_h_surface);
            const real mx = s.normal[2 * b], my = s.normal[2 * b + 1];
            const real has = mx * mx + my * my > real(0.5) ? real(1) : real(0);
            divergence += has * slope * ((mx - nx) * rx + (my - ny) * ry);
            weight += has * s.volume[b] * W(r2, s.alpha_surface, inverse_h_surface);
            const real difference = slope * (s.temperature[b] - T);
            tx += difference * rx;
            ty += difference * ry;
            mxx -= slope * rx * rx;
            mxy -= slope * rx * ry;
            myy -= slope * ry * ry;
            if (!near) return;
            const real sheared = s.volume[b] * F(r2, slope_of_flow, inverse_h) * s.viscous_scale / (r2 + s.softening)
                                 * (nx * rx + ny * ry);
            sxx += sheared * rx * rx;
            sxy += sheared * rx * ry;
            syy += sheared * ry * ry;
        };
        const int *near = s.near + (long)a * s.near_width, *far = s.far + (long)a * s.far_width;
        for (int j = 0; j < s.near_count[a]; j++) add(near[j], true);
        for (int j = 0; j < s.far_count[a]; j++) add(far[j], false);
        real kappa = divergence / weight;
        kappa /= max(1 - kappa * of_a_flat_surface(s, s.flat_depth, s.colour_strength[a]), real(0.5));
        const real largest = real(0.5) * inverse_h_surface;
        kappa = max(-largest, min(kappa, largest));
        const real determinant = mxx * myy - mxy * mxy;
        if (!(determinant < s.singular)) {
            const real plain = tx;
            tx = (myy * plain - mxy * ty) / determinant;
            ty = (mxx * ty - mxy * plain) / determinant;
        }
        const real along = tx * nx + ty * ny, slope = s.surface_tension_slope[a] * s.liquid_fraction[a];
        tx = slope * (tx - along * nx);
        ty = slope * (ty - along * ny);
        s.curvature[a] = kappa;
        s.tangential_found[2 * a] = sxx * tx + sxy * ty;
        s.tangential_found[2 * a + 1] = sxy * tx + syy * ty;
        s.capillary[a] = -s.surface_tension[a] * kappa * s.liquid_fraction[a];
        s.at_surface[a] = max(real(0), min((s.colour_strength[a] - s.normal_cut) * s.h_surface / real(0.3), real(1)));
    }
}

template <bool KEPT> static void conduction_of(const Scene &s) {  // KEPT: with the slopes of an earlier loop
    const real inverse_h = 1 / s.h, slope_factor = -5 * s.alpha / (s.h * s.h);
    for (int k = 0; k < s.hot; k++) {
        const int a = s.hot_rows[k];
        const real x = s.position[2 * a], y = s.position[2 * a + 1];
        const real phi = s.kirchhoff[a], factor = s.conduction_factor[a];
        real conducted = 0;
        const int *list = s.near + (long)a * s.near_width;
        const real *slopes = s.slopes + (long)a * s.slopes_width;
        for (int j = 0; j < s.near_count[a]; j++) {
            const int b = list[j];
            real slope;
            if (KEPT) {
                slope = slopes[j];
            } else {
                const real rx = x - s.position[2 * b], ry = y - s.position[2 * b + 1];
                slope = s.volume[b] * F(rx * rx + ry * ry, slope_factor, inverse_h);
            }
            conducted += slope * (factor + s.conduction_factor[b]) * (phi - s.kirchhoff[b]);
        }
        s.heating[a] = (double)(s.volume[a] * conducted);
    }
}

extern "C" void conduction(const Scene *scene) { conduction_of<true>(*scene); }

// All of the passes above, with a loop over the neighbours for every term of them.
extern "C" void unfused(const Scene *scene) {
    momentum_of<ORDER>(*scene);
    momentum_of<FORCES>(*scene);
    continuity_of<SHEPARD>(*scene);
    continuity_of<DIVERGENCE>(*scene);
    continuity_of<DIFFUSION>(*scene);
    continuity_of<BACKGROUND>(*scene);
    colour(scene);
    forces(scene);
    conduction_of<false>(*scene);
}

#ifdef __AVX512F__
typedef real Pack __attribute__((vector_size(64)));
#else
typedef real Pack __attribute__((vector_size(32)));
#endif

// What this core's arithmetic can do: ten multiply-adds at once, `turns` times; returns the number of operations.
extern "C" double multiply_adds(long turns, double *result) {
    Pack sums[10];
    for (int i = 0; i < 10; i++) sums[i] = Pack{} + real(i);
    for (long turn = 0; turn < turns; turn++)
#pragma GCC unroll 10
        for (int i = 0; i < 10; i++) sums[i] = sums[i] * real(0.999) + real(0.5);
    *result = 0;
    for (int i = 0; i < 10; i++)
        for (unsigned k = 0; k < sizeof(Pack) / sizeof(real); k++) *result += sums[i][k];
    return 2.0 * 10 * (sizeof(Pack) / sizeof(real)) * turns;
}

"""The pictures of the paper's figures 7 to 13 from finished runs, and what they say in numbers."""

import numpy as np
from make_results import Run
from paper_sheet import Figure, Film, dashed, sheet, under
from PIL import Image, ImageDraw, ImageFont

from taichi_slm.analysis.melt_pool import groups
from taichi_slm.analysis.mixing import dispersed, stirred
from taichi_slm.output.history import read_history
from taichi_slm.render.frame import FOOTER
from taichi_slm.render.views import Studio

MS, UM = 1e-3, 1e6
MIDDLE, SOLID, CLOSE = 0.26 * MS, 1.25 * MS, 0.24 * MS  # moments of figures 11, 12 and 9 [s]
MOMENTS = np.array([0.02, 0.06, 0.24, 0.52, 0.70, 9.0]) * MS  # of figure 8; the last is the end
TRACK = np.array([[0.0, -70e-6], [1.2e-3, 85e-6]])  # what is shown of a track [m]
MEASURED = (0.48e-3, 0.26e-3)  # radius and depth of the pool in the experiment of He et al. [m]
PAPER_WELD = (0.46e-3, 0.25e-3)  # in the paper's simulation
POWERS = (50, 100, 150, 200)
LUMP = 30  # fewer connected particles than this are spatter, not a part of a pool


def weld(run: Run) -> list[Figure]:
    """Figure 7: section of the spot weld at its largest, beside the measured size."""
    film = Film(run)
    history = read_history(run.folder.history)
    size = history["melt_length_m"] * history["melt_width_m"] * history["melt_depth_m"]
    largest = film.at(float(history["time_s"][np.nanargmax(size)]))
    studio = Studio(run.folder.path, film.config, [film.at(t) for t in film.times])
    ((_, pixels),) = studio.draw(largest, ["cut"])
    view = studio.close_up["cut"]
    studio.close()
    image = Image.fromarray(pixels)
    pen, white = ImageDraw.Draw(image), (255, 255, 255)
    radius, depth = MEASURED
    at = {x: view.pixels(np.array([[x, 0.0, z]]))[0] for x, z in ((-radius, -depth), (radius, 0.0))}
    (left, bottom), (right, top) = at[-radius], at[radius]
    bottom, top = view.window[1] - bottom, view.window[1] - top
    for x in (left, right):
        dashed(pen, (x, top), (x, bottom), white)
    dashed(pen, (left, bottom), (right, bottom), white)
    said = f"dashed: measured by He et al., radius {1e3 * radius:.2f} mm, depth {1e3 * depth:.2f} mm"
    corner = (60, image.height - FOOTER - 24)
    pen.text(corner, said, fill=white, font=ImageFont.load_default(30), anchor="ls")
    pool = run.summary["melt_pool"]
    ours = (0.25 * (pool["length_m"] + pool["width_m"]), pool["depth_m"])
    now = film.pool(largest)
    assert now.width is not None
    shown = (500 * now.length, 500 * now.width)
    off = [100 * (a / b - 1.0) for a, b in zip(ours, MEASURED, strict=True)]
    laser = film.config.laser
    assert laser is not None
    return [
        Figure(
            7,
            "The weld pool at its largest, in section, with the measured size",
            image,
            [run],
            f"The largest radius is {1e3 * ours[0]:.3f} mm and the largest depth {1e3 * ours[1]:.3f} mm: "
            f"{off[0]:+.1f} % and {off[1]:+.1f} % off the measured {MEASURED[0] * 1e3:.2f} and "
            f"{MEASURED[1] * 1e3:.2f} mm (paper: {PAPER_WELD[0] * 1e3:.2f} and {PAPER_WELD[1] * 1e3:.2f} mm). "
            "It is a bowl, wide and shallow. The melt rises in the middle, runs outwards along the surface "
            "and comes back along the bottom.",
            f"The pool is not round: at the moment shown half its extents are {shown[0]:.3f} mm along x and "
            f"{shown[1]:.3f} mm along y. The input is not the paper's: absorptivity {laser.absorptivity:g} here, 0.27 "
            f"there, and a beam profile of exponent {laser.exponent:g}; both are chosen within what He et al. and the "
            f"literature allow. The pool is {ours[1] / film.config.spacing:.0f} particles deep, so a part of the "
            "agreement is luck: [verification.md](verification.md) has finer ones.",
            smooth=True,
        )
    ]


def track(run: Run) -> list[Figure]:
    """Figures 8 and 9: the track at 150 W in time, and close up under the beam."""
    film = Film(run)
    return [_in_time(film), _close_up(film)]


def _in_time(film: Film) -> Figure:
    snapshots = [film.at(t) for t in MOMENTS]
    panels, key = film.panels("state", snapshots, TRACK)
    middle = snapshots[2]
    beam, pool = film.beam_at(middle), film.pool(middle)
    assert beam is not None
    split, tail = _first_split(film), beam - pool.x_range[0]
    end = film.run.summary["simulated_time_s"]
    frozen = film.run.summary["melt_pool"]["track"]
    return Figure(
        8,
        "State and isotherms of the track at 150 W in time; the triangle marks the beam",
        sheet(panels, key),
        [film.run],
        f"At {middle.time / MS:.2f} ms the pool reaches {UM * (pool.x_range[1] - beam):.0f} µm ahead of the "
        f"beam's centre and {UM * pool.depth:.0f} µm into the plate, through the whole layer of powder. "
        f"{split} The metal stays mushy long after the beam has gone: all is solid at {end / MS:.2f} ms "
        f"(paper: around 1.125 ms). {_unmelted(frozen)}.",
        f"The tail is {UM * tail:.0f} µm long at that moment (paper: around 400 µm), and the end is not flat: "
        f"the upper edge varies by {UM * frozen['roughness_m']:.0f} µm (standard deviation) about a mean "
        f"height of {UM * frozen['mean_height_m']:.0f} µm, because {_in_front(film):.0f} % of the metal above "
        "the plate ends in the first half of the track. The paper calls its final profile relatively flat, "
        "with humps where it had necked. Absorptivity and the powder's size are ambiguous in the paper: "
        "[tracks.md](tracks.md) shows what they do.",
    )


def _in_front(film: Film) -> float:
    """Share of the metal above the plate that lies in the first half of the track in the end [%]."""
    x, z = film.last.arrays["position"].T
    middle = 0.5 * (film.beam.position(0.0)[0] + film.beam.position(film.beam.end)[0])
    return 100 * float((x[z > 0.0] < middle).mean())


def _first_split(film: Film) -> str:
    """When the pool first falls into two, as a sentence."""
    for time in film.times[film.times > MIDDLE]:
        snapshot = film.at(time)
        a = snapshot.arrays
        molten = a["position"][(a["liquid_fraction"] >= 0.5)]
        sizes = np.sort(groups(molten, snapshot.spacing)[1])[::-1]
        if len(sizes) > 1 and sizes[1] >= LUMP:
            return f"From {time / MS:.2f} ms on the tail is pinched in two, as in the paper's panel D."
    return "The tail is never pinched in two, as it is in the paper's panel D."


def _unmelted(frozen: dict[str, float]) -> str:
    left = frozen["unmelted_powder"]
    return (
        f"{left} particles of powder stay unmelted" if left else "No powder stays unmelted, as in the paper"
    )


def _close_up(film: Film) -> Figure:
    snapshot = film.at(CLOSE)
    beam = film.beam_at(snapshot)
    assert beam is not None
    box = np.array([[beam - 0.22e-3, -45e-6], [beam + 0.14e-3, 80e-6]])
    panels = []
    names = {
        "temperature": "temperature",
        "velocity": "velocity",
        "surface_force": "acceleration by surface tension",
    }
    for kind, name in names.items():
        found, key = film.panels(kind, [snapshot], box, f"{name}, ")
        panels.append((found[0][0], under(found[0][1], key)))
    a = snapshot.arrays
    molten = a["liquid_fraction"] >= 0.5
    x, z = (a["position"][molten] - [beam, 0.0]).T
    along = a["velocity"][molten, 0]
    hottest = int(np.argmax(a["temperature"][molten]))
    near = np.abs(x) < 0.15e-3
    pull = np.linalg.norm(a["surface_force"][molten] / a["density"][molten, None], axis=1)
    ahead, behind = near & (x > 0.0), near & (x < 0.0)
    fastest = (np.percentile(along[ahead], 99), -np.percentile(along[behind], 1))
    strongest = [np.percentile(pull[part & (pull > 0)], 95) / 1e6 for part in (ahead, behind)]
    column = (x > -0.12e-3) & (x < -0.02e-3)
    low, high = np.percentile(z[column], [33, 67])
    upper, lower = along[column & (z > high)].mean(), along[column & (z < low)].mean()
    back = "runs back" if lower > 0.1 * abs(upper) else "hardly runs back"
    return Figure(
        9,
        "Close up under the beam: A temperature, B velocity, C acceleration by surface tension and Marangoni force",
        sheet(panels),
        [film.run],
        f"The hottest metal, {a['temperature'][molten].max():.0f} K, is {UM * abs(x[hottest]):.0f} µm from "
        f"the beam's centre. The surface runs away from it both ways, {fastest[0]:.1f} m/s forwards (the "
        f"fastest 1 %) and {fastest[1]:.1f} m/s backwards, and the forces are larger ahead of it, "
        f"{strongest[0]:.1f} against {strongest[1]:.1f} µm/µs² (the strongest 5 %), where T falls within a "
        "few particles: fluid is pushed over the next grain and melts it.",
        f"From 20 to 120 µm behind the beam the upper third of the melt runs at {upper:+.2f} m/s along the "
        f"track, and the lower third at {lower:+.2f} m/s: it {back}, where the paper draws whole vortices. In "
        "C single particles carry most of the force: the surface is one or two particles deep, and at the "
        "crumbling front it is none.",
    )


def tracers(run: Run) -> list[Figure]:
    """Figure 10: where the metal of marked grains goes."""
    film = Film(run)
    snapshots = [film.at(t) for t in (0.0, CLOSE, 0.52 * MS, 9.0)]
    panels, key = film.panels("tracer", snapshots, TRACK)
    first, last = snapshots[0], snapshots[-1]
    marked, z = last.arrays["tracer"] > 0, last.arrays["position"][:, 1]
    below = 100 * float((z[marked] < 0.0).mean())
    solid = (last.arrays["position"], last.arrays["tracer"], last.spacing)
    lone, random = 100 * dispersed(*solid), 100 * stirred(*solid)
    start = dict(zip(first.arrays["id"].tolist(), first.arrays["position"][:, 0], strict=True))
    gone = last.arrays["position"][marked, 0] - [start[k] for k in last.arrays["id"][marked].tolist()]
    early, median, late = np.percentile(gone, [10, 50, 90]) * UM
    return [
        Figure(
            10,
            "Where the metal of marked grains goes; every fourth grain is marked",
            sheet(panels, key),
            [run],
            f"{below:.0f} % of the marked metal ends below the plate's surface and the rest in the new layer, "
            "which is what the paper says. The grains are sheared into streaks and carried backwards: half "
            f"of the metal by more than {-median:.0f} µm, the middle 80 % by {-late:.0f} to {-early:.0f} µm.",
            f"{lone:.0f} % of the marked particles have mostly unmarked neighbours in the end, where random stirring "
            f"would give {random:.0f} %. The paper has no number; it finds that neighbouring grains do not mix "
            "strongly.",
        )
    ]


def powers(runs: list[Run]) -> list[Figure]:
    """Figures 11 and 12: tracks at four powers, with the beam in the middle, and in the end."""
    films = [Film(run) for run in runs]
    return [_mid_way(films), _in_the_end(films)]


def _mid_way(films: list[Film]) -> Figure:
    panels, rows = [], []
    for film, power in zip(films, POWERS, strict=True):
        snapshot = film.at(MIDDLE)
        found, key = film.panels("state", [snapshot], TRACK, f"{power} W, ")
        panels += found
        pool, beam = film.pool(snapshot), film.beam_at(snapshot)
        history = read_history(film.run.folder.history)
        lost = history["removed"][np.argmin(np.abs(history["time_s"] - MIDDLE))]
        assert beam is not None
        rows.append((UM * pool.length, UM * pool.depth, UM * (pool.x_range[1] - beam), lost))
    length, depth, ahead, lost = (
        " / ".join(f"{value:.0f}" for value in column) for column in zip(*rows, strict=True)
    )
    names = " / ".join(map(str, POWERS))
    return Figure(
        11,
        "Tracks at four powers, the beam on its way",
        sheet(panels, key),
        [film.run for film in films],
        f"At {names} W the pool is {length} µm long and {depth} µm deep in the plate, its front is {ahead} µm "
        f"ahead of the beam's centre, and {lost} particles have been thrown out by then: more power, a "
        "longer, deeper and livelier pool that runs further ahead. At 50 W the grains melt in part and the "
        "plate not at all; the pool is calm at 100 W, and the surface at the front is the most ragged at 200 "
        "W.",
        f"At 100 W the pool is only {rows[1][1]:.1f} µm deep in the plate at this moment, less than a "
        "particle, where the paper sees penetration; and the pools are longer than the paper's tail of 400 "
        "µm.",
    )


def _in_the_end(films: list[Film]) -> Figure:
    panels, roughs, ends, mushy = [], [], [], []
    for film, power in zip(films, POWERS, strict=True):
        snapshot = film.at(SOLID)
        found, key = film.panels("state", [snapshot], TRACK, f"{power} W, ")
        panels += found
        roughs.append(f"{UM * film.run.summary['melt_pool']['track']['roughness_m']:.0f}")
        ends.append(f"{film.run.summary['simulated_time_s'] / MS:.2f}")
        mushy.append(str(int((snapshot.arrays["liquid_fraction"] > 0).sum())))
    left = films[0].run.summary["melt_pool"]["track"]["unmelted_powder"]
    names, rough, done, liquid, front = (
        " / ".join(texts)
        for texts in (
            [str(p) for p in POWERS],
            roughs,
            ends,
            mushy,
            [f"{_in_front(film):.0f}" for film in films],
        )
    )
    return Figure(
        12,
        "Tracks at four powers at 1.25 ms, or when all is solid if that is earlier",
        sheet(panels, key),
        [film.run for film in films],
        f"At {names} W the upper edge of the final track varies by {rough} µm (standard deviation): it is "
        f"rougher with every step in power, which is the paper's chief conclusion. At 50 W {left} particles "
        "of powder never melt.",
        f"All is solid after {done} ms, and {liquid} particles are still mushy in these pictures, where the "
        f"paper's four tracks are solid. {front} % of the metal above the plate ends in the first half of the "
        "track: at 150 and 200 W it is drawn back into one large hump, where the paper's tracks are rough "
        "along their whole length.",
    )


def doped(runs: list[Run]) -> list[Figure]:
    """Figure 13: a bed in which every third grain conducts twice as well, beside the plain one."""
    plain, mixed = (Film(run) for run in runs)
    panels, keys = [], {}
    shown = [(mixed, "material", "doped, material", 0.0)]
    for time in (MIDDLE, 9.0):
        shown += [
            (plain, "state", "plain, state", time),
            (mixed, "state", "doped, state", time),
            (mixed, "material", "doped, material", time),
        ]
    for film, kind, name, time in shown:
        found, keys[kind] = film.panels(kind, [film.at(time)], TRACK, f"{name}, ")
        panels += found
    half = keys["material"].width // 2
    keys["material"] = keys["material"].crop((0, 0, half, FOOTER))  # one scale bar is enough
    pools = [film.pool(film.at(MIDDLE)) for film in (plain, mixed)]
    ends = [film.run.summary["melt_pool"]["track"] for film in (plain, mixed)]
    last = mixed.last
    solid = (last.arrays["position"], last.arrays["material"], last.spacing)
    lone, random = 100 * dispersed(*solid), 100 * stirred(*solid)
    doping = last.arrays["material"] > 0
    below = 100 * float((last.arrays["position"][doping, 1] < 0.0).mean())
    rough, depth = ([UM * end[name] for end in ends] for name in ("roughness_m", "depth_m"))
    shorter = "shorter" if pools[1].length < pools[0].length else "longer"
    deeper = "deeper" if pools[1].depth > pools[0].depth else "shallower"
    return [
        Figure(
            13,
            "State of a plain and of a doped bed at 100 W, and where the doping goes",
            sheet(panels, under(keys["state"], keys["material"])),
            runs,
            f"The doping does little. Half-way the pool is {UM * pools[1].length:.0f} µm long and "
            f"{UM * pools[1].depth:.1f} µm deep, {shorter} and {deeper} than the plain bed's "
            f"{UM * pools[0].length:.0f} and {UM * pools[0].depth:.1f} µm (paper: shorter and deeper). The doping "
            f"stays in layers: {lone:.0f} % of its particles have mostly foreign neighbours in the end (stirred at "
            f"random: {random:.0f} %), and {below:.1f} % lie below the plate's surface.",
            f"There are no periodic divots at the doped grains: the upper edge varies by {rough[1]:.0f} µm, "
            f"that of the plain bed by {rough[0]:.0f} µm, with as few humps in either. The pools differ by "
            f"little more than a particle ({UM * last.spacing:.0f} µm), and the final depths are "
            f"{depth[1]:.1f} and {depth[0]:.1f} µm.",
        )
    ]

"""A drop in PySPH, with its own schemes: a script for the interpreter that has PySPH, which need not have this package.

``python pysph_drop.py JOB.json RESULT.json``: the job has the particles, the physics and the end time; the result has
the seconds of PySPH's loop over time (set-up and compiling come before), its steps and what the error is made of. SI
units, or any that are consistent; 2-D, one thread.
"""

import json
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

H_OVER_DX = 1.3  # of PySPH's examples of both drops


def main() -> None:
    """Run the job."""
    job_file, result_file = sys.argv[1:]
    sys.path.pop(0)  # this folder, whose modules are nobody's business here
    job = json.loads(Path(job_file).read_text(encoding="utf-8"))
    run = {"elliptic": elliptic, "square": square}[job["drop"]]
    Path(result_file).write_text(json.dumps(run(job)), encoding="utf-8")


def elliptic(job: dict[str, Any]) -> dict[str, Any]:
    """Monaghan's drop: the WCSPH scheme with the settings of PySPH's example, plain or with its delta-SPH terms.

    The job: position [n, 2], mass [n], density [n], velocity [n, 2], spacing, rest_density, sound_speed, fastest,
    alpha (of the artificial viscosity; the example has 0.1), delta_sph, end. The result:
    seconds, steps, position [n, 2] at the end.
    """
    from pysph.base.kernels import Gaussian
    from pysph.base.utils import get_particle_array
    from pysph.solver.application import Application
    from pysph.sph.integrator import EPECIntegrator
    from pysph.sph.scheme import WCSPHScheme

    h = H_OVER_DX * job["spacing"]

    class Drop(Application):
        """The drop as PySPH wants it."""

        def create_scheme(self) -> Any:
            scheme = WCSPHScheme(
                ["fluid"], [], dim=2, rho0=job["rest_density"], c0=job["sound_speed"], h0=h, hdx=H_OVER_DX,
                gamma=7.0, alpha=job["alpha"], beta=0.0, delta=0.1, delta_sph=job["delta_sph"],
            )  # fmt: skip
            scheme.configure_solver(
                kernel=Gaussian(dim=2), integrator_cls=EPECIntegrator, tf=job["end"], adaptive_timestep=True,
                cfl=0.3, n_damp=50, dt=0.25 * h / (job["sound_speed"] + job["fastest"]),
            )  # fmt: skip
            return scheme

        def create_particles(self) -> list[Any]:
            (x, y), (u, v) = np.transpose(job["position"]), np.transpose(job["velocity"])
            fluid = get_particle_array(
                name="fluid", x=x, y=y, u=u, v=v, m=np.array(job["mass"]), rho=np.array(job["density"]), h=h
            )
            self.scheme.setup_properties([fluid])
            return [fluid]

    solver, seconds = _timed(Drop, None)
    fluid = solver.particles[0]
    return {"seconds": seconds, "steps": solver.count, "position": np.transpose([fluid.x, fluid.y]).tolist()}


def square(job: dict[str, Any]) -> dict[str, Any]:
    """A square that surface tension makes round, in surroundings of its own density; Morris's surface tension.

    Equations, kernel, integrator and step are those of PySPH's example of this drop. The job: position [n, 2] of all
    particles of a periodic box, colour [n] (1 in the drop), box (its side), spacing, rest_density, sound_speed,
    kinematic_viscosity, surface_tension, end, inside and outside (radii about the centre of the box), sample_times. The
    result: seconds, steps, jump: at the sample times, mean pressure within ``inside`` less that beyond ``outside``.
    """
    from pysph.base.kernels import QuinticSpline
    from pysph.base.nnps import DomainManager
    from pysph.base.utils import get_particle_array
    from pysph.solver.application import Application
    from pysph.solver.solver import Solver
    from pysph.sph.integrator import PECIntegrator
    from pysph.sph.integrator_step import TransportVelocityStep
    from pysph.sph.surface_tension import get_surface_tension_equations

    h, rho, c0 = H_OVER_DX * job["spacing"], job["rest_density"], job["sound_speed"]
    nu, side, volume = job["kinematic_viscosity"], job["box"], job["spacing"] ** 2
    needed = (
        "V alpha color scolor cx cy cz cx2 cy2 cz2 nx ny nz ddelta kappa uhat vhat what auhat avhat awhat wij vmag2 N "
        "wij_sum nu"
    )

    class Drop(Application):
        """The drop and its surroundings as PySPH wants them."""

        def create_particles(self) -> list[Any]:
            x, y = np.transpose(job["position"])
            fluid = get_particle_array(
                name="fluid", x=x, y=y, m=rho * volume, rho=rho, h=h, cs=c0, additional_props=needed.split()
            )
            fluid.color[:], fluid.V[:], fluid.nu[:] = job["colour"], 1.0 / volume, nu
            fluid.alpha[:] = job["surface_tension"]
            return [fluid]

        def create_domain(self) -> Any:
            return DomainManager(xmin=0, xmax=side, ymin=0, ymax=side, periodic_in_x=True, periodic_in_y=True)

        def create_solver(self) -> Any:
            dt = 0.9 * min(0.25 * h / (1.1 * c0), 0.125 * h * h / nu)
            integrator = PECIntegrator(fluid=TransportVelocityStep())
            return Solver(kernel=QuinticSpline(dim=2), dim=2, integrator=integrator, dt=dt, tf=job["end"])

        def create_equations(self) -> Any:
            return get_surface_tension_equations(
                ["fluid"], [], "morris", rho, rho * c0 * c0, c0, 0, 0.8, 1.25, nu, job["surface_tension"], 2,
                0.01 / h, 1, real=False,
            )  # fmt: skip

    jumps: list[float] = []

    def sample(solver: Any) -> None:
        if len(jumps) < len(job["sample_times"]) and (
            solver.t + solver.dt >= job["sample_times"][len(jumps)] * (1 - 1e-9)
        ):
            fluid = solver.particles[0]
            real = slice(0, len(job["colour"]))  # behind them are the images of the periodic box
            r = np.hypot(fluid.x[real] - 0.5 * side, fluid.y[real] - 0.5 * side)
            p = fluid.p[real]
            jumps.append(float(p[r < job["inside"]].mean() - p[r > job["outside"]].mean()))

    solver, seconds = _timed(Drop, sample)
    return {"seconds": seconds, "steps": solver.count, "jump": jumps}


def _timed(application: Any, after_step: Any) -> tuple[Any, float]:
    """The solver after its loop over time, and the seconds of that loop."""
    with tempfile.TemporaryDirectory() as scratch:
        app = application(output_dir=scratch)
        app.setup(["--no-openmp", "--disable-output"])
        solver = app.solver
        if after_step:
            solver.add_post_step_callback(after_step)
        began = time.perf_counter()
        solver.solve(show_progress=False)
        seconds = time.perf_counter() - began
    if not all(math.isfinite(x) for x in solver.particles[0].x):
        raise SystemExit("PySPH's drop blew up")
    return solver, seconds


if __name__ == "__main__":
    main()

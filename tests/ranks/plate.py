"""Run by mpiexec: the first 36 steps of a scene over ranks beside the whole; prints what is off as JSON."""

import json
import sys


def main():
    import numpy as np

    import skfem_peridynamics as peri
    from skfem_peridynamics import Scene
    from skfem_peridynamics.app.problem.problem import Problem
    from skfem_peridynamics.app.ranks.crew import Crew
    from skfem_peridynamics.ranks.world import world

    comm, steps = world(), 36
    scene = Scene.read(sys.argv[1])
    problem = Problem(scene) if comm.rank == 0 else None
    crew = Crew.of(comm, scene, problem)
    if problem is None:
        crew.follow()
        return
    dt = problem.dt
    u0, v0 = problem.u0, problem.v0
    crew.given = (u0, v0, None)
    crew.order("begin", dt, steps * dt, problem.limit, (u0 is not None, v0 is not None), False)
    crew.order("advance", steps)
    numbers, (u, v, _) = crew.order("state")
    count, hurt = crew.order("look")
    crew.order("close")
    options = {"dt": dt, "until": steps * dt, "load": problem.load, "fixed": problem.fixed}
    *_, state = peri.central_difference(problem.body, problem.mass, u0, v0, **options)
    whole, worn = peri.census(problem.body, state.u), peri.damage(problem.body, state.u)
    print(
        json.dumps(
            {
                "steps": [numbers["step"], state.step],
                "u": float(np.abs(u - state.u).max() / np.abs(state.u).max()),
                "v": float(np.abs(v - state.v).max() / np.abs(state.v).max()),
                "softened": [count.softened, whole.softened],
                "intact": bool(np.array_equal(hurt.intact, worn.intact)),
                "bonds": problem.bonds.nbonds,
            }
        )
    )


if __name__ == "__main__":
    main()

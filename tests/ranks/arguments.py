"""Run by mpiexec: arguments that make no sense are refused by all ranks; a body is left open at the end."""

import json
import sys

KEPT = []  # until the process ends


def main():
    sys.path.insert(0, sys.argv[1])
    import numpy as np
    import skfem

    import skfem_peridynamics as peri
    from bodies import box
    from skfem_peridynamics.ranks.distributed import distributed
    from skfem_peridynamics.ranks.world import world

    comm, first = world(), world().rank == 0
    mesh, law = box(2, 8), peri.Exponential(1.0, 1e-2)
    plate = peri.Material.from_elastic(young=1.0, toughness=1e-3, density=1.0, plane="stress", poisson=0.2)
    body = distributed(mesh, 0.3, law)
    breaking = distributed(mesh, 0.3, law, breaking=1.5)
    m = body.scatter(np.ones(2 * mesh.nvertices) if first else None)
    wrong = {
        "w": lambda: distributed(mesh, 0.3, law, boundary_function=np.ones(3)),
        "no_fail": lambda: distributed(mesh, 0.3, law, no_fail=[-1]),
        "no_fail, empty": lambda: distributed(mesh, 0.3, law, no_fail=[]),
        "no_fail, float": lambda: distributed(mesh, 0.3, law, no_fail=[1.5]),
        "mesh": lambda: distributed(None, 0.3, law),
        "quadrilaterals": lambda: distributed(skfem.MeshQuad(), 0.3, law),
        "horizon": lambda: distributed(mesh, -1.0, law),
        "rule": lambda: distributed(mesh, 0.3, law, rule="ball"),
        "breaking": lambda: distributed(mesh, 0.3, law, breaking="x"),
        "breaking and Poisson": lambda: distributed(mesh, 0.3, plate, breaking=1.5),
        "scatter": lambda: body.scatter(np.ones(3) if first else None),
        "tolerance": lambda: peri.stable_time_step(body, m, tolerance=0.0),
        "mass": lambda: peri.stable_time_step(body, m if first else -m),
        "adapt": lambda: peri.central_difference(
            body, m, dt=1e-3, until=1.0, adapt=2, limit=peri.StepLimit(1, 0, 1, 1, 1, 1)
        ),
        "numbers": lambda: breaking.recall([np.array([1, 2, 3])]),
        "foreign": lambda: breaking.recall([np.array([[0, 10**6]])]),
        "closed": lambda: (breaking.close(), breaking.force(m)),
    }
    said = {}
    for name, act in wrong.items():
        try:
            act()
            said[name] = "nothing"
        except ValueError as error:
            said[name] = str(error)
    body.force(m)
    KEPT.append(body)
    every = comm.gather(said, root=0)
    if first:
        print(json.dumps(every))


if __name__ == "__main__":
    main()

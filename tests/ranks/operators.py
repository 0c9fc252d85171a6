"""Run by mpiexec: operators of a body over ranks beside those of the whole, which the first rank prints as JSON."""

import json
import sys
import warnings


def main():
    warnings.simplefilter("error")
    sys.path.insert(0, sys.argv[1])
    import numpy as np

    import skfem_peridynamics as peri
    from bodies import box
    from skfem_peridynamics.analysis.damage import census_and_damage
    from skfem_peridynamics.geometry.simplices import vertex_sizes
    from skfem_peridynamics.model.space import numbering_basis
    from skfem_peridynamics.ranks.distributed import distributed
    from skfem_peridynamics.ranks.limit import stable_time_step
    from skfem_peridynamics.ranks.world import world

    comm = world()
    dim, n, eps = 2, 40, 0.08
    mesh = box(dim, n)
    mesh.p[0] *= 1.3 - 0.3 * mesh.p[0]  # the finest elements, which decide the step, are with the last rank
    mesh = peri.slit(mesh, peri.Crack([[0.0, 0.5], [0.575, 0.5]]))
    material = peri.Material.from_elastic(young=1.0, toughness=1e-3, density=1.0, plane="stress")
    no_fail = np.flatnonzero(mesh.p[0] < 0.2)
    body = distributed(mesh, eps, material, no_fail=no_fail)
    rng = np.random.default_rng(3)
    u = 0.02 * rng.standard_normal(dim * mesh.nvertices)
    u[dim * np.flatnonzero(mesh.p[1] > 0.5) + 1] += 0.5
    own = body.scatter(u if comm.rank == 0 else None)
    force, energy = body.gather(body.force(own)), body.total(body.energy(own))
    product = body.gather(body.stiffness(own))
    count, hurt = body.look(own)
    Z, intact = body.gather(hurt.Z), body.gather(hurt.intact)
    mass = peri.mass_matrix(numbering_basis(mesh)).diagonal()
    m = body.scatter(mass if comm.rank == 0 else None)
    limit = stable_time_step(body, m, 1e-13)
    bonds = comm.gather(body.nbonds)
    *_, state = peri.central_difference(body, m, 1e-3 * own, None, dt=0.5 * limit.dt, until=18 * limit.dt)
    moved, energies = body.gather(state.u), state.energies
    body.close()
    if comm.rank == 0:
        whole = peri.Peridynamics(peri.BondBasis(numbering_basis(mesh), eps), material, no_fail)

        def off(a, b):
            return float(np.abs(a - b).max() / np.abs(b).max())

        c, d = census_and_damage(whole, u)
        serial = peri.stable_time_step(whole, peri.mass_matrix(numbering_basis(mesh)), tolerance=1e-13)
        *_, other = peri.central_difference(whole, mass, 1e-3 * u, None, dt=0.5 * limit.dt, until=18 * limit.dt)
        print(
            json.dumps(
                {
                    "force": off(force, whole.force(u)),
                    "same_force": bool(np.array_equal(force, whole.force(u))),
                    "energy": abs(energy / whole.energy(u) - 1),
                    "stiffness": off(product, whole.stiffness_operator() @ u),
                    "softened": [count.softened, c.softened],
                    "intact": bool(np.array_equal(intact, d.intact)),
                    "Z": off(Z, d.Z),
                    "area": abs(count.area / c.area - 1),
                    "elastic": abs(count.elastic / c.elastic - 1),
                    "eigenvalue": abs(limit.eigenvalue / serial.eigenvalue - 1),
                    "nodal": abs(limit.nodal_bound / serial.nodal_bound - 1),
                    "row_sum": abs(limit.row_sum / serial.row_sum - 1),
                    "closed": abs(limit.closed_form / serial.closed_form - 1),
                    "bonds": [bonds, whole.bonds.nbonds],
                    "moved": off(moved, other.u),
                    "same_motion": bool(np.array_equal(moved, other.u)),
                    "energies": [energies.total, other.energies.total, energies.imbalance],
                    "steps": state.step,
                    "size": float(vertex_sizes(mesh).max()),
                }
            )
        )


if __name__ == "__main__":
    main()

"""Run by mpiexec: bodies of all rules, masses and Poisson ratios over ranks beside the whole; prints what is off."""

import dataclasses
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
    from skfem_peridynamics.model.space import numbering_basis, vector_basis
    from skfem_peridynamics.ranks.distributed import distributed
    from skfem_peridynamics.ranks.limit import stable_time_step
    from skfem_peridynamics.ranks.mass import RankMass
    from skfem_peridynamics.ranks.world import world

    comm, found = world(), {}
    pairs, gauss = peri.PairRule(), peri.PairRule(points="gauss")
    ball, at_vertices = peri.BallRule(), peri.BallRule(outer="vertices")
    one_sided = peri.BallRule(outer="vertices", symmetric=False)
    soft = {"young": 1.0, "toughness": 1e-3, "density": 2.0}
    plate = peri.Material.from_elastic(**soft, plane="stress", poisson=0.2)
    strained = peri.Material.from_elastic(**soft, plane="strain", poisson=0.4)
    block = peri.Material.from_elastic(**soft, poisson=0.35)
    discrete = dataclasses.replace(plate, calibrate="discrete", poisson=None)
    law = peri.Exponential(1.0, 1e-2)
    cases = {
        "Gauss pairs": (2, 14, 0.2, gauss, law, {}),
        "balls": (2, 14, 0.2, ball, law, {}),
        "pairs, overlapped": (2, 20, 0.16, pairs, law, {"overlap": True}),
        "balls, overlapped": (2, 14, 0.2, ball, law, {"overlap": True}),
        "balls, 1D": (1, 60, 0.07, ball, law, {}),
        "balls, 3D": (3, 5, 0.5, ball, law, {}),
        "balls at vertices": (2, 16, 0.2, at_vertices, law, {}),
        "one-sided balls": (2, 16, 0.2, one_sided, law, {}),
        "balls, by arrays": (2, 12, 0.25, ball, law, {"compiled": False}),
        "balanced Gauss pairs": (2, 12, 0.25, gauss, law, {"balanced": True}),
        "balanced balls": (2, 12, 0.25, ball, law, {"balanced": True}),
        "w, balanced pairs": (2, 20, 0.16, pairs, law, {"balanced": True, "boundary_function": "smooth"}),
        "corner pairs": (2, 24, 0.25, peri.CornerRule(), law, {}),
        "balanced corner pairs": (2, 24, 0.25, peri.CornerRule(), law, {"balanced": True}),
        "corner pairs, 3D": (3, 8, 0.4, peri.CornerRule(), law, {}),
        "corner pairs that give way": (2, 12, 0.25, peri.CornerRule(1, 3), law, {"balanced": True}),
        "discrete pairs": (2, 20, 0.16, pairs, discrete, {"balanced": True}),
        "discrete balls": (2, 14, 0.2, ball, discrete, {}),
        "discrete balls at vertices, 3D": (
            3,
            6,
            0.3,
            at_vertices,
            dataclasses.replace(block, calibrate="discrete"),
            {},
        ),
        "poisson 0.2": (2, 20, 0.16, pairs, plate, {}),
        "poisson 0.4, by arrays": (2, 16, 0.2, pairs, strained, {"compiled": False}),
        "poisson 0.4, balls": (2, 12, 0.25, ball, strained, {}),
        "poisson 0.35, 3D": (3, 6, 0.45, pairs, block, {"balanced": True}),
    }
    named = sys.argv[2:] or list(cases)
    for name in {"even": list(cases)[::2], "odd": list(cases)[1::2]}.get(named[0], named):
        dim, n, eps, rule, material, options = cases[name]
        mesh = box(dim, n, "random")
        if dim == 2:
            mesh = peri.slit(box(dim, n), peri.Crack([[0.0, 0.5], [0.5, 0.5]]))
            inner = (abs(mesh.p - 0.5) < 0.49).all(axis=0) & (abs(mesh.p[1] - 0.5) > 1e-6)
            mesh.p[:, inner] += 0.2 / n * np.random.default_rng(1).uniform(-1, 1, (2, inner.sum()))
        # a Ritz value is as good as the square of its residual where K is symmetric; a limit of softer bodies has it
        tolerance = 1e-8 if rule.symmetric and material is not plate else 1e-13
        body = distributed(mesh, eps, material, rule=rule, **options)
        rng = np.random.default_rng(3)
        u, v = 0.02 * rng.standard_normal((2, dim * mesh.nvertices))
        own, other_own = (body.scatter(x if comm.rank == 0 else None) for x in (u, v))
        force, product = body.gather(body.force(own)), body.gather(body.stiffness(own))
        energy, stress = body.total(body.energy(own)), body.gather(body.stress(own).ravel())
        count, hurt = body.look(own)
        Z, intact = body.gather(hurt.Z), body.gather(hurt.intact)
        consistent, lumped = RankMass.of(body, 2.0), body.scatter(None if comm.rank else lumped_of(mesh))
        times, limits = body.gather(consistent @ own), []
        solved = body.gather(consistent.solver(np.arange(0, len(own), 7)).solve(own * (np.arange(len(own)) % 7 > 0)))
        marked = body.gather((np.arange(len(own)) % 7 > 0).astype(float))
        for m in (lumped, consistent):
            limits.append(stable_time_step(body, m, tolerance))
        moved = []
        for m in (lumped, consistent):
            dt = 0.2 * limits[-1].dt
            *_, state = peri.central_difference(body, m, 0.1 * own, other_own, dt=dt, until=4 * dt)
            moved.append(body.gather(state.u))
            moved.append(np.array([state.energies.kinetic, state.energies.elastic]))
        bonds, moments = comm.gather(body.nbonds), body.any_piece.moments
        body.close()
        if comm.rank:
            continue
        basis = peri.BondBasis(
            numbering_basis(mesh), eps, rule=rule, boundary_function=options.get("boundary_function")
        )
        basis = basis.balanced() if options.get("balanced") else basis
        whole = peri.Peridynamics(basis, material, compiled=options.get("compiled"))

        def off(a, b):
            return float(np.abs(a - b).max() / np.abs(b).max())

        c, d = census_and_damage(whole, u)
        M = peri.mass_matrix(vector_basis(mesh), density=2.0, kind="consistent")
        free = np.flatnonzero(marked)
        exact = np.zeros(len(u))
        import scipy.sparse.linalg as linalg

        exact[free] = linalg.spsolve(M[free][:, free].tocsc(), u[free])
        one = {
            "force": off(force, whole.force(u)),
            "same_force": bool(np.array_equal(force, whole.force(u))),
            "product": off(product, whole.stiffness_operator() @ u),
            "energy": abs(energy / whole.energy(u) - 1),
            "stress": off(stress, peri.stress(whole, u).ravel()),
            "Z": off(Z, d.Z),
            "intact": off(intact, d.intact),
            "softened": [count.softened, c.softened],
            "elastic": abs(count.elastic / c.elastic - 1),
            "area": abs(count.area - c.area) / max(c.area, 1e-300),
            "mass": off(times, M @ u),
            "solve": off(solved, exact),
            "bonds": [bonds, whole.bonds.nbonds],
            "moments": off(np.array(moments), np.array(whole.moments)),
            "limits": [],
            "moved": [],
        }
        for m, limit, k in ((lumped_of(mesh), limits[0], 0), (M, limits[1], 2)):
            serial = peri.stable_time_step(whole, m, tolerance=tolerance)
            names = ("eigenvalue", "nodal_bound", "row_sum", "closed_form", "bonds")
            pair = [(getattr(limit, key), getattr(serial, key)) for key in names]
            one["limits"].append([0.0 if a == b else abs(a / b - 1) for a, b in pair])
            dt = 0.2 * limits[-1].dt
            *_, state = peri.central_difference(whole, m, 0.1 * u, v, dt=dt, until=4 * dt)
            one["moved"].append(off(moved[k], state.u))
            one["moved"].append(off(moved[k + 1], np.array([state.energies.kinetic, state.energies.elastic])))
        found[name] = one
    if comm.rank == 0:
        print(json.dumps(found))


def lumped_of(mesh):
    import skfem_peridynamics as peri
    from skfem_peridynamics.model.space import numbering_basis

    return peri.mass_matrix(numbering_basis(mesh), density=2.0).diagonal()


if __name__ == "__main__":
    main()

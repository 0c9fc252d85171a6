"""Run by mpiexec: Newmark and statics in a script, on every rank, beside the whole; prints what is off as JSON."""

import json
import sys
import warnings


def main():
    warnings.simplefilter("error")
    sys.path.insert(0, sys.argv[1])
    import numpy as np

    import skfem_peridynamics as peri
    from bodies import box
    from skfem_peridynamics.model.space import vector_basis
    from skfem_peridynamics.ranks.distributed import distributed
    from skfem_peridynamics.ranks.implicit import left_matrix, left_of_vertices
    from skfem_peridynamics.ranks.mass import RankMass
    from skfem_peridynamics.ranks.world import world
    from skfem_peridynamics.solve.left import left_of

    comm, found = world(), {}
    mesh = peri.slit(box(2, 16), peri.Crack([[0.0, 0.5], [0.5, 0.5]]))
    soft = {"young": 1.0, "toughness": 1e-3, "density": 2.0, "plane": "stress"}
    basis, N = vector_basis(mesh), 2 * mesh.nvertices

    def part_of(x):
        return body.scatter(x if comm.rank == 0 else None)

    def motions(p, first):
        """Prescribed motions of the vertices of a mesh, of which the first so many count."""
        x, y = p[:, :first]
        left, top = np.flatnonzero(x < 1e-9), np.flatnonzero(y > 1 - 1e-9)
        out = []
        if len(left):
            out.append(peri.Prescribed(np.concatenate([2 * left, 2 * left + 1]), displacement=0.0))
        if len(top):  # not at the corner, which is held
            top = top[x[top] > 0.2]
        if len(top):
            out.append(peri.Prescribed(2 * top + 1, displacement=lambda t: 0.04 * t * x[top]))
        return out

    b = np.zeros(N)
    b[2 * np.flatnonzero(mesh.p[0] > 1 - 1e-9)] = 1e-4
    for name, poisson in (("bonds", 1.0 / 3.0), ("dilatation", 0.2)):
        material = peri.Material.from_elastic(**soft, poisson=poisson)
        body = distributed(mesh if comm.rank == 0 else None, 0.2, material)
        own_b, p, n = part_of(b), body.share.mesh.p, body.share.own
        keys = {"load": lambda t, own_b=own_b: t * own_b, "fixed": motions(p, n)}
        states = list(peri.static(body, steps=8, **keys))
        rest = [body.gather(np.asarray(s.u)) for s in states][-1], states[-1].elastic, states[-1].imbalance
        reaction = body.gather(np.asarray(states[-1].reaction))
        lumped = part_of(peri.mass_matrix(basis, density=2.0).diagonal())
        masses = lumped, RankMass.of(body, 2.0)
        moved = []
        for m in masses:
            *_, state = peri.newmark(body, m, dt=0.2, until=2.0, **keys)
            moved.append((body.gather(np.asarray(state.u)), state.energies.total, state.energies.imbalance))
        limit = peri.stable_time_step(body, lumped)
        torn = 0.05 * np.random.default_rng(1).standard_normal(N)
        left = [(left_matrix(body, u), body.gather(left_of_vertices(body, u).ravel())) for u in (None, part_of(torn))]
        said = []
        for wrong in ({"steps": 0}, {"steps": 2, "fixed": ()}):
            try:
                next(peri.static(body, **(keys | wrong)))
            except ValueError as error:
                said.append(str(error)[:30])
        everyone = comm.gather(said)
        body.close()
        if comm.rank:
            continue
        whole = peri.Peridynamics(peri.BondBasis(basis, 0.2), material)
        keys = {"load": lambda t: t * b, "fixed": motions(mesh.p, mesh.nvertices)}
        *_, last = peri.static(whole, steps=8, **keys)

        def off(a, b):
            return float(np.abs(a - b).max() / np.abs(b).max())

        one = {"static": off(rest[0], last.u), "reaction": off(reaction, last.reaction)}
        one |= {"elastic": abs(rest[1] / last.elastic - 1.0), "imbalance": abs(rest[2] - last.imbalance) / last.elastic}
        one["softened"] = peri.census(whole, last.u).softened
        for kind, (u, total, imbalance) in zip(("lumped", "consistent"), moved, strict=True):
            M = peri.mass_matrix(basis, density=2.0, kind=kind)
            *_, last = peri.newmark(whole, M, dt=0.2, until=2.0, **keys)
            one[kind] = off(u, last.u)
            one[kind] += abs(total / last.energies.total - 1.0) + abs(imbalance - last.energies.imbalance) / total
        one["limit"] = abs(
            limit.nodal_bound / peri.stable_time_step(whole, peri.mass_matrix(basis, density=2.0)).nodal_bound - 1
        )
        one["said"], one["left"] = everyone, []
        for u, (K, vertices) in zip((None, torn), left, strict=True):
            of_whole = left_of(whole, u)
            one["left"] += [abs(K - of_whole.matrix()).max() / abs(K).max(), off(vertices, of_whole.vertices().ravel())]
        found[name] = one
    if comm.rank == 0:
        print(json.dumps(found))


if __name__ == "__main__":
    main()

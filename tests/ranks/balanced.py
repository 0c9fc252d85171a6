"""Run by mpiexec: balanced bodies over ranks beside the whole; the first rank prints what is off as JSON."""

import json
import sys
import warnings


def main():
    warnings.simplefilter("error")
    sys.path.insert(0, sys.argv[1])
    import numpy as np

    import skfem_peridynamics as peri
    from bodies import box
    from skfem_peridynamics.model.space import numbering_basis
    from skfem_peridynamics.ranks.distributed import distributed
    from skfem_peridynamics.ranks.world import world

    comm, found = world(), {}
    for dim, n, eps, influence, compiled in (
        (1, 60, 0.06, "conical", None),
        (2, 24, 0.13, "constant", None),
        (2, 24, 0.13, "conical", False),
        (3, 9, 0.36, "constant", None),
    ):
        mesh = box(dim, n, "random")
        if dim == 2:
            mesh = peri.slit(box(dim, n), peri.Crack([[0.0, 0.5], [0.5, 0.5]]))
            inner = (abs(mesh.p - 0.5) < 0.49).all(axis=0) & (abs(mesh.p[1] - 0.5) > 1e-6)
            mesh.p[:, inner] += 0.2 / n * np.random.default_rng(1).uniform(-1, 1, (2, inner.sum()))
        law = peri.Exponential(1.0, 1e-2)
        body = distributed(mesh, eps, law, influence=influence, balanced=True, compiled=compiled)
        u = 0.02 * np.random.default_rng(3).standard_normal(dim * mesh.nvertices)
        own = body.scatter(u if comm.rank == 0 else None)
        force, product = body.gather(body.force(own)), body.gather(body.stiffness(own))
        balance, bonds = body.any_piece.bonds.balance, comm.allreduce(body.nbonds)
        missed = comm.gather(body.share.number[balance.unbalanced])
        body.close()
        if comm.rank == 0:
            plain = peri.BondBasis(numbering_basis(mesh), eps, influence)
            whole = peri.Peridynamics(plain.balanced(), law, compiled=compiled)
            other = whole.bonds.balance
            found[f"{dim}D {influence} {compiled}"] = {
                "force": float(np.abs(force - whole.force(u)).max() / np.abs(force).max()),
                "product": float(np.abs(product - whole.stiffness_operator() @ u).max() / np.abs(product).max()),
                "unlike": float(np.abs(peri.Peridynamics(plain, law).force(u) - force).max() / np.abs(force).max()),
                "figures": [
                    abs(getattr(balance, name) - getattr(other, name))
                    for name in ("residual", "residual_near", "smallest", "rms", "iterations")
                ],
                "unbalanced": sorted(np.concatenate(missed).tolist()) == sorted(other.unbalanced.tolist()),
                "bonds": [bonds, whole.bonds.nbonds],
            }
    if comm.rank == 0:
        print(json.dumps(found))


if __name__ == "__main__":
    main()

"""Bodies over several processes: partition, halo and eigenvalues are PETSc's and SLEPc's, the bonds are ours."""

"""The nonlocal operators: energy, its gradient and its Hessian, mass and loads."""

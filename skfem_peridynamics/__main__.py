"""``python -m skfem_peridynamics``: the same as the command ``skfem-peridynamics``."""

import sys

from .app.cli.main import main

if __name__ == "__main__":
    sys.exit(main())

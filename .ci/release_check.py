"""Refuse a release whose tag, version and changelog do not agree: ``python .ci/release_check.py v0.2.0``."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def complaint(tag: str, version_file: str, changelog: str) -> str | None:
    """Return what is wrong with a release, or None.

    >>> complaint("v1.0.0", '__version__ = "1.0.0"', "## [1.0.0] - 2026-01-01\\n### Added\\n- all")
    >>> complaint("v1.0.1", '__version__ = "1.0.0"', "## [1.0.0] - 2026-01-01")
    'tag v1.0.1 is not v1.0.0, the version of the package'
    >>> complaint("v1.0.0", '__version__ = "1.0.0"', "## [Unreleased]")
    'CHANGELOG.md has no section "## [1.0.0] - DATE"'
    """
    found = re.search(r'__version__ = "([^"]+)"', version_file)
    version = found[1] if found else ""
    if tag != f"v{version}":
        return f"tag {tag} is not v{version}, the version of the package"
    if not re.search(rf"^## \[{re.escape(version)}\] - \d{{4}}-\d\d-\d\d$", changelog, re.M):
        return f'CHANGELOG.md has no section "## [{version}] - DATE"'
    return None


if __name__ == "__main__":
    version_file = (ROOT / "skfem_peridynamics" / "_version.py").read_text()
    sys.exit(complaint(sys.argv[1], version_file, (ROOT / "CHANGELOG.md").read_text()))
